"""The wear coefficient as the slope of depth over revolutions.

Depth becomes work x = x(d) of the master curve, which is linear in revolutions at a constant wear coefficient:

    x_{j+1} = x_j + κ_j·ΔN + w_x,      κ_{j+1} = κ_j·(1 + w_κ),      z_j = x_j + v_j,      κ = K·τ·ω1

A Kalman filter over the windows gives κ with its uncertainty. It allows κ to wander by RATE.drift from window to
window; where a window lies beyond RATE.surprise standard deviations of what that allows (running-in takes κ down by
half within thousands of revolutions), the interval is computed again with RATE.running_in instead.

Source   R. E. Kalman, J. Basic Eng. 82 (1960) 35–45
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class RateDrift:
    """How the wear rate κ may change."""

    drift: float = deciding(
        0.04,
        of="the wear rate κ",
        meaning="change from one window to the next, one standard deviation",
        source="not derived: how far a wear coefficient wanders while nothing is seen to change",
    )
    running_in: float = deciding(
        0.25,
        of="the wear rate κ",
        meaning="the same where the rate is seen to change",
        source="not derived: running-in takes the rate down by half within thousands of revolutions",
    )
    surprise: float = deciding(
        3.0,
        of="standard deviation of the expected work",
        meaning="difference from which the rate is seen to change",
        source="derivation: three standard deviations, one window in 370 by chance",
    )
    prior: float = deciding(
        1.0,
        of="the rig file's wear coefficient",
        meaning="standard deviation of ln κ before the first worn window",
        source="not derived: a wear coefficient is known within a factor of about three",
    )
    least: float = deciding(
        1e-3,
        of="the wear rate κ before",
        meaning="smallest rate that one window may leave",
        source="not derived: keeps the rate positive; the rate of a machine that does not wear is not reported",
    )


RATE = RateDrift()


@dataclass(frozen=True, slots=True, kw_only=True)
class WearTrack:
    """Wear so far and its rate."""

    revolutions: float  # N of the latest window
    work: float  # x [rad/N]
    rate: float  # κ [rad/N per revolution], 0 before the first window
    var_work: float
    cov: float
    var_rate: float
    windows: int  # worn windows used
    steady: int = 0  # of them, since the rate was last seen to change

    @classmethod
    def unworn(cls, rate: float) -> WearTrack:
        """Nothing worn at revolution zero; κ as the rig file says, within a factor of about three."""
        return cls(
            revolutions=0.0, work=0.0, rate=rate, var_work=0.0, cov=0.0,
            var_rate=(RATE.prior * rate) ** 2, windows=0,
        )  # fmt: skip

    @property
    def rate_std(self) -> float:
        return float(np.sqrt(self.var_rate))

    @property
    def work_std(self) -> float:
        return float(np.sqrt(self.var_work))

    def predicted(self, revolutions: float, drift: float = RATE.drift) -> WearTrack:
        """The track carried on to a later revolution count; κ changes by `drift`, relative, on the way."""
        n = revolutions - self.revolutions
        wander = (drift * self.rate) ** 2 if self.windows else 0.0
        var_rate = self.var_rate + wander
        return replace(
            self,
            revolutions=revolutions,
            work=self.work + self.rate * n,
            var_work=self.var_work + 2 * n * self.cov + n**2 * var_rate,
            cov=self.cov + n * var_rate,
            var_rate=var_rate,
        )

    def corrected(self, work: float, std: float) -> WearTrack:
        """The track after a measured work x [rad/N] with its standard deviation."""
        s = self.var_work + std**2
        gain_x, gain_κ = self.var_work / s, self.cov / s
        surprise = work - self.work
        rate = self.rate + gain_κ * surprise
        return replace(
            self,
            work=self.work + gain_x * surprise,
            rate=max(rate, RATE.least * self.rate),
            var_work=(1 - gain_x) * self.var_work,
            cov=(1 - gain_x) * self.cov,
            var_rate=self.var_rate - gain_κ * self.cov,
            windows=self.windows + 1,
            steady=self.steady + 1,
        )

    def followed(self, revolutions: float, work: float, std: float) -> WearTrack:
        """The track after a window at which a work x [rad/N] was measured."""
        ahead = self.predicted(revolutions)
        if self.windows and abs(work - ahead.work) > RATE.surprise * float(np.hypot(ahead.work_std, std)):
            ahead = replace(self.predicted(revolutions, RATE.running_in), steady=0)
        return ahead.corrected(work, std)

    def first_seen(self, revolutions: float, work: float, std: float) -> WearTrack:
        """The track of flanks of unknown age after their first window: its work x [rad/N] says nothing of the rate."""
        return replace(
            self, revolutions=revolutions, work=work, var_work=std**2, cov=0.0, windows=1, steady=1
        )  # fmt: skip

    def rescaled(self, factor: float) -> WearTrack:
        """The same depth history on another curve, whose work at the present depth is `factor` times this one's."""
        return replace(
            self,
            work=self.work * factor,
            rate=self.rate * factor,
            var_work=self.var_work * factor**2,
            cov=self.cov * factor**2,
            var_rate=self.var_rate * factor**2,
        )
