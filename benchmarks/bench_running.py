"""What the running system costs: wear alone and traced, constant and varying conditions, one machine and many.

    python -m benchmarks.bench_running [--assets 1 12 100]

The generator makes two campaigns of a machine without a fault, WINDOWS windows of 10 s at 25.6 kHz: at one speed and
torque, and with both changed from window to window. Three more accelerometers are copies of the first with noise of
their own. Processor times of one thread, from the frames of a recording to the answers; the first third of the
measurement windows, in which the machine is learned and traced at each window, is given apart from the rest.

Many machines are of one kind with face widths of their own, so that no curve serves two. Each has passed the bundled
campaign but for its last windows, which then are processed machine after machine and in turn.
"""

from __future__ import annotations

import argparse
import hashlib
import statistics
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from zlib import crc32

import numpy as np

from benchmarks.bench_pipeline import Figure
from benchmarks.scoring import windows_of
from benchmarks.trace_campaigns.generate import FOLDER, RIG
from recordings.generator.deliver import simulate_file
from service.contract.estimate import step
from service.stream.frames import SampleFrame
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import encode
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.updating.model_cache import PATHS
from twin.windows import Window

SPEC = """
schema = "gear-campaign/1"
rig = "{rig}"
asset = "running"
started = "2026-02-02T08:00:00+00:00"
seed = 11
[wear]
k_m2_per_n = 6.07e-12
from_revolutions = 47
contact_half_width_um = 200
[machine]
mesh_stiffness_scale = 0.9
[[calibration]]
speed_hz = 2.0
torque_nm = 10.0
seconds = 3.0
[[calibration]]
speed_hz = 2.0
torque_nm = 20.0
seconds = 3.0
{conditions}
[sensors]
acceleration_rate_hz = 25600
[windows]
seconds = 10
at_revolutions = {revolutions}
"""
WINDOWS = 15
EVERY = 300.0  # revolutions between two windows
CONSTANT = ((10.0, 10.0),)
VARYING = ((10.0, 10.0), (9.5, 11.0), (10.4, 9.3), (9.8, 12.0), (10.6, 10.6))  # Hz, N·m
CHANNELS = 4
AIMS = {"wear alone": 5.0, "traced": 20.0}  # of a second of signal under constant conditions [ms]
NOISE = 0.1  # of the copies [m/s²]
SHORT = RIG.parents[1] / "paper-campaign.mcap"
LAST = 3  # windows of each machine that are measured
WIDER = 1e-4  # share by which a machine's gears are wider than those of the one before


def spec_of(conditions: Sequence[tuple[float, float]]) -> str:
    """A campaign whose conditions take turns from window to window."""
    revolutions = [EVERY * k for k in range(WINDOWS)]
    tables = [
        f"[[conditions]]\nspeed_hz = {speed}\ntorque_nm = {torque}\nuntil_revolutions = {at + EVERY / 2}\n"
        for at, (speed, torque) in zip(revolutions, WINDOWS * list(conditions), strict=False)
    ]
    return SPEC.format(rig=RIG, conditions="".join(tables), revolutions=revolutions)


def campaign(conditions: Sequence[tuple[float, float]]) -> Path:
    """The recording, made where it is not there."""
    spec = spec_of(conditions)
    name = f"running-{hashlib.sha256(spec.encode()).hexdigest()[:12]}"
    path = FOLDER / f"{name}.mcap"
    if not path.exists():
        FOLDER.mkdir(parents=True, exist_ok=True)
        toml, made = FOLDER / f"{name}.toml", FOLDER / f"{name}.partial.mcap"
        toml.write_text(spec, encoding="utf-8")
        simulate_file(str(toml), str(made), None, lambda share, what: None)
        with_copies(made, path)
        made.unlink()
    return path


def with_copies(source: Path, path: Path) -> None:
    """The recording with CHANNELS accelerometers."""
    part = path.with_suffix(".partial")
    with (
        Recording(source) as recording,
        RecordingWriter(part, rig_text=recording.rig_text, metadata=recording.metadata) as writer,
    ):
        for frame in recording.frames(_refuse):
            writer.write(frame.channel, frame.end_time_ns, encode(frame))
            if isinstance(frame, SampleFrame) and frame.channel.kind == "accel":
                for number in range(1, CHANNELS):
                    rng = np.random.default_rng([number, crc32(str(frame.start_time_ns).encode())])
                    values = frame.values + rng.normal(0.0, NOISE, frame.values.size).astype(np.float32)
                    copy = replace(frame, channel=frame.channel._replace(name=f"a{number}"), values=values)
                    writer.write(copy.channel, copy.end_time_ns, encode(copy))
    part.rename(path)


def _refuse(channel: object, error: Exception) -> None:
    raise error


