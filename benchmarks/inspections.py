"""Simulated inspections against the truth: does a measured depth bring the estimate nearer, and never too far away?

    python -m benchmarks.inspections [--set fresh|judge …] [--folder DIR] [--only TEXT …] [--each N] [--no-trace]
                                     [--update fused|rms] [--processes N] [--json OUT]

Every campaign is assessed up to its middle. Then depths are "measured" on the simulated flanks, at a random time so
far, on a random flank, with a random standard deviation of 2 to 15 % (0.5 µm at least) and an error drawn from it.
Prints how far depth and life were from the truth before and after, how often the 5–95 % band held it, and whether any
inspection moved the depth away from the truth by more than its own uncertainty allows.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.evaluate import campaigns
from benchmarks.half_campaigns import Half, half
from benchmarks.trace_campaigns.generate import FOLDER
from twin.assessment import FLANKS, Interval, Life, Wear
from twin.step import inspect
from twin.updating.inspections import Inspection
from twin.updating.wear_now import wear_shares

LEAST_STD = 0.5e-6  # [m]
STD = 0.02, 0.15  # of the depth
EARLIEST = 0.3  # of the revolutions so far
ALLOWED = 3.0  # standard deviations of an inspection


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One inspection; lengths in µm, of both flanks together at the latest window."""

    campaign: str
    revolutions: float  # of the inspection, as a share of those so far
    flank: str
    std: float  # of the inspection, carried to the present depth
    true: float
    before: tuple[float, float, float]  # median, p05, p95
    after: tuple[float, float, float]
    life_before: float | None  # stated median over the true remaining life
    life_after: float | None
    contradicts: bool

    @property
    def errors(self) -> tuple[float, float]:
        """Before and after, without sign [µm]."""
        return abs(self.before[0] - self.true), abs(self.after[0] - self.true)

    @property
    def allowed(self) -> bool:
        """Whether the depth is no farther from the truth than before, or than the inspection's own error may be."""
        before, after = self.errors
        return after <= max(before, ALLOWED * self.std)


def evaluate(path: Path, each: int, trace: bool, update: str) -> list[Trial]:
    """The trials of one campaign; none where it has no depth by the model."""
    found = half(path, trace=trace, update=update)
    if found is None or not isinstance(found.state.latest.wear, Wear):
        return []
    random = np.random.default_rng([int(found.truth["seed"]), 6])
    return list(_trials(found, random, each))


def _trials(found: Half, random: np.random.Generator, each: int) -> Iterator[Trial]:
    counts, depths = found.wear
    shares = wear_shares(found.rig)
    wear, life = found.state.latest.wear, found.state.latest.life
    assert isinstance(wear, Wear)
    now = float(np.interp(found.revolutions, counts, depths))
    limit = found.rig.get("end_of_life.max_depth")
    left = float(np.interp(limit, depths, counts)) - found.revolutions
    for _ in range(each):
        count = random.uniform(EARLIEST, 1.0) * found.revolutions
        flank = FLANKS[random.integers(len(FLANKS))]
        true = float(np.interp(count, counts, depths))
        std = shares[flank] * max(random.uniform(*STD) * true, LEAST_STD)
        depth = max(shares[flank] * true + std * random.normal(), 0.0)
        _, after = inspect(
            found.rig, found.state, Inspection(revolutions=count, depth=depth, flank=flank, std=std)
        )  # fmt: skip
        assert isinstance(after.wear, Wear) and after.wear.inspected is not None
        yield Trial(
            campaign=found.name, revolutions=count / found.revolutions, flank=flank,
            std=1e6 * std / shares[flank] * now / max(true, 1e-9), true=1e6 * now,
            before=_micrometres(wear.depth["combined"]), after=_micrometres(after.wear.depth["combined"]),
            life_before=_ratio(life, left), life_after=_ratio(after.life, left),
            contradicts=after.wear.inspected.compared[0].contradicts,
        )  # fmt: skip


def _micrometres(band: Interval) -> tuple[float, float, float]:
    median = band.median or 0.0
    return 1e6 * median, 1e6 * band.p05, 1e6 * (median if band.p95 is None else band.p95)


def _ratio(life: object, left: float) -> float | None:
    if not isinstance(life, Life) or not life.revolutions.median or left <= 0:
        return None
    return life.revolutions.median / left


def table(trials: Sequence[Trial]) -> list[str]:
    """What inspections did, for those of a standard deviation below and above 5 %, and for all."""
    out = [
        "inspections            number   depth error, mean µm    in the band %    life off, mean %   too far",
        "                                  before     after    before   after     before   after",
    ]
    groups = (
        ("all", list(trials)),
        ("std below 5 %", [t for t in trials if t.std < 0.05 * t.true]),
        ("std from 5 % on", [t for t in trials if t.std >= 0.05 * t.true]),
        ("band missed before", [t for t in trials if not t.before[1] <= t.true <= t.before[2]]),
    )
    for name, here in groups:
        if not here:
            continue
        before, after = (float(np.mean(e)) for e in zip(*(t.errors for t in here), strict=True))
        held = [
            100 * float(np.mean([band[1] <= t.true <= band[2] for t, band in pairs]))
            for pairs in ([(t, t.before) for t in here], [(t, t.after) for t in here])
        ]
        lives = [
            [100 * abs(np.log(r)) for t in here if (r := (t.life_before, t.life_after)[i]) is not None] for i in (0, 1)
        ]
        life = [f"{float(np.mean(values)):9.1f}" if values else f"{'–':>9s}" for values in lives]
        too_far = sum(not t.allowed for t in here)
        out.append(
            f"{name:22s}{len(here):7d}{before:12.2f}{after:10.2f}{held[0]:9.0f}{held[1]:9.0f}"
            f"  {life[0]}{life[1]}{too_far:9d}"
        )
    return [*out, f"said to contradict the windows: {sum(t.contradicts for t in trials)}"]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.inspections", description=__doc__)
    parser.add_argument("--set", nargs="+", choices=["fresh", "judge"], default=["fresh"])
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where recordings are kept")
    parser.add_argument("--only", nargs="+", metavar="TEXT", default=[], help="campaigns with this in their name")
    parser.add_argument("--each", type=int, default=4, metavar="N", help="inspections of every campaign")
    parser.add_argument("--no-trace", action="store_true", help="model wear alone")
    parser.add_argument("--update", choices=["fused", "rms"], default="fused", help="what sets the depth")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path, metavar="OUT", help="write all figures to this file")
    given = parser.parse_args(arguments)
    paths = list(campaigns(given.set, given.folder, given.processes, given.only, "own"))
    if not paths:
        print("no campaign of this name", file=sys.stderr)
        return 2
    trial = partial(evaluate, each=given.each, trace=not given.no_trace, update=given.update)
    with ProcessPoolExecutor(min(given.processes, len(paths))) as pool:
        trials = [t for found in pool.map(trial, paths) for t in found]
    print("\n".join(table(trials)))
    for t in trials:
        if not t.allowed:
            print(
                f"too far: {t.campaign}, {t.errors[0]:.2f} to {t.errors[1]:.2f} µm, std {t.std:.2f} µm", file=sys.stderr
            )
    if given.json:
        given.json.write_text(json.dumps([asdict(t) for t in trials], ensure_ascii=False, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
