"""Product and raw limit beside healthy baselines: false alarms, healthy recordings left out in turn, and faults found.

    python -m benchmarks.healthy_baselines [--first SEED] [--machines N] [--processes N]

40 machines of plain formulas (tests/claims/healthy_machines.py): ten whose teeth show no pattern that repeats, ten with
foreign sidebands while healthy, ten with a sensor at its rail, ten without any of these; seven healthy recordings of a
day each, and four faults of random size each. Then the measured sets that have more than one healthy recording, where
they are (GEAR_TWIN_SHARED). The raw limit is one on RMS and kurtosis alone, for as many false alarms as are meant of
a whole verdict: twice those of the one that stands beside it and takes part in it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.measured import LOADS, MEASURED, THIRD, imported
from service.files.baseline import Loaded, load, modulation_of
from tests.claims.healthy_machines import Machine
from twin.baseline.comparison import (
    compare_levels,
    compare_with_baseline,
    pair_shafts,
    read_lines,
    tracked,
)
from twin.baseline.learned import Baseline
from twin.baseline.leaving_out import learn
from twin.baseline.raw_limit import limit_on
from twin.baseline.reading import WindowReading, raw_of
from twin.baseline.repeats import DEFAULT as REPEATS
from twin.errors import TwinError
from twin.rig import Rig
from twin.windows import Window

FIRST, MACHINES = 200, 40  # limits were set on the machines 0 to 39, and once more after 100 to 139
HEALTHY = 7
LEAST = 4  # that must be usable for a machine to take part
FAULTS = ("impact", "level", "noise", "foreign")
SIZES = (0.15, 1.0)  # of the faults, drawn evenly in the logarithm
KINDS: dict[str, Callable[[int], Machine]] = {
    "no pattern that repeats": lambda seed: Machine(seed=seed, repeats=False),
    "foreign sidebands": lambda seed: Machine(seed=seed, foreign_hz=3.1 + 0.37 * seed),
    "a sensor at its rail": lambda seed: Machine(seed=seed, rail=1.6),
    "nothing of these": lambda seed: Machine(seed=seed),
}
BROKEN_TOOTH = "broken tooth, seven loads"

Judged = tuple[bool, bool, bool]  # whether the product calls a recording changed, the raw limit does, and it alone


def judged(baseline: Baseline, rig: Rig, window: Window) -> Judged:
    """One window beside a baseline."""
    modulated = False
    try:
        new = tracked(rig, window, "new#0", baseline.shafts)
        found = compare_with_baseline(baseline, rig, [new])
        modulated = any(m.new for m in modulation_of(Loaded(rig, "", [new], [], []), baseline))
    except TwinError as error:
        found = compare_levels(baseline, rig, [window], str(error))
    changed = modulated or bool(found.effects) or found.unexplained.verdict == "unknown_effect"
    levels = {name: raw_of(samples.values) for name, samples in window.accelerations.items()}
    raw = limit_on(baseline, [levels], REPEATS.false_alarms)
    return changed, bool(raw.exceeded), found.raw_limit.decides_alone and not modulated


def of_number(number: int) -> list[tuple[str, Judged]]:
    """One of the simulated machines, whose kinds follow one another."""
    return list(of_machine(list(KINDS.values())[number % len(KINDS)](number)))


def measured() -> list[tuple[str, Judged]]:
    """The broken-tooth set."""
    with TemporaryDirectory() as folder:
        return list(of_broken_tooth(Path(folder)))


def of_machine(machine: Machine) -> Iterator[tuple[str, Judged]]:
    """Every healthy recording beside a baseline of the others, and every fault beside one of all."""
    rig, shafts = machine.rig, pair_shafts(machine.rig)
    read: dict[int, WindowReading] = {}
    for i in range(HEALTHY):
        with suppress(TwinError):  # a recording whose mesh lines tell no speed is not learned from, as in `baseline`
            read[i] = read_lines(rig, tracked(rig, machine.window(i), f"h{i}#0", shafts), shafts)
    if len(read) < LEAST:
        return
    for i in read:
        known = learn(rig, [r for j, r in read.items() if j != i], shafts)
        yield "healthy", judged(known, rig, machine.window(i))
    known, rng = learn(rig, list(read.values()), shafts), np.random.default_rng((machine.seed, 9))
    for number, fault in enumerate(FAULTS):
        size = float(np.exp(rng.uniform(*np.log(SIZES))))
        yield "faulty", judged(known, rig, machine.window(100 + number, fault=fault, size=size))


def of_broken_tooth(folder: Path) -> Iterator[tuple[str, Judged]]:
    """Every healthy recording of the broken-tooth set, and the broken one of the same load, beside the other loads."""
    data = MEASURED / "spectraquest-broken-tooth"
    rig: Rig | None = None
    windows: dict[tuple[str, int], Window] = {}
    read: dict[int, WindowReading] = {}
    for state in "hb":
        for percent in LOADS:
            found = load(imported(data.name, data / f"{state}30hz{percent}.csv.gz", folder))
            rig, windows[state, percent] = found.rig, found.windows[0].window
            shafts: Sequence[Fraction] = (*pair_shafts(rig), THIRD)
            if state == "h":
                one = tracked(rig, windows[state, percent], f"h{percent}#0", shafts)
                read[percent] = read_lines(rig, one, shafts)
    assert rig is not None
    for percent in LOADS:
        known = learn(rig, [r for p, r in read.items() if p != percent], shafts)
        yield "healthy", judged(known, rig, windows["h", percent])
        yield "faulty", judged(known, rig, windows["b", percent])


def row(name: str, found: Sequence[tuple[str, Judged]]) -> str:
    """One line of the table."""
    cells = []
    for state in ("healthy", "faulty"):
        own = [judged for kind, judged in found if kind == state]
        product, raw, alone = (sum(one[i] for one in own) for i in range(3))
        lost = sum(raw and not changed for changed, raw, _ in own)
        cells.append(f"{product:>4} of {len(own):<4} {raw:>4} of {len(own):<4} {alone:>4} {lost:>4}")
    return f"{name:<28}" + "    ".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first machine")
    parser.add_argument("--machines", type=int, default=MACHINES, help="simulated ones, of four kinds in turn")
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    with ProcessPoolExecutor(given.processes) as pool:
        broken = pool.submit(measured) if MEASURED.is_dir() else None
        machines = list(pool.map(of_number, range(given.first, given.first + given.machines)))
        print(f"{'':<28}healthy, left out in turn              faulty")
        print(f"{'':<28}" + "    ".join(["product      raw limit    alone lost"] * 2))
        for kind, name in enumerate(KINDS):
            used = machines[kind :: len(KINDS)]
            left_out = sum(not found for found in used)
            print(
                row(name, [one for found in used for one in found])
                + (f"   {left_out} machines without a speed" if left_out else "")
            )
        print(row(f"{given.machines} simulated machines", [one for found in machines for one in found]))
        if broken is None:
            print(f"left out: no measured sets in {MEASURED} (GEAR_TWIN_SHARED)", file=sys.stderr)
        else:
            print(row(BROKEN_TOOTH, broken.result()))
    print("alone: the raw limit alone decides; lost: beyond the raw limit, and not called changed by the product")


if __name__ == "__main__":
    main()