@dataclass(slots=True)
class Passed:
    """A campaign that has been passed."""

    decoding: float = 0.0  # processor time of all windows [s]
    signal: float = 0.0  # of all windows [s]
    steps: list[tuple[float, float]] = field(default_factory=list)  # signal and processor time of measurements [s]
    found: int = 0  # effects at the end

    def pace(self, late: bool) -> float:
        """Times real time, of the first third of the measurement windows or of the rest."""
        third = len(self.steps) // 3
        part = self.steps[third:] if late else self.steps[:third]
        signal = sum(s for s, _ in part)
        return signal / (sum(t for _, t in part) + self.decoding * signal / self.signal)


def passed(path: Path, trace: bool) -> Passed:
    """Takes a campaign from its frames to its answers, without any curve at hand."""
    PATHS.clear()
    begun = time.process_time()
    rig, windows = windows_of(path)
    out = Passed(decoding=time.process_time() - begun, signal=sum(w.duration for w in windows))
    state, options = State(), Options(trace=trace)
    for window in windows:
        begun = time.process_time()
        state, estimate = step(rig, state, window, options)
        taken = time.process_time() - begun
        if estimate.record["kind"] != "calibration":
            out.steps.append((window.duration, taken))
    out.found = len(state.tracing.found)
    return out


def one_machine() -> list[Figure]:
    """The pace of one machine's campaigns."""
    figures, paces = [], {}
    for name, conditions in (("constant", CONSTANT), ("varying", VARYING)):
        path = campaign(conditions)
        for how, trace in (("wear alone", False), ("traced", True)):
            run = passed(path, trace)
            paces[name, trace] = run.pace(late=True)
            note = (
                f"a second of signal: {run.pace(late=True):.3g} × real time, {run.pace(late=False):.3g} in the first "
                f"third; slowest window {max(t for _, t in run.steps):.2f} s; effects found {run.found}"
            )
            what = f"{CHANNELS} channels at 25.6 kHz, {name} conditions, {how}"
            aim = AIMS[how] if conditions is CONSTANT else None
            figures.append(
                Figure(what=what, value=1e3 / run.pace(late=True), unit="ms", aim=aim, limit=200.0, note=note)
            )
    for how, trace in (("wear alone", False), ("traced", True)):
        ratio = paces["constant", trace] / paces["varying", trace]
        figures.append(Figure(what=f"  varying conditions over constant, {how}", value=ratio, unit="", aim=1.5))
    return figures


def machine(rig: Rig, number: int) -> Rig:
    """One of many machines of a kind."""
    values = dict(rig.values)
    values["gears"] = {**values["gears"], "face_width": values["gears"]["face_width"] * (1 + WIDER * number)}
    return Rig.from_mapping(values)


def many_machines(count: int) -> list[Figure]:
    """What a window costs where so many machines take turns, beside one machine after the other."""
    rig, windows = windows_of(SHORT)
    rigs = [machine(rig, k) for k in range(count)]
    options = Options(trace=False)
    states = []
    for own in rigs:
        state = State()
        for window in windows[:-LAST]:
            state, _ = step(own, state, window, options)
        states.append(state)
    each = [(k, w) for k in range(count) for w in windows[-LAST:]]
    turns = [(k, w) for w in windows[-LAST:] for k in range(count)]
    _timed(rigs, list(states), each, options)  # all curves are as deep as they will be needed
    one, other = (_timed(rigs, list(states), order, options) for order in (each, turns))
    note = f"ms a window; {1e3 * one:.3g} one after the other; curves of {PATHS.nbytes / 2**20:.0f} MB kept"
    return [
        Figure(what=f"{count} machines in turn, wear alone", value=1e3 * other, unit="", note=note),
        Figure(what="  over one after the other", value=other / one, unit="", aim=1.2),
    ]


def _timed(
    rigs: Sequence[Rig], states: list[State], order: Iterable[tuple[int, Window]], options: Options
) -> float:  # fmt: skip
    """Median processor time of a window [s]."""
    times = []
    for k, window in order:
        begun = time.process_time()
        states[k], _ = step(rigs[k], states[k], window, options)
        times.append(time.process_time() - begun)
    return statistics.median(times)


def main(assets: Sequence[int] = (1, 12, 100)) -> list[Figure]:
    """Prints all figures; answers them."""
    print(f"{'the running system':<58}{'found':>10} {'':<7}{'aim':>10} {'ratio':>7}")
    figures: list[Figure] = []
    for part in (one_machine, *(lambda count=count: many_machines(count) for count in assets)):
        for figure in part():
            print(figure.line, flush=True)
            figures.append(figure)
    return figures


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_running", description=__doc__)
    parser.add_argument("--assets", nargs="+", type=int, default=[1, 12, 100])
    main(parser.parse_args().assets)
