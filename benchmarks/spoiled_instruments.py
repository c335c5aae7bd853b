"""What is said of machines whose instruments are at fault, healthy ones and ones with a fault beside it.

    python -m benchmarks.spoiled_instruments [--faulty] [--seed N] [KIND …]

The windows of a simulated campaign are spoiled in each way of tests/instrument_faults.py, all of them or those of its
second half, laid out again as those of a stream are, and traced. Counted are effects of gears and bearings that the
sound campaign does not show, and those that it shows and the spoiled one has lost. The status is 1 where a healthy
machine got such a name.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.scoring import windows_of
from service.contract.estimate import step
from service.stream.channels import kind_of
from service.stream.frames import NS, SampleFrame
from service.stream.pieces import Piece
from service.stream.quality import grade_of
from service.stream.samples import Span, lay_samples
from service.stream.window import by_sound_instruments
from service.stream.wire.topics import Channel
from tests.instrument_faults import KINDS, Spoil
from twin.effects import EFFECTS
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.windows import Fault, Samples, Window

RECORDINGS = Path(__file__).parents[1] / "recordings"
OF_INSTRUMENTS = {name for name, effect in EFFECTS.items() if effect.facts.acts_on == "sensor"}
NO_NAME = {"none", "unknown_effect"}


def laid(rig: Rig, window: Window) -> Window:
    """The window as a stream of frames with these samples gives it."""
    faults: list[Fault] = []
    accelerations: dict[str, Samples] = {}
    for name, s in window.accelerations.items():
        channel, start = Channel("m", "accel", name), window.start_time_ns + round(s.start * NS)
        size = round(5 * s.rate)
        parts = [s.values[i : i + size] for i in range(0, s.values.size, size)]
        pieces = [
            Piece(
                SampleFrame(
                    channel=channel,
                    start_time_ns=start + round(i * size / s.rate * NS),
                    sequence=i,
                    sample_rate=s.rate,
                    values=part,
                ),
                0,
                part.size,
            )
            for i, part in enumerate(parts)
        ]
        span = Span(window.start_time_ns, window.start_time_ns + round(window.duration * NS))
        found = lay_samples(channel.label, kind_of(channel.label), pieces, span, faults, rig)
        if found is not None:
            accelerations[name] = found
    every = (*window.faults, *faults)
    return by_sound_instruments(
        rig, replace(window, accelerations=accelerations, faults=every, quality=grade_of(every))
    )


def said(rig: Rig, windows: Sequence[Window]) -> tuple[list[str], str, set[str]]:
    """Effects, level of the status and kinds of faults after all windows."""
    state, kinds = State(), set()
    for window in windows:
        kinds |= {fault.kind for fault in window.faults}
        state, found = step(rig, state, window, Options(trace=True))
    return [e["name"] for e in found.report["effects"]], found.report["status"]["level"], kinds


def cases(kinds: Sequence[str], seed: int) -> Iterator[tuple[str, Spoil, int]]:
    """Name, way to spoil, and the first window that is spoiled, as a share of 2: each in turn, by the seed too."""
    for kind in kinds or KINDS:
        for i, spoil in enumerate(KINDS[kind]):
            yield f"{kind} {i}", spoil, (i + seed) % 2


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--faulty", action="store_true", help="a machine with a cracked tooth")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("kinds", nargs="*", choices=[*KINDS, []], metavar="KIND")
    given = parser.parse_args(arguments)
    faulty = given.faulty
    rig, windows = windows_of(RECORDINGS / f"{'faulty' if faulty else 'short'}-campaign.mcap")
    sound, level, _ = said(rig, windows)
    print(f"sound: {', '.join(sound) or 'no effect'}; {level}", flush=True)
    real = set(sound) - OF_INSTRUMENTS - NO_NAME
    count = false = lost = 0
    for name, spoil, late in cases(given.kinds, given.seed):
        chance, first = np.random.default_rng((given.seed, count)), late * len(windows) // 2
        spoiled = [laid(rig, spoil(w, chance) if i >= first else w) for i, w in enumerate(windows)]
        names, level, kinds = said(rig, spoiled)
        machine = set(names) - OF_INSTRUMENTS - NO_NAME
        count, false, lost = count + 1, false + bool(machine - real), lost + bool(real - machine)
        mark = ("FALSE " if machine - real else "") + ("LOST" if real - machine else "")
        print(f"{name:16} {level:10} {', '.join(names) or '-':60} {', '.join(sorted(kinds)) or '-'} {mark}", flush=True)
    print(f"{count} spoiled: {false} with a false name of a gear or bearing, {lost} that have lost a name")
    return int(bool(false) and not faulty)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
