"""What the depth has grown by since the first window that measured it: known also where no window has seen new flanks.

    G = d − d_1,      σ_G² = σ(d)² + σ(d_1)² + (r·G)² + f²

d, d_1  depth by the encoders now and at the first worn window                            [m]
σ       what of a depth is independent from window to window (measurement.py)              [m]
r       what all depths are off by alike, relative, as stated for the present one (depth_band.py)
f       deviation of real teeth in a depth near zero (BandModel.floor)                     [m]

Deviations of the unworn teeth, and wear before the first window, are in d and in d_1 alike and drop out.
"""

from __future__ import annotations

from math import hypot

from twin.assessment import Interval, WearGrowth
from twin.quantiles import Z95
from twin.updating.depth_band import BAND
from twin.updating.memory import Memory
from twin.updating.wear_points import WearPoint


def growth_of(memory: Memory) -> WearGrowth | None:
    """The growth of the combined depth at the latest worn window; None before the first that encoders measured."""
    if not memory.points:
        return None
    first, last = memory.points[0], memory.points[-1]
    grown = last.depth - first.depth
    alike = last.shared_std / last.work if last.work > 0 else 0.0
    std = hypot(_own(first), _own(last), alike * grown, BAND.floor)
    return WearGrowth(
        since_revolutions=first.revolutions,
        windows=len(memory.points),
        depth=Interval(median=grown, p05=max(grown - Z95 * std, 0.0), p95=max(grown + Z95 * std, 0.0)),
    )


def _own(point: WearPoint) -> float:
    """What of a point's depth is independent from window to window [m]."""
    return point.depth * point.own_std / point.work if point.work > 0 else 0.0
