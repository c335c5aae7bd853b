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
from math import exp, inf, log
from statistics import NormalDist
from typing import Protocol

import numpy as np

from twin.quantiles import Z95
from twin.thresholds import deciding
from twin.updating.tracker import RATE, WearTrack

NORMAL = NormalDist()


class WorkCurve(Protocol):
    """What a life reads of a wear curve: of one operating condition, or of several in turn."""

    @property
    def loss_from(self) -> float | None: ...

    def work_at(self, depth: float) -> float: ...

    def depth_at(self, work: float) -> float: ...

    def work_per_depth(self, depth: float) -> float: ...

    def valid_within(self, depth: float) -> float: ...


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


def through_contact_loss(curve: WorkCurve, depth: float, end_depth: float) -> tuple[float, float]:
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
    """Pinion revolutions to the end-of-life depth, as a distribution."""

    to_go: float  # work still to go [rad/N], negative beyond the end
    rate: float  # κ [rad/N per revolution]
    rate_std: float
    end_std: float = 0.0  # of the work still to go, where the end is reached [rad/N]
    spread: float = 0.0  # standard deviation of ln N, where the life is log-normal
    reached: bool = False  # the depth is already beyond the criterion
    measurable: bool = True  # False where no wear rate is measurable: then p05 alone holds, the others are infinite

    @property
    def median(self) -> float:
        return self.at(0.0)

    @property
    def p05(self) -> float:
        return self.at(-Z95)

    @property
    def p95(self) -> float:
        return self.at(Z95)

    def quantile(self, probability: float) -> float:
        """The revolutions that are left at most with a probability."""
        return self.at(NORMAL.inv_cdf(probability))

    def at(self, score: float) -> float:
        """The revolutions left at a standard normal score; infinite where there is no bound."""
        if self.reached:
            return max(0.0, (self.to_go + score * self.end_std) / self.rate)
        if not self.measurable:
            return self.to_go / (self.rate - score * self.rate_std) if score < 1e-3 - Z95 else inf
        return self.to_go / self.rate * exp(score * self.spread)

    def beyond(self, revolutions: float) -> float | None:
        """The probability that more than so many revolutions are left; None where only a lower bound is known."""
        if revolutions < 0:
            return 1.0
        if self.reached:
            return NORMAL.cdf((self.to_go - self.rate * revolutions) / self.end_std) if self.end_std > 0 else 0.0
        if not self.measurable:
            return None if revolutions > self.p05 else 0.95
        if revolutions == 0:
            return 1.0
        return 1 - NORMAL.cdf(log(revolutions * self.rate / self.to_go) / self.spread)


def remaining_life(
    track: WearTrack,
    curve: WorkCurve,
    base_work: float,
    end_depth: float,
    common_scatter: float | None = 0.0,
    rate_doubt: float = 0.0,
    scatter: LifeScatter = LIFE,
) -> RemainingLife:
    """Life of a track on a curve whose work starts at `base_work`, to a depth [m].

    Where the wear rate cannot be distinguished from zero, only the least life is stated: that at the rate's 95 %
    quantile.

    common_scatter  relative standard deviation of what all depths are off by together; None where the track's own
                    covariance holds it
    rate_doubt      relative standard deviation of the rate beyond that of the track
    """
    together, common = 0.0, common_scatter
    if common is None:
        together, common = 2 * track.cov, 0.0
    end = base_work + curve.work_at(end_depth)
    to_go = end - track.work
    if to_go <= 0:
        end_std = float(np.hypot(common * end, track.work_std))
        return RemainingLife(to_go=to_go, rate=track.rate, rate_std=track.rate_std, end_std=end_std, reached=True)
    added, unsure = through_contact_loss(curve, curve.depth_at(track.work - base_work), end_depth)
    to_go += added
    if track.rate <= scatter.measurable * track.rate_std:
        return RemainingLife(to_go=to_go, rate=track.rate, rate_std=track.rate_std, measurable=False)
    beyond = (
        max(0.0, end - max(track.work, base_work + curve.work_at(min(curve.valid_within(end_depth), end_depth))))
        / to_go
    )
    relative = np.sqrt(
        track.var_rate / track.rate**2
        + rate_doubt**2
        + track.var_work / to_go**2
        + together / (to_go * track.rate)
        + (common * end / to_go) ** 2
        + (scatter.drifts * RATE.drift) ** 2
        + scatter.curve**2
        + (scatter.extrapolated * beyond) ** 2
        + (unsure / to_go) ** 2
    )
    return RemainingLife(
        to_go=to_go, rate=track.rate, rate_std=track.rate_std, spread=float(np.sqrt(np.log1p(relative**2)))
    )
