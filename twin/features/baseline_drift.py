"""Drift of an accelerometer's zero: a sensor that settles after it is switched on, or that warms up or cools down.

    b_p(t)   least-squares cubic spline through means over BLOCK, pieces of p seconds
    drift    var b_½ > share·max(1, 4 s/length)²·var(x − b_½), and var b_2 > ½·var b_½

A machine's vibration goes to and fro, so that within pieces of two seconds it leaves no trend; a drift does not. What
is drift is taken out, and the vibration is what it would have been without.

x, b   acceleration and its zero [m/s²]

Source   J. S. Bendat, A. G. Piersol, Random Data, 4th ed. (2010), 11.1.2 (trend removal)
Holds    shafts that turn twice in a second and more: the vibration of slower ones, where it is most of the signal,
         looks like a drift if it lasts for a second or two only
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_lsq_spline

from twin.thresholds import deciding

BLOCK = 0.05  # [s] over which the zero is averaged before the fit
FEWEST = 16  # blocks


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftThresholds:
    """When the zero of an accelerometer has moved within a window."""

    fine: float = deciding(
        0.5, unit="s", meaning="piece of the spline that follows the zero",
        source="not derived: a third of the time in which the cut-off of an IEPE amplifier, 0.1 to 1 Hz, settles",
    )  # fmt: skip
    coarse: float = deciding(
        2.0, unit="s", meaning="piece of the spline that must show most of the same, or it is a vibration",
        source="derivation: half a turn of a shaft at 0.25 Hz, the slowest that is no drift",
    )  # fmt: skip
    share: float = deciding(
        0.04, of="mean square of the rest", meaning="mean square of the zero from which it has drifted",
        source="derivation: the level would be wrong by 2 %",
    )  # fmt: skip


DEFAULT = DriftThresholds()


def baseline_drift(values: np.ndarray, rate: float, limits: DriftThresholds = DEFAULT) -> np.ndarray | None:
    """Drift of the zero at each value (n,), NaN where lost; its mean is 0. None where the zero keeps its place."""
    size = max(1, round(BLOCK * rate))
    count = values.size // size
    if count < FEWEST:
        return None
    blocks = values[: count * size].reshape(count, size)
    known = np.isfinite(blocks)
    weight = known.sum(axis=1).astype(float)
    mean = np.where(known, blocks, 0.0).sum(axis=1) / np.maximum(weight, 1.0)
    if np.count_nonzero(weight) < FEWEST:
        return None
    centre = float(np.average(mean, weights=weight))
    share = limits.share * max(1.0, 2 * limits.coarse * rate / values.size) ** 2
    total = float(np.nanmean((values - centre) ** 2))
    if float(np.average((mean - centre) ** 2, weights=weight)) <= share / (1 + share) * total:
        return None
    middle = (np.arange(count) + 0.5) * size / rate
    fine, coarse = (_trend(middle, mean - centre, weight, piece) for piece in (limits.fine, limits.coarse))
    power, slow = (float(np.average(trend(middle) ** 2, weights=weight)) for trend in (fine, coarse))
    if power <= share * (total - power) or slow < 0.5 * power:
        return None
    return np.asarray(fine(np.clip(np.arange(values.size) / rate, 0, count * size / rate)))


def _trend(time: np.ndarray, values: np.ndarray, weight: np.ndarray, piece: float):
    """Cubic spline nearest to values at rising times (n,) [s], with pieces of such a length at least."""
    known = np.flatnonzero(weight > 0)
    end = time[-1] + time[0]
    pieces = max(1, min(int(end / piece), known.size // 4))
    inner = np.linspace(0.0, end, pieces + 1)[1:-1]
    beside = np.searchsorted(time[known], inner)
    inner = inner[np.concatenate(([True], np.diff(beside) > 0))[: inner.size]] if inner.size else inner
    knots = np.concatenate(([0.0] * 4, inner, [end] * 4))
    return make_lsq_spline(time[known], values[known], knots, k=3, w=np.sqrt(weight[known]))
