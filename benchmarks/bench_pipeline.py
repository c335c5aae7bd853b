"""What from frames to wear costs: time of a window, of a curve, of a campaign, and memory.

    python -m benchmarks.bench_pipeline

Times are processor times of one thread, which is what they take on a core of its own, however busy the machine;
start-up is also given by the clock on the wall. Commands run in processes of their own, as a user runs them.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.long_recording import write_long_recording
from service.files.rig import rig_of
from service.stream.sources.mcap import Recording, read_windows
from twin.features.extract import extract
from twin.model import Calibration, Condition, Model
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.step import step
from twin.wear.curve import MasterCurve

T = TypeVar("T")

ROOT = Path(__file__).parents[1]
CAMPAIGN = ROOT / "recordings" / "paper-campaign.mcap"
TEN = 10  # windows
REVOLUTIONS = 18_000
SHORT = 10.0  # the long recording's shorter twin, at most [minutes]


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One figure beside its aim; less is better."""

    what: str
    value: float
    unit: str
    aim: float | None = None
    note: str = ""
    by_the_clock: bool = False  # moves with what else the machine does
    limit: float | None = None  # beyond which the run fails: twice the aim where None

    @property
    def missed(self) -> bool:
        """Whether the value is beyond its limit by more than the machine's noise can explain."""
        limit = 2 * self.aim if self.limit is None and self.aim is not None else self.limit
        return limit is not None and not self.by_the_clock and self.value > limit

    @property
    def line(self) -> str:
        beside = "" if self.aim is None else f"{self.aim:>10g} {self.value / self.aim:>7.2f}"
        return f"{self.what:<58}{self.value:>10.3g} {self.unit:<7}{beside:<19} {self.note}".rstrip()


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What a command used."""

    wall: float  # [s]
    cpu: float  # [s]
    peak: float  # resident memory [MB]


def command(*arguments: str) -> Run:
    """Runs `gear-twin` with the arguments."""
    begun = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "service", *arguments], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    assert process.stderr is not None
    said = process.stderr.read().decode(errors="replace")
    process.stderr.close()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"gear-twin {' '.join(arguments)} ended with {process.returncode}: {said.strip()}")
    return Run(wall=time.monotonic() - begun, cpu=used.ru_utime + used.ru_stime, peak=used.ru_maxrss / 1024)


def start_up() -> list[Figure]:
    """`gear-twin --help`, the quickest of five after one that compiles."""
    command("--help")
    runs = [command("--help") for _ in range(5)]
    return [
        Figure(
            what="start-up of the command, wall",
            value=min(r.wall for r in runs),
            unit="s",
            aim=1.0,
            by_the_clock=True,
        ),
        Figure(what="start-up of the command, processor", value=min(r.cpu for r in runs), unit="s", aim=1.0),
    ]


LOADING = """
import time
began = time.process_time()
from service.long_lived import long_lived
with long_lived():
    {loads}
print(time.process_time() - began)
"""
LOADS = {
    "service": "import service.logs, service.runtime.serve",
    "libraries": "import alembic, fastapi, mcap.reader, numpy, prometheus_client, pydantic_settings, sqlalchemy; "
    "import sse_starlette, structlog",
}


def import_of_the_service() -> list[Figure]:
    """What `gear-twin serve` loads, as it does, with byte code at hand; and over its libraries."""
    with tempfile.TemporaryDirectory(prefix="gear-twin-bench-") as made:
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        environment["PYTHONPYCACHEPREFIX"] = made
        times: dict[str, list[float]] = {name: [] for name in LOADS}
        for _ in range(6):
            for name, loads in LOADS.items():
                program = [sys.executable, "-c", LOADING.format(loads=loads)]
                times[name].append(float(subprocess.check_output(program, cwd=ROOT, env=environment)))
    quickest = {name: min(each[1:]) for name, each in times.items()}
    ratio = quickest["service"] / quickest["libraries"]
    return [
        Figure(
            what="import of the service, processor", value=quickest["service"], unit="s", aim=0.6, by_the_clock=True
        ),
        Figure(what="import of the service, over its libraries", value=ratio, unit="times", aim=2.0, limit=3.0),
    ]


def one_window() -> list[Figure]:
    """Features, prediction and K of single windows, along the whole campaign."""
    _, _, windows = read_windows(CAMPAIGN)
    with Recording(CAMPAIGN) as recording:
        rig = rig_of(recording, None)
    options = Options(trace=False)
    features, before = [], [State()]
    first, again = [], []
    for window in windows:
        features.append(_taken(extract, rig, window)[1])
        (state, estimate), taken = _taken(step, rig, before[-1], window, options)
        first.append((estimate, taken))
        before.append(state)
    for state, window in zip(before, windows, strict=False):  # after all of them: nothing of one window is at hand
        again.append(_taken(step, rig, state, window, options)[1])
    steps = [
        (taken, min(taken, later))
        for (estimate, taken), later in zip(first, again, strict=True)
        if estimate.window is not None and estimate.window.kind == "measurement"
    ]
    known = [again for _, again in steps]
    building = sum(first - again for first, again in steps)
    seconds = statistics.median(w.duration for w in windows)
    return [
        Figure(
            what="update of one window (features, prediction, K), median",
            value=1e3 * statistics.median(known),
            unit="ms",
            aim=10.0,
            limit=100.0,
            note=f"{len(known)} windows of {seconds:.1f} s, wear curve known",
        ),
        Figure(what="  of these, features", value=1e3 * statistics.median(features), unit="ms", aim=4.0, limit=50.0),
        Figure(
            what="  update over features",
            value=statistics.median(known) / statistics.median(features),
            unit="times",
            aim=1.6,
            limit=2.6,
        ),
        Figure(what="  the slowest window, wear curve known", value=1e3 * max(known), unit="ms"),
        Figure(
            what="  wear curves computed meanwhile, all together",
            value=building,
            unit="s",
            note="each once, when calibration or half-width settle",
        ),
    ]


def _taken(function: Callable[..., T], *arguments: Any) -> tuple[T, float]:
    """What a function gives, and the processor time that it takes [s]."""
    begun = time.process_time()
    return function(*arguments), time.process_time() - begun


def reference_model(rig: Rig) -> tuple[Model, float]:
    """The rig's model before any calibration, and its x = K·τ·ω1·N after all revolutions [rad/N]."""
    K, dwell, speed = rig.require("the wear curve", "wear.K", "wear.dwell_time", "operating.pinion_speed_hz")
    return Model.of(rig, Calibration.prior(rig)), K * dwell * 2 * pi * speed * REVOLUTIONS


