"""Whether bands hold what they say: depth of every window and remaining life at half-life and at the end.

A figure's rank is the probability that was given to values below the truth: ranks of honest bands are spread evenly.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import beta, norm

LEAST_DEPTH = 1.0  # of the truth, from which a window's depth is scored [µm]
DEPTH_AIM = 5.0, 2.0  # error of a depth allowed: percent, or µm where that is more
RANKS = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)  # edges of the diagram
TO_P95 = float(norm.ppf(0.95))


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """One figure with its 5–95 % band against the truth: µm or revolutions; None where it was not given."""

    what: str  # depth, pinion, gear (depth of that gear alone) or life
    when: str  # window, half or end
    true: float
    said: float | None
    low: float | None
    high: float | None
    rank: float | None

    @property
    def inside(self) -> bool | None:
        """Whether the band holds the truth."""
        return (
            None if self.rank is None or self.low is None or self.high is None else self.low <= self.true <= self.high
        )

    @property
    def met(self) -> bool | None:
        """Whether a depth is within the aim, in percent or µm."""
        if self.said is None:
            return None
        percent, least = DEPTH_AIM
        return abs(self.said - self.true) <= max(percent / 100 * self.true, least)


def _normal_rank(true: float, median: float, low: float, high: float) -> float:
    """Of a band whose halves are those of normal distributions."""
    half = (high - median) if true > median else (median - low)
    return float(norm.cdf((true - median) / max(half, 1e-12) * TO_P95))


def depth_bands(truth: Mapping[str, Any], records: Iterable[Mapping[str, Any]]) -> tuple[Band, ...]:
    """Every measurement window's depth, matched to the truth by its revolution count."""
    known = [w for w in truth["windows"] if w["kind"] in ("wear", "measurement")]
    counts = np.array([w["revolutions"] for w in known])
    out = []
    for record in records:
        if record["kind"] != "measurement" or record.get("revolutions") is None:
            continue
        true = known[int(np.argmin(np.abs(counts - record["revolutions"])))]["depth"]["combined_um"]
        if true < LEAST_DEPTH:
            continue
        said, low, high = (record.get(f"wear_depth_{key}um") for key in ("", "p05_", "p95_"))
        if said is None or low is None or high is None:
            out.append(Band(what="depth", when="window", true=true, said=said, low=None, high=None, rank=None))
            continue
        rank = _normal_rank(true, said, low, high)
        out.append(Band(what="depth", when="window", true=true, said=said, low=low, high=high, rank=rank))
    return tuple(out)


def gear_bands(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> tuple[Band, ...]:
    """The depth of either gear at the last window."""
    last, said = truth["windows"][-1]["depth"], (answer.get("wear") or {}).get("max_depth_um") or {}
    out = []
    for gear in ("pinion", "gear"):
        true, band = last.get(f"{gear}_um"), said.get(gear) or {}
        if true is None or true < LEAST_DEPTH:
            continue
        low, median, high = (band.get(key) for key in ("p05", "median", "p95"))
        rank = None
        if low is not None and median is not None and high is not None:
            rank = _normal_rank(true, median, low, high)
        out.append(Band(what=gear, when="end", true=true, said=median, low=low, high=high, rank=rank))
    return tuple(out)


def life_bands(truth: Mapping[str, Any], lives: Sequence[Mapping[str, Any]]) -> tuple[Band, ...]:
    """The remaining life as said at the window nearest to half of the life, and at the last one.

    lives: `revolutions` and `rul`, as the answer has it, after every window. Where half of the life comes after the
    last window there is no band for it.
    """
    end = truth.get("end_of_life", {}).get("revolutions")
    measured = [one for one in lives if one.get("kind") == "measurement" and one.get("revolutions") is not None]
    if end is None or len(measured) < 3:
        return ()
    counts = np.array([one["revolutions"] for one in measured])
    chosen = [("end", len(measured) - 1)]
    half = int(np.argmin(np.abs(counts - end / 2)))
    if abs(counts[half] - end / 2) < 0.15 * end and half < len(measured) - 1:
        chosen.insert(0, ("half", half))
    return tuple(_life_band(when, end - counts[i], measured[i].get("rul") or {}) for when, i in chosen)


def _life_band(when: str, true: float, rul: Mapping[str, Any]) -> Band:
    said = rul.get("revolutions")
    if not said or said.get("median") is None:
        return Band(what="life", when=when, true=float(true), said=None, low=None, high=None, rank=None)
    low, high = said.get("p05"), said.get("p95")
    spread = rul.get("distribution")
    rank: float | None
    if spread and spread.get("revolutions"):
        rank = float(np.interp(true, spread["revolutions"], spread["probability"], left=0.0, right=1.0))
    else:
        rank = None if low is None or high is None else _normal_rank(true, said["median"], low, high)
    return Band(what="life", when=when, true=float(true), said=said["median"], low=low, high=high, rank=rank)


def binomial_interval(hits: int, of: int) -> tuple[float, float]:
    """Clopper and Pearson's 95 % interval of a rate."""
    tail = 0.025
    low = 0.0 if hits == 0 else float(beta.ppf(tail, hits, of - hits + 1))
    high = 1.0 if hits == of else float(beta.ppf(1 - tail, hits + 1, of - hits))
    return low, high


def diagram(grouped: Mapping[str, Sequence[Band]], what: str, when: str) -> list[str]:
    """One line a group: how many figures, how many inside their bands, and how the ranks are spread [%]."""
    bins = "".join(f"{f'{100 * a:.0f}–{100 * b:.0f}':>8s}" for a, b in pairwise(RANKS))
    met = "   ≤ 5 % or 2 µm" if what != "life" else "   median error"
    out = [f"{f'{what}, {when}':24s}{'n':>5s}{'none':>6s}  inside (aim 85–95 %){bins}{met}"]
    everything = [band for bands in grouped.values() for band in bands]
    for name, bands in [*sorted(grouped.items()), ("all", everything)]:
        mine = [b for b in bands if b.what == what and b.when == when]
        ranked = [b for b in mine if b.rank is not None]
        if not mine:
            continue
        line = f"{name:24s}{len(mine):5d}{len(mine) - len(ranked):6d}"
        if ranked:
            inside = sum(bool(b.inside) for b in ranked)
            low, high = binomial_interval(inside, len(ranked))
            share = np.histogram([b.rank for b in ranked if b.rank is not None], RANKS)[0] / len(ranked)
            line += f"{100 * inside / len(ranked):6.0f} ({100 * low:3.0f}–{100 * high:3.0f}) %   "
            line += "".join(f"{100 * s:8.0f}" for s in share) + _closeness(mine, what)
        out.append(line)
    return out if len(out) > 1 else []


def _closeness(bands: Sequence[Band], what: str) -> str:
    if what != "life":
        met = [b.met for b in bands if b.met is not None]
        return f"{100 * np.mean(met):12.0f} %" if met else ""
    off = [100 * (b.said / b.true - 1) for b in bands if b.said is not None and b.true > 0]
    return f"{np.median(np.abs(off)):12.0f} %" if off else ""
