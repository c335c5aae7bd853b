"""Remaining useful life to the rig's end-of-life depth, at the present condition.

    N = (x(d_end) − x(d))/κ

Where windows measured depths by encoders, N is a mixture over the histories that the rate may have had
(wear_forecast.py), each log-normal: what is known of κ and x, how much κ wanders, what all depths may be off together.
Otherwise it is one log-normal of the track, and κ wanders by what is assumed. Either is wider by the shape of the
curve: flanks wear by dynamic forces that the twin does not know well, which leaves a depth off by a share of s·d,

    var = (s·(x'(d_end)·d_end² − x'(d)·d²))²

All depths off by a factor 1 + ε scale x and κ alike and leave N off by ε·x(d_end)/κ, which matters near the end. Once
the end is reached, what is left of the band is the chance that it is not.

Once the teeth part for some of the mesh, the steady state hangs on damping and clearances that no window has shown
yet, and with it how fast the deepest point wears. The truth is assumed between two answers, the curve as computed and
the rate held that the curve has where contact is first lost: their geometric mean is the median, half the
logarithm of their ratio its standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log, pi, sqrt
from statistics import NormalDist
from typing import Protocol

import numpy as np
from scipy.special import ndtr

from twin.quantiles import Z95
from twin.roots import rising_roots
from twin.thresholds import deciding
from twin.updating.depth import DEPTH
from twin.updating.tracker import RATE, WearTrack
from twin.updating.wear_forecast import WearForecast

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

    extrapolated: float = deciding(
        0.15,
        of="work beyond the last steady state",
        meaning="standard deviation of the part of a life that is extrapolated",
        source="not derived: some of the steady state's shape is lost with it",
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
FARTHEST = 8.0  # standard normal score between which a quantile is sought
LEAST_SPREAD = 1e-9  # of ln N


def through_contact_loss(curve: WorkCurve, depth: float, end_depth: float) -> tuple[float, float]:
    """What contact loss adds to the curve's work between two depths [rad/N], and its standard deviation."""
    if curve.loss_from is None or end_depth <= max(curve.loss_from, depth):
        return 0.0, 0.0
    onset = max(curve.loss_from, depth)
    along = curve.work_at(end_depth) - curve.work_at(onset)
    held = curve.work_per_depth(curve.loss_from) * (end_depth - onset)
    middle = float(np.sqrt(along * held))
    return middle - along, 0.5 * abs(float(np.log(held / along))) * middle