def master_curve() -> list[Figure]:
    """The master curve of the rated condition, as deep as 18,000 revolutions at the rig file's K wear."""
    with Recording(CAMPAIGN) as recording:
        rig = rig_of(recording, None)
    speed, torque = rig.require("the wear curve", "operating.pinion_speed_hz", "operating.input_torque")
    condition = Condition(speed_hz=speed, torque=torque)
    deep = 1e-6 * 500  # some more than 18,000 revolutions wear: the depth is known once the curve is

    def build(until: float) -> tuple[MasterCurve, float]:
        model, _ = reference_model(rig)
        begun = time.process_time()
        curve = MasterCurve.build(model, condition, model.unworn, until)
        return curve, time.process_time() - begun

    work = reference_model(rig)[1]
    until = build(deep)[0].depth_at(work)
    curve, taken = build(until)
    reached = "" if curve.complete else f", steady states to {1e6 * curve.valid_to:.0f} µm"
    return [
        Figure(
            what=f"wear curve to {REVOLUTIONS:,} revolutions",
            value=taken,
            unit="s",
            aim=0.15,
            limit=2.0,
            note=f"{1e6 * until:.0f} µm, {curve.depth.size} points{reached}",
        )
    ]


def campaign(folder: Path) -> list[Figure]:
    """`gear-twin assess`: ten windows of the bundled campaign, and all of it."""
    ten = folder / "ten.mcap"
    first_windows(CAMPAIGN, ten, TEN)
    whole = folder / "whole.json"
    runs = [
        ("ten windows, wear alone", 30.0, command("assess", str(ten), "--no-trace", "--json", str(folder / "a.json"))),
        ("ten windows, traced", 60.0, command("assess", str(ten), "--json", str(folder / "b.json"))),
        ("all windows, traced", None, command("assess", str(CAMPAIGN), "--json", str(whole))),
    ]
    return [
        Figure(what=f"assess of the campaign: {what}", value=run.cpu, unit="s", aim=aim, note=f"{run.peak:.0f} MB")
        for what, aim, run in runs
    ]


def first_windows(source: Path, path: Path, count: int) -> None:
    """The first windows of a recording, as a recording."""
    from benchmarks.long_recording import bursts
    from service.stream.sources.mcap_write import RecordingWriter
    from service.stream.wire.codec import encode

    with Recording(source) as recording:
        chosen = bursts(recording.frames(lambda channel, error: None))[:count]
        with RecordingWriter(path, rig_text=recording.rig_text, metadata=recording.metadata) as writer:
            for frame in (f for burst in chosen for f in burst):
                writer.write(frame.channel, frame.end_time_ns, encode(frame))


def long_recording(folder: Path, minutes: float) -> list[Figure]:
    """`assess` of a long recording at 25.6 kHz and of a shorter one: pace and memory from the difference."""
    found: list[tuple[float, int, Run]] = []
    for length in (min(SHORT, minutes / 6), minutes):
        path, out = folder / f"{length:g}.mcap", folder / f"{length:g}.json"
        write_long_recording(path, 60 * length)
        run = command("assess", str(path), "--no-trace", "--json", str(out))
        found.append((length, len(json.loads(out.read_text(encoding="utf-8"))["windows"]), run))
        path.unlink()
    (short, fewer, brief), (long, more, full) = found
    pace = (full.cpu - brief.cpu) / (more - fewer)
    real = 60 * (long - short) / (full.cpu - brief.cpu)
    return [
        Figure(
            what="whole pipeline, wear alone, a window of 25.6 kHz",
            value=1e3 * pace,
            unit="ms",
            note=f"{1 / pace:.1f} windows/s on one core, {real:.0f} × real time",
        ),
        Figure(what=f"peak memory, recording of {short:g} minutes", value=brief.peak, unit="MB"),
        Figure(
            what=f"peak memory, recording of {long:g} minutes",
            value=full.peak,
            unit="MB",
            aim=1.25 * brief.peak,
            note=f"{full.peak / brief.peak:.2f} × that of {short:g} minutes, {more} windows",
        ),
    ]


def main(minutes: float = 60.0) -> list[Figure]:
    """Prints all figures; answers them."""
    print(f"{'from frames to wear':<58}{'found':>10} {'':<7}{'aim':>10} {'ratio':>7}")
    figures: list[Figure] = []
    with tempfile.TemporaryDirectory(prefix="gear-twin-bench-") as made:
        folder = Path(made)
        for part in (
            start_up,
            import_of_the_service,
            one_window,
            master_curve,
            lambda: campaign(folder),
            lambda: long_recording(folder, minutes),
        ):
            for figure in part():
                print(figure.line, flush=True)
                figures.append(figure)
    return figures


if __name__ == "__main__":
    main()
