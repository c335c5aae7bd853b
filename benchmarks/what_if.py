"""What-if against the truth: is a stated probability of reaching a time the share of machines that reach it?

    python -m benchmarks.what_if [--set fresh|judge|steps …] [--folder DIR] [--only TEXT …] [--no-trace]
                                 [--processes N] [--json OUT]

Every campaign is assessed up to its middle. For depths of 25 to 500 µm and several times ahead, the probability that
the depth stays below is compared with what the simulated machine did, under its true duty (constant, alternating, or
with a step of load or speed at the middle: set `steps`). Prints, for odd and even campaigns apart: the reliability by
classes of probability, the Brier score with that of the share of the other campaigns, the quantiles at which the
truth lay, and how often the 5–95 % band held it; lives that the twin calls preliminary apart.

The simulated machines keep their wear coefficient to the end, which no real machine promises, and the twin assumes that
it wanders from window to window (twin/updating/tracker.py). A further table therefore draws FUTURES futures of each
steady campaign in which the coefficient goes on to wander by as much as assumed: at one condition, wear goes by the
sum of the coefficient over the revolutions, so the truth is stretched by the drawn coefficient.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise, repeat
from pathlib import Path

import numpy as np

from benchmarks.evaluate import campaigns
from benchmarks.half_campaigns import Half, half, measured, stepped_rows
from benchmarks.trace_campaigns.generate import FOLDER, make_all
from twin.assessment import Wear
from twin.errors import TwinError
from twin.updating.tracker import RATE
from twin.what_if import Phase, what_if

DEPTHS = (25.0, 50.0, 75.0, 100.0, 150.0, 200.0, 300.0, 400.0, 500.0)  # [µm]
AHEAD = (1.2, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0)  # revolutions, of those run so far
NEAREST = 1.2  # of the present depth: nearer depths are not asked for
FUTURES = 5  # drawn for each campaign
SEED = 20_261_122
CLASSES = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """When a machine reached a depth, and what had been said of it."""

    campaign: str
    depth: float  # [µm]
    quantile: float  # of the stated distribution at which the truth lay
    ratio: float  # true time over the stated median
    preliminary: bool
    future: int  # number of the drawn future; 0 where the coefficient stays
    asked: tuple[tuple[float, float, bool], ...]  # revolutions ahead, of those so far; stated probability; reached it


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """One campaign."""

    name: str
    crossings: tuple[Crossing, ...] = ()
    reason: str | None = None  # why nothing could be said


def evaluate(path: Path, trace: bool) -> Result:
    """What was said of a campaign at its middle, against what came."""
    found = half(path, trace=trace)
    if found is None:
        return Result(name=path.stem, reason="no window could be used")
    try:
        return Result(name=path.stem, crossings=tuple(_crossings(found)))
    except TwinError as why:
        return Result(name=path.stem, reason=str(why))


def _crossings(found: Half) -> Iterator[Crossing]:
    counts, depths = found.wear
    phases = found.phases()
    life = what_if(found.rig, found.state, phases)  # says why, where there is none
    if life.reason is not None:
        return
    wear = found.state.latest.wear
    now = wear.depth["combined"].median if isinstance(wear, Wear) else None
    futures: list[Callable[[float], float]] = _futures(found) if len(phases) == 1 else []
    for depth in DEPTHS:
        if now is None or not NEAREST * now < 1e-6 * depth <= depths[-1] * (1 + 1e-9):
            continue
        reached_at = float(np.interp(1e-6 * depth, depths, counts))
        limit = None if depth == DEPTHS[-1] else 1e-6 * depth
        times = [found.time_to(factor * found.revolutions) for factor in AHEAD]
        chances = [_probability(found, phases, time, limit) for time in times]
        for number, at in enumerate([reached_at, *(future(reached_at) for future in futures)]):
            true = found.time_to(at)
            stated = what_if(found.rig, found.state, phases, max(true, 1e-3), limit)
            median, chance = stated.quantile(0.5), stated.probability
            assert median is not None and chance is not None
            asked = ((a, p, bool(true > time)) for a, p, time in zip(AHEAD, chances, times, strict=True))
            yield Crossing(
                campaign=found.name, depth=depth, quantile=1 - chance, ratio=true / median, future=number,
                preliminary=stated.preliminary is not None, asked=tuple(asked),
            )  # fmt: skip


def _probability(found: Half, phases: Sequence[Phase], time: float, limit: float | None) -> float:
    chance = what_if(found.rig, found.state, phases, time, limit).probability
    assert chance is not None
    return chance


def _futures(found: Half) -> list[Callable[[float], float]]:
    """Revolution counts of machines whose coefficient wanders from now on, by those of the one that keeps it."""
    counts = [w["revolutions"] for w in measured(found.truth)]
    each = float(np.diff([c for c in counts if c <= found.revolutions]).mean())
    random = np.random.default_rng([SEED, *found.name.encode()])
    windows = int(np.ceil((max(found.wear[0]) - found.revolutions) / each)) + 1
    futures: list[Callable[[float], float]] = []
    for _ in range(FUTURES):
        steps = random.normal(0.0, RATE.drift, 4 * windows)
        kept = np.concatenate([[0.0], np.cumsum(each * np.exp(np.cumsum(steps)))])  # by the end of each interval
        run = each * np.arange(kept.size)
        futures.append(partial(_stretched, found.revolutions, kept, run))
    return futures


def _stretched(now: float, kept: np.ndarray, run: np.ndarray, count: float) -> float:
    return now + float(np.interp(count - now, kept, run))


def reliability(crossings: Sequence[Crossing]) -> list[str]:
    """The share of machines that reached a time, by the stated probability."""
    asked = [(p, reached) for c in crossings for _, p, reached in c.asked]
    out = ["stated probability   questions   mean stated   reached"]
    for low, high in pairwise(CLASSES):
        here = [(p, r) for p, r in asked if low <= p < high or (high == 1.0 and p == 1.0)]
        if here:
            stated, reached = (100 * float(np.mean(v)) for v in zip(*here, strict=True))
            out.append(f"{100 * low:5.0f} … {100 * high:3.0f} %{len(here):16d}{stated:12.1f} %{reached:8.1f} %")
    return out


def brier(crossings: Sequence[Crossing]) -> tuple[float, float]:
    """Brier scores of the stated probabilities and of the share of the other campaigns, of the same questions."""
    cells: dict[tuple[float, float], list[tuple[float, bool]]] = {}
    for c in crossings:
        for factor, p, reached in c.asked:
            cells.setdefault((c.depth, factor), []).append((p, reached))
    stated, shares = [], []
    for cell in cells.values():
        total = sum(reached for _, reached in cell)
        for p, reached in cell:
            stated.append((p - reached) ** 2)
            others = (total - reached) / (len(cell) - 1) if len(cell) > 1 else 0.5
            shares.append((others - reached) ** 2)
    return float(np.mean(stated)), float(np.mean(shares))


def histogram(crossings: Sequence[Crossing]) -> list[str]:
    """Tenths of the stated distributions in which the truth lay."""
    counts, _ = np.histogram([c.quantile for c in crossings], bins=10, range=(0, 1))
    share = 100 * counts / max(len(crossings), 1)
    return [
        "truth in tenths of the stated distribution [%], 10 each if calibrated:",
        "  " + "".join(f"{s:6.1f}" for s in share),
    ]


def by_depth(crossings: Sequence[Crossing]) -> list[str]:
    """Bands and medians by depth."""
    out = ["depth µm   campaigns   true/stated median   in the 5–95 % band   below   above"]
    for depth in DEPTHS:
        here = [c for c in crossings if c.depth == depth]
        if here:
            q = np.array([c.quantile for c in here])
            inside = 100 * float(np.mean((q >= 0.05) & (q <= 0.95)))
            out.append(
                f"{depth:8.0f}{len(here):12d}{float(np.median([c.ratio for c in here])):21.3f}{inside:19.0f} %"
                f"{100 * float(np.mean(q < 0.05)):7.0f} %{100 * float(np.mean(q > 0.95)):6.0f} %"
            )
    return out


def summary(results: Sequence[Result], title: str) -> list[str]:
    """All tables of some campaigns."""
    crossings = [c for r in results for c in r.crossings]
    said = [r for r in results if r.crossings]
    if not crossings:
        return [f"{title}: nothing stated"]
    stated, shares = brier(crossings)
    q = np.array([c.quantile for c in crossings])
    return [
        f"{title}: {len(said)} of {len(results)} campaigns with a life, {len(crossings)} crossings, "
        f"{sum(len(c.asked) for c in crossings)} questions",
        *reliability(crossings),
        f"Brier score {stated:.4f}, of the share of the other campaigns {shares:.4f}",
        *histogram(crossings),
        f"in the 5–95 % band: {100 * float(np.mean((q >= 0.05) & (q <= 0.95))):.0f} %",
        *by_depth(crossings),
    ]


def _chosen(results: Sequence[Result], *, preliminary: bool = False, futures: bool = False) -> list[Result]:
    """The same campaigns with the crossings of established lives, or of preliminary ones; drawn futures or the own."""

    def wanted(crossing: Crossing) -> bool:
        return crossing.preliminary is preliminary and (crossing.future > 0) is futures

    return [replace(r, crossings=tuple(filter(wanted, r.crossings))) for r in results]


def recordings(given: argparse.Namespace) -> list[Path]:
    """The campaigns of the sets, made where they are not kept yet."""
    paths = list(campaigns([s for s in given.set if s != "steps"], given.folder, given.processes, given.only, "own"))
    if "steps" in given.set:
        for row, path, why in make_all(stepped_rows(), given.folder, given.processes):
            if path is None:
                print(f"left out: {row.name} could not be made: {why}", file=sys.stderr)
            elif not given.only or any(text in row.name for text in given.only):
                paths.append(path)
    return paths


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.what_if", description=__doc__)
    parser.add_argument("--set", nargs="+", choices=["fresh", "judge", "steps"], default=["fresh", "steps"])
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where recordings are kept")
    parser.add_argument("--only", nargs="+", metavar="TEXT", default=[], help="campaigns with this in their name")
    parser.add_argument("--no-trace", action="store_true", help="model wear alone")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path, metavar="OUT", help="write all figures to this file")
    given = parser.parse_args(arguments)
    paths = recordings(given)
    if not paths:
        print("no campaign of this name", file=sys.stderr)
        return 2
    with ProcessPoolExecutor(min(given.processes, len(paths))) as pool:
        results = list(pool.map(evaluate, paths, repeat(not given.no_trace)))
    steady, steps = ([r for r in results if r.name.startswith("S") is stepped] for stepped in (False, True))
    groups = (
        ("Odd campaigns (tuned on), coefficient kept", _chosen(steady[::2])),
        ("Even campaigns (judged by), coefficient kept", _chosen(steady[1::2])),
        (
            f"Even campaigns, coefficient wanders on by {100 * RATE.drift:.0f} % a window",
            _chosen(steady[1::2], futures=True),
        ),
        ("Load or speed changes at the middle", _chosen(steps)),
        ("Preliminary lives of all campaigns", _chosen(results, preliminary=True)),
    )
    print("\n\n".join("\n".join(summary(group, title)) for title, group in groups if group))
    for r in results:
        if r.reason is not None:
            print(f"no life: {r.name}: {r.reason[:140]}", file=sys.stderr)
    if given.json:
        given.json.write_text(json.dumps([asdict(r) for r in results], ensure_ascii=False, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