def shape_std(curve: WorkCurve, depth: float, end_depth: float) -> float:
    """What the work between two depths [rad/N] is uncertain by for the shape of the profile (depth.py)."""
    now, then = (curve.work_per_depth(d) * d**2 for d in (depth, end_depth))
    return DEPTH.shape_stated * abs(then - now)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LifeMixture:
    """A mixture of log-normal lives, (m,) each."""

    weights: np.ndarray  # their sum is 1
    medians: np.ndarray  # revolutions
    spreads: np.ndarray  # standard deviation of ln N

    def reached(self, revolutions: float) -> float:
        """The probability that no more than so many revolutions are left."""
        return float(self._reached(np.array([log(revolutions)]))[0][0])

    def at(self, scores: np.ndarray) -> np.ndarray:
        """The revolutions left at standard normal scores (n,)."""
        middles, probabilities = np.log(self.medians), ndtr(scores)
        middle, reach = float(self.weights @ middles), FARTHEST * self.spreads
        low, high = float((middles - reach).min()), float((middles + reach).max())
        std = sqrt(float(self.weights @ (self.spreads**2 + (middles - middle) ** 2)))

        def excess(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            reached, density = self._reached(logs)
            return reached - probabilities, density

        return np.exp(rising_roots(excess, np.clip(middle + std * scores, low, high), low, high))

    def _reached(self, logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Probability that no more than some revolutions are left, and its slope, by their logarithms (n,); (n,)."""
        spreads = np.maximum(self.spreads, LEAST_SPREAD)
        scores = (logs[:, None] - np.log(self.medians)) / spreads
        return ndtr(scores) @ self.weights, np.exp(-0.5 * scores**2) @ (self.weights / (spreads * sqrt(2 * pi)))


@dataclass(frozen=True, slots=True, kw_only=True)
class RemainingLife:
    """Pinion revolutions to the end-of-life depth, as a distribution."""

    to_go: float  # work still to go [rad/N], negative beyond the end
    rate: float  # κ [rad/N per revolution]
    rate_std: float
    end_std: float = 0.0  # of the work still to go, where the end is reached [rad/N]
    spread: float = 0.0  # standard deviation of ln N, where the life is log-normal
    reached: bool = False  # the depth is already beyond the criterion
    mixture: LifeMixture | None = None  # None where the life is one log-normal about to_go/rate
    measurable: bool = True  # False where no wear rate is measurable: then p05 alone holds, the others are infinite

    @property
    def median(self) -> float:
        return float(self.at(np.zeros(1))[0])

    @property
    def p05(self) -> float:
        return float(self.at(np.array([-Z95]))[0])

    @property
    def p95(self) -> float:
        return float(self.at(np.array([Z95]))[0])

    def at(self, scores: np.ndarray) -> np.ndarray:
        """The revolutions left at standard normal scores (n,); infinite where there is no bound."""
        if self.reached:
            return np.maximum(0.0, (self.to_go + scores * self.end_std) / self.rate)
        if not self.measurable:
            bound = scores < 1e-3 - Z95
            return np.where(bound, self.to_go / (self.rate - np.where(bound, scores, -Z95) * self.rate_std), inf)
        if self.mixture is not None:
            return self.mixture.at(scores)
        return self.to_go / self.rate * np.exp(scores * self.spread)

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
        if self.mixture is not None:
            return 1 - self.mixture.reached(revolutions)
        return 1 - NORMAL.cdf(log(revolutions * self.rate / self.to_go) / self.spread)


def remaining_life(
    track: WearTrack,
    curve: WorkCurve,
    base_work: float,
    end_depth: float,
    common_scatter: float | None = 0.0,
    rate_doubt: float = 0.0,
    forecast: WearForecast | None = None,
    scatter: LifeScatter = LIFE,
) -> RemainingLife:
    """Life of a track on a curve whose work starts at `base_work`, to a depth [m].

    Where the wear rate cannot be distinguished from zero, only the least life is stated: that at the rate's 95 %
    quantile.

    common_scatter  relative standard deviation of what all depths are off by together; None where the track's own
                    covariance holds it
    rate_doubt      relative standard deviation of the rate beyond that of the track
    forecast        histories of the rate; `common_scatter` is then what their own shared errors do not hold
    """
    together, common = 0.0, common_scatter
    if common is None:
        together, common = 2 * track.cov, 0.0
    end = base_work + curve.work_at(end_depth)
    to_go = end - track.work
    if to_go <= 0:
        end_std = float(np.hypot(common * end, track.work_std))
        return RemainingLife(to_go=to_go, rate=track.rate, rate_std=track.rate_std, end_std=end_std, reached=True)
    depth = curve.depth_at(track.work - base_work)
    added, unsure = through_contact_loss(curve, depth, end_depth)
    to_go += added
    if track.rate <= scatter.measurable * track.rate_std:
        return RemainingLife(to_go=to_go, rate=track.rate, rate_std=track.rate_std, measurable=False)
    beyond = (
        max(0.0, end - max(track.work, base_work + curve.work_at(min(curve.valid_within(end_depth), end_depth))))
        / to_go
    )
    of_curve = (
        rate_doubt**2
        + (common * end / to_go) ** 2
        + (shape_std(curve, depth, end_depth) / to_go) ** 2
        + (scatter.extrapolated * beyond) ** 2
        + (unsure / to_go) ** 2
    )
    if forecast is not None:
        return RemainingLife(
            to_go=to_go, rate=track.rate, rate_std=track.rate_std, mixture=_mixture(forecast, end + added, of_curve)
        )
    relative = np.sqrt(
        of_curve
        + track.var_rate / track.rate**2
        + track.var_work / to_go**2
        + together / (to_go * track.rate)
        + (scatter.drifts * RATE.drift) ** 2
    )
    return RemainingLife(
        to_go=to_go, rate=track.rate, rate_std=track.rate_std, spread=float(np.sqrt(np.log1p(relative**2)))
    )


def _mixture(forecast: WearForecast, end: float, of_curve: float) -> LifeMixture:
    """The lives of the histories to a work; `of_curve` is the relative variance that all of them share."""
    lives = forecast.lives(end)
    spreads = np.sqrt(np.log1p(lives.relative**2 + of_curve))
    return LifeMixture(weights=lives.weights, medians=lives.median, spreads=spreads)
