"""Remaining useful life to the rig's end-of-life depth, at the present condition.

    N = (x(d_end) − x(d))/κ

The band is that of a log-normal N: what is known of κ and x from the windows so far, how much κ wandered from window
to window, what all depths may be off together, and the shape of the curve where it had to be extrapolated. All depths
off by a factor 1 + ε scale x and κ alike and leave N off by ε·x(d_end)/κ, which matters near the end. Once the end is
reached, what is left of the band is the chance that it is not.

Once the teeth part for some of the mesh, the steady state hangs on damping and clearances that no window has shown
yet, and with it how fast the deepest point wears. The truth is assumed between two answers, the curve as computed and
the rate held that the curve has where contact is first lost: their geometric mean is the median, half the
logarithm of their ratio its standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.quantiles import Z95
from twin.thresholds import deciding
from twin.updating.tracker import RATE, WearTrack
from twin.wear.curve import MasterCurve


@dataclass(frozen=True, slots=True, kw_only=True)
class LifeScatter:
    """What a remaining life is uncertain by, beyond the track of wear, and when there is none to state."""

    curve: float = deciding(
        0.05,
        of="work still to go",
        meaning="standard deviation by the shape of the curve",
        source="not derived: structure and damping within their tolerance shape the curve",
    )
    extrapolated: float = deciding(
        0.15,
        of="work beyond the last steady state",
        meaning="standard deviation of the part of a life that is extrapolated",
        source="not derived: three times that of the computed curve",
    )
    drifts: float = deciding(
        2.0,
        of="drift of the wear rate from window to window",
        meaning="standard deviation of the rate over the life to come",
        source="not derived: the rate goes on to wander as it did",
    )
    measurable: float = deciding(
        Z95,
        of="standard deviation of the wear rate",
        meaning="wear rate from which wear is measurable: below it a life has no upper bound",
        source="derivation: the 5 % quantile of the rate is then zero",
    )


LIFE = LifeScatter()


def _through_contact_loss(curve: MasterCurve, depth: float, end_depth: float) -> tuple[float, float]:
    """What contact loss adds to the curve's work between two depths [rad/N], and its standard deviation."""
    if curve.loss_from is None or end_depth <= max(curve.loss_from, depth):
        return 0.0, 0.0
    onset = max(curve.loss_from, depth)
    along = curve.work_at(end_depth) - curve.work_at(onset)
    held = curve.work_per_depth(curve.loss_from) * (end_depth - onset)
    middle = float(np.sqrt(along * held))
    return middle - along, 0.5 * abs(float(np.log(held / along))) * middle


@dataclass(frozen=True, slots=True, kw_only=True)
class RemainingLife:
    """Pinion revolutions to the end-of-life depth."""

    median: float
    p05: float
    p95: float
    reached: bool  # the depth is already beyond the criterion
    measurable: bool = True  # False where no wear rate is measurable: then p05 alone holds, the others are infinite


def remaining_life(
    track: WearTrack,
    curve: MasterCurve,
    base_work: float,
    end_depth: float,
    common_scatter: float = 0.0,
    scatter: LifeScatter = LIFE,
) -> RemainingLife:
    """Life of a track on a curve whose work starts at `base_work`, to a depth [m].

    Where the wear rate cannot be distinguished from zero, only the least life is stated: that at the rate's 95 %
    quantile.

    common_scatter  relative standard deviation of what all depths are off by together
    """
    end = base_work + curve.work_at(end_depth)
    to_go = end - track.work
    if to_go <= 0:
        perhaps = to_go + Z95 * float(np.hypot(common_scatter * end, track.work_std))
        return RemainingLife(median=0.0, p05=0.0, p95=max(0.0, perhaps / track.rate), reached=True)
    added, unsure = _through_contact_loss(curve, curve.depth_at(track.work - base_work), end_depth)
    to_go += added
    if track.rate <= scatter.measurable * track.rate_std:
        least = to_go / (track.rate + Z95 * track.rate_std)
        return RemainingLife(median=float("inf"), p05=least, p95=float("inf"), reached=False, measurable=False)
    median = to_go / track.rate
    beyond = (
        max(0.0, end - max(track.work, base_work + curve.work_at(min(curve.valid_within(end_depth), end_depth))))
        / to_go
    )
    relative = np.sqrt(
        track.var_rate / track.rate**2
        + track.var_work / to_go**2
        + (common_scatter * end / to_go) ** 2
        + (scatter.drifts * RATE.drift) ** 2
        + scatter.curve**2
        + (scatter.extrapolated * beyond) ** 2
        + (unsure / to_go) ** 2
    )
    spread = float(np.exp(Z95 * np.sqrt(np.log1p(relative**2))))
    return RemainingLife(median=median, p05=median / spread, p95=median * spread, reached=False)
