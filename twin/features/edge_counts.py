"""Edges of an encoder that were not counted, or counted twice: found by the intervals between edges, and put right.

    r_k = (t_{k+1} − t_k)/(median of four intervals on either side)

    |r_k − (m + 1)| ≤ ε                 m edges are missing behind edge k: their numbers are put in, their times are NaN
    |r_k + r_{k+1} − 1| ≤ ε, r < 1 − ε  the edge between the two intervals is one too many: it is left out

A long or short interval that comes again after exactly one turn of the count belongs to the disc (an index gap, a
joint): nothing is missing there, since the disc has that number of lines. An edge that is not counted moves all counts
behind it, so that the next one at the same line comes one count early.

With both encoders the counts are held against each other, D = φ1 − φ2·z2/z1 at the window's end less that at its
start. Teeth in mesh let it change by no more than backlash and deflection; what is more is counts that were lost.

t   times of the edges of one encoder                                                              [s]
φ   angle that an encoder has counted                                                            [rad]
ε   tolerance, in intervals, far beyond the scatter of the intervals themselves

Source   derivation above; ISO/TR 10064-2:1996, backlash
Holds    speed changes by much less than a half from one line to the next; at most `most_missing` lines lost at once
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from twin.thresholds import deciding
from twin.windows import Edges

SIDE = 4  # intervals on either side that one is compared with
SAMPLES = 256  # places in a window at which the counts of two encoders are compared


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeCountThresholds:
    """When an interval between edges shows a lost or a doubled count, and when two counts contradict each other."""

    suspect: float = deciding(
        1.5,
        of="the interval before",
        meaning="interval, or its inverse, from which intervals are looked at one by one",
        source="derivation: a lost edge makes 2, an edge too many at most 1/2; sound encoders stay below 1.05",
    )
    tolerance: float = deciding(
        0.2,
        unit="intervals",
        meaning="distance from a whole number of intervals up to which edges were lost or doubled",
        source="derivation: below half of the 1/2 at which the number becomes ambiguous",
    )
    scatter: float = deciding(
        6.0,
        of="standard deviation of an interval over the one before",
        meaning="scatter that must stay below the tolerance for an edge to be put right",
        source="derivation: six standard deviations, less than one false repair in 10⁸ edges",
    )
    steady: float = deciding(
        0.75,
        of="the eight intervals around",
        meaning="share within the tolerance of the usual one, below which the shaft itself has slowed down there",
        source="derivation: two may be struck themselves; a shaft that rattles to a stop leaves three at most",
    )
    slowest: float = deciding(
        4.0,
        of="median interval of the window",
        meaning="interval from which the shaft is starting or stopping, and nothing is put right",
        source="not derived: between one line and the next, a shaft at a quarter of its speed may stop",
    )
    most_missing: int = deciding(
        4,
        unit="edges",
        meaning="edges lost at once that are put in again",
        source="derivation: the longest gap over which the transmission error is interpolated",
    )
    fewest_lines: int = deciding(
        16,
        unit="lines",
        meaning="lines of a disc from which one interval tells of its neighbours",
        source="derivation: eight neighbours are then at most half a turn",
    )
    most_share: float = deciding(
        0.02,
        of="edges",
        meaning="long and short intervals above which the encoder is noisy and nothing is put right",
        source="not derived: one line of a disc of 100, twice over",
    )
    possible: float = deciding(
        0.1,
        of="base pitch",
        meaning="drift between the shafts within a window beyond the stated backlash that teeth can allow",
        source="ISO/TR 10064-2: least backlash 0.02; tolerances, deflection and eccentric discs add as much each",
    )
    lines_per_turn: float = deciding(
        2.0,
        unit="lines a turn",
        meaning="drift above which tooth numbers or lines of the disc are wrong rather than counts lost",
        source="derivation: one line a turn at every turn, on either encoder",
    )
    near_line: int = deciding(
        2,
        unit="lines",
        meaning="distance of a count by the struck line from that by the other encoder, up to which the line holds",
        source="derivation: half a line by rounding, and as much by wear and deflection, on either side",
    )


DEFAULT = EdgeCountThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EdgeCounts:
    """What was wrong with the counts of one encoder in one window, and its edges put right."""

    edges: Edges  # with the numbers that were lost, and without the edges too many
    lost: int  # edges that were not counted
    doubled: int  # edges that were counted in excess
    turns: float  # of the encoder's shaft in the window
    struck: int  # turns with a lost or doubled count
    line: int | None  # of the disc, 0 … lines − 1 by this window's count, where all of them are at one line

    @property
    def text(self) -> str:
        """What is wrong, in words."""
        said = [f"{n} {word}" for n, word in ((self.lost, "lost"), (self.doubled, "doubled")) if n]
        where = " at one line of the disc" if self.line is not None and self.struck > 1 else ""
        return (
            f"encoder edge counts: {' and '.join(said)}{where}, in {self.struck} of {self.turns:.1f} turns of the shaft"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class CountDrift:
    """How far the counts of two encoders drift apart within one window."""

    angle: float  # at the pinion [rad]
    possible: float  # what backlash and deflection allow [rad]
    lines: tuple[float, float]  # the drift in lines of the pinion's and of the gear's encoder
    mean: float  # of φ1 − φ2·z2/z1 over the window [turns of the pinion]
    ratio_wrong: bool  # too steep for lost counts: tooth numbers or lines of a disc are wrong

    @property
    def impossible(self) -> bool:
        """Whether counts must have been lost or doubled."""
        return abs(self.angle) > self.possible and not self.ratio_wrong


def counts_put_right(edges: Edges, limits: EdgeCountThresholds = DEFAULT) -> EdgeCounts | None:
    """The edges of one encoder with lost counts put in (NaN) and doubled ones left out; None where all are sound.

    edges    times (n,) [s], NaN where lost
    returns  None also where the intervals do not tell: too few lines or edges, or too much scatter
    """
    t = edges.times
    if edges.per_rev < limits.fewest_lines or t.size < 4 * SIDE:
        return None
    gaps = np.diff(t)
    before, after = gaps[:-1], gaps[1:]
    suspect = (after > limits.suspect * before) | (before > limits.suspect * after)
    if not suspect.any():
        return None
    if np.count_nonzero(suspect) > 3 * limits.most_share * t.size or _scatter(gaps) * limits.scatter > limits.tolerance:
        return None
    places = np.unique(np.flatnonzero(suspect)[:, None] + (0, 1))
    lost, extra = _events(gaps, places, limits)
    return _put_right(edges, *_without_marks(edges, lost, extra))


def _scatter(gaps: np.ndarray) -> float:
    """Standard deviation of an interval over the one before, by the median; (n,), NaN left out."""
    change = np.log(gaps[1:] / gaps[:-1])
    change = change[np.isfinite(change)]
    return float(1.4826 * np.median(np.abs(change))) if change.size else np.inf


def _events(gaps: np.ndarray, places: np.ndarray, limits: EdgeCountThresholds) -> tuple[dict[int, int], list[int]]:
    """Edges behind which edges are missing, with how many; and edges that are too many."""
    near = places[:, None] + np.concatenate((np.arange(-SIDE, 0), np.arange(1, SIDE + 1)))
    around = np.where((near >= 0) & (near < gaps.size), gaps[np.clip(near, 0, gaps.size - 1)], np.nan)
    known = np.isfinite(around).sum(axis=1)
    places, around, known = (each[known >= SIDE] for each in (places, around, known))
    usual = np.nanmedian(around, axis=1) if places.size else np.empty(0)
    alike = (np.abs(around / usual[:, None] - 1) <= limits.tolerance).sum(axis=1)  # not of NaN
    turning = usual <= limits.slowest * np.nanmedian(gaps)
    places, usual = (each[turning & (alike >= limits.steady * known)] for each in (places, usual))
    lost: dict[int, int] = {}
    extra: list[int] = []
    for k, one in zip(places.tolist(), usual.tolist(), strict=True):
        ratio = gaps[k] / one
        missing = round(ratio) - 1 if np.isfinite(ratio) else 0
        if 1 <= missing <= limits.most_missing and abs(ratio - missing - 1) <= limits.tolerance:
            lost[k] = missing
        elif ratio < 1 / limits.suspect and not (extra and extra[-1] >= k):
            sides = {j + 1: abs((gaps[j] + gaps[j + 1]) / one - 1) for j in (k - 1, k) if 0 <= j < gaps.size - 1}
            best = min(sides, key=lambda j: sides[j] if np.isfinite(sides[j]) else np.inf)
            if sides[best] <= limits.tolerance:
                extra.append(best)
    return lost, extra


def _without_marks(edges: Edges, lost: dict[int, int], extra: list[int]) -> tuple[dict[int, int], list[int]]:
    """The same without what comes again after exactly one turn of the count: gaps and joints of the disc.

    What could come again only outside of the window is left as it is, too.
    """
    n, turn = edges.times.size, edges.per_rev

    def of_the_count(k: int, others) -> bool:
        inside = [j for j in (k - turn, k + turn) if SIDE <= j < n - SIDE]
        return bool(inside) and not any(j in others for j in inside)

    kept = {k: m for k, m in lost.items() if of_the_count(k, lost)}
    return kept, [k for k in extra if of_the_count(k, set(extra))]


def _put_right(edges: Edges, lost: dict[int, int], extra: list[int]) -> EdgeCounts | None:
    """The edges with NaN for what is missing and without what is too many; None where there is neither."""
    if not lost and not extra:
        return None
    t = edges.times
    numbers = np.ones(t.size, dtype=np.int64)  # how far the count goes on to each edge
    numbers[0] = 0
    for k, missing in lost.items():
        numbers[k + 1] += missing
    kept = np.ones(t.size, dtype=bool)
    kept[extra] = False
    numbers[extra] = 0
    index = np.cumsum(numbers)
    times = np.full(int(index[-1]) + 1, np.nan)
    times[index[kept]] = t[kept]
    struck = index[[*lost, *extra]] + edges.first_index
    place = struck % edges.per_rev + np.array([1] * len(lost) + [0] * len(extra))
    off = (place - place[0] + edges.per_rev // 2) % edges.per_rev - edges.per_rev // 2
    return EdgeCounts(
        edges=replace(edges, times=times),
        lost=sum(lost.values()),
        doubled=len(extra),
        turns=times.size / edges.per_rev,
        struck=np.unique((struck - struck.min() + edges.per_rev // 2) // edges.per_rev).size,
        line=int(place[0] % edges.per_rev) if np.all(off == 0) else None,
    )


def count_drift(
    pinion: Edges, gear: Edges, teeth: tuple[int, int], backlash: float = 0.0, limits: EdgeCountThresholds = DEFAULT
) -> CountDrift | None:
    """How far the counts of the two encoders drift apart; None where they do not pass together long enough.

    pinion, gear  times (n,) and (m,) [s]
    teeth         z1, z2
    backlash      angle at the pinion [rad]
    """
    z1, z2 = teeth
    good = np.isfinite(pinion.times)
    places = np.unique(np.linspace(0, gear.times.size - 1, SAMPLES).astype(int))
    at = gear.times[places]
    own = pinion.times[good]
    if own.size < SAMPLES:
        return None
    usable = np.isfinite(at) & (at >= own[0]) & (at <= own[-1])
    if np.count_nonzero(usable) < SAMPLES // 2:
        return None
    counted = (pinion.first_index + np.interp(at[usable], own, np.flatnonzero(good))) / pinion.per_rev
    expected = (gear.first_index + places[usable]) * (z2 / (z1 * gear.per_rev))
    apart, part = counted - expected, np.count_nonzero(usable) // 8
    drift = float(apart[-part:].mean() - apart[:part].mean())
    turns = float(counted[-1] - counted[0])
    lines = drift * pinion.per_rev, drift * gear.per_rev * z1 / z2
    steep = min(abs(lines[0]) / turns, abs(lines[1]) / (turns * z1 / z2)) > limits.lines_per_turn
    tells = min(pinion.per_rev, gear.per_rev) / (max(z1, z2) + 1) > limits.lines_per_turn  # of one tooth more
    return CountDrift(
        angle=2 * pi * drift,
        possible=backlash + limits.possible * 2 * pi / z1,
        lines=lines,
        mean=float(apart.mean()),
        ratio_wrong=steep or not tells,
    )
