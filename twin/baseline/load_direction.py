"""Whether what a shaft's lines show rises or falls with load, among healthy recordings and those compared with them.

    ln a_i = c + b·u_i + ε        a the root mean square of the lines, u the load over the learned range: 0 … 1

The load is the torque, or, where it is not measured, the slip: the speed of an induction motor falls with load. The
deflection that a cracked tooth adds rises with load; what falls with it is not the crack's.

Source   least squares with Student's t; the direction of every effect: twin/effects (`Signature.load`)
Holds    loads that reach over a good part of the learned range; nothing is said of drives that change their speed
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.special import stdtr

from twin.baseline.findings import BaselineComparison, ShaftChange
from twin.baseline.learned import Baseline
from twin.baseline.operating import DEFAULT as OPERATING
from twin.baseline.reading import WindowReading
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadDirectionThresholds:
    """When lines fall with load."""

    probability: float = deciding(
        0.01, meaning="probability of a steeper fall by chance", source="convention: 1 %",
    )  # fmt: skip
    least_share: float = deciding(
        0.25, of="lines measured", meaning="size of the healthy lines from which their direction is the change's",
        source="convention: a quarter; the change is then less than five times what was there",
    )  # fmt: skip
    least_points: int = deciding(
        4, meaning="loads from which a direction is estimated", source="derivation: two are free"
    )
    least_range: float = deciding(
        0.3, of="learned range", meaning="range that the loads must have", source="not derived",
    )  # fmt: skip


DEFAULT = LoadDirectionThresholds()


def fall_with_load(
    baseline: Baseline,
    compared: Sequence[BaselineComparison],
    changes: Sequence[Sequence[ShaftChange]],
    strongest: ShaftChange,
    limits: LoadDirectionThresholds = DEFAULT,
) -> float | None:
    """Ratio of the lines over the learned range where they clearly fall with load; None where that is not shown.

    changes    of the shaft, by window
    strongest  of these: its channel and lines are looked at; where the windows have one load only, and the healthy
               machine has these lines, too, the healthy recordings tell the direction
    """
    load = [_load(baseline, r) for r in baseline.readings]
    if any(value is None for value in load) or np.ptp(np.array(load, dtype=float)) == 0:
        return None
    channel, places = (
        strongest.channel,
        _places(strongest.shaft, strongest.multiples, strongest.strong, baseline.period),
    )
    own = [
        (_load(baseline, window.reading), _size(change.lines[strongest.strong]))
        for window, found in zip(compared, changes, strict=True)
        for change in found
        if change.channel == channel and change.lines.size == strongest.lines.size
    ]
    if len(own) >= limits.least_points:
        return _fall(np.array(load, dtype=float), np.array(own, dtype=float), limits)
    healthy = [(u, _size(r.channels[channel].lines[places])) for u, r in zip(load, baseline.readings, strict=True)]
    measured = max(_size(w.reading.channels[channel].lines[places]) for w in compared if channel in w.reading.channels)
    if np.median([size for _, size in healthy]) < limits.least_share * measured:
        return None
    return _fall(np.array(load, dtype=float), np.array(healthy, dtype=float), limits)


def _load(baseline: Baseline, reading: WindowReading) -> float | None:
    """Torque [N·m], or the speed with its sign turned [Hz]; None where neither is a load."""
    if "torque_nm" in baseline.axes:
        return reading.torque_nm
    speeds = [r.speed_hz for r in baseline.readings]
    slip = np.ptp(speeds) < OPERATING.speed_varies * np.mean(speeds)
    return -reading.speed_hz if slip else None


def _places(shaft: Fraction, multiples: np.ndarray, strong: np.ndarray, period: int) -> np.ndarray:
    return np.rint(multiples[strong] * float(shaft) * period).astype(int) - 1


def _size(lines: np.ndarray) -> float:
    return float(max(np.sqrt(np.mean(np.abs(lines) ** 2)), 1e-30))


def _fall(learned: np.ndarray, points: np.ndarray, limits: LoadDirectionThresholds) -> float | None:
    """e^b where b is clearly negative; points are loads and sizes (n, 2)."""
    u, y = points[:, 0] / np.ptp(learned), np.log(points[:, 1])
    if len(u) < limits.least_points or np.ptp(u) < limits.least_range:
        return None
    b, c = np.polyfit(u, y, 1)
    scatter = np.sum((y - b * u - c) ** 2) / (len(u) - 2)
    std = float(np.sqrt(scatter / np.sum((u - u.mean()) ** 2)))
    chance = float(stdtr(len(u) - 2, b / max(std, 1e-12)))
    return float(np.exp(b)) if chance < limits.probability else None
