"""When a depth or a life is established, and what earlier windows had established of the same gears.

A machine whose depth was established, and that then wears beyond what the model predicts well, is not one of which
nothing is known. Its earlier windows support a depth that is only preliminary now, where

    d ≤ d_h + g·(d_e/N_e)·(N − N_e)

d, N           depth  [m] and revolutions of the pinion now
d_e, d_h, N_e  depth, its 95th percentile and revolutions at the latest window whose depth was established
g              factor by which wear may have grown faster since, and still be the wear of before

and where what speaks against the depth now says nothing against the windows of then (`Ground.arisen`, twin/grounds.py).

Holds    for one set of gears and one rig file: others begin a new history
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from math import log

from twin.assessment import EstablishedBefore
from twin.quantiles import Z95
from twin.rig import Rig
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class EstablishedLimits:
    """What an established depth or life demands, beyond what the verdict on the residual does (VerdictLimits)."""

    other_machine: float = deciding(
        9.0,
        meaning="misfit of a calibration by the acceleration alone from which the model is not one of this machine",
        source="convention: the lines of the unworn gears differ by three times their scatter; with the channels of a "
        "tachometer the calibrations of D00–D13 leave at most 4.6, and 44 in D03, whose depth is then wrong as well",
    )
    other_gears: float = deciding(
        25.0,
        meaning="misfit of the encoders' mesh lines from which, without an unworn window to subtract, the model is not "
        "one of these gears",
        source="convention: the lines differ by five times their standard deviation",
    )
    unreachable: float = deciding(
        0.5,
        of="measured level",
        meaning="difference of the predicted level that no wear coefficient removes, from which the model is not one "
        "of this machine",
        source="reference campaigns with the channels of a tachometer: at most 0.22 in worn windows",
    )
    level_rise: float = deciding(
        0.5,
        of="level of the unworn gears at the same speed and torque",
        meaning="rise of the vibration level from which it shows wear",
        source="not derived: a changed sensor, mount or drive makes some tens of per cent; the levels of D00-D13 have "
        "risen by half at 6 to 24 µm",
    )
    least_worn_windows: int = deciding(
        3,
        unit="windows",
        meaning="worn windows at one wear rate from which it is established",
        source="derivation: two windows give a rate, the third tests it",
    )
    young_rate: float = deciding(
        log(2) / Z95,
        of="remaining life",
        meaning="standard deviation of its logarithm with fewer worn windows than that",
        source="derivation: the rate may still halve while the gears run in (RateDrift.running_in)",
    )
    doubtful_low: float = deciding(
        0.5,
        of="the depth by the encoders where the calibration is in doubt",
        meaning="5 % quantile of the true depth",
        source="D00–D13 without attribution, 36 doubtful windows of 5 campaigns: 0.74, the least 0.53; rounded down",
    )
    doubtful_high: float = deciding(
        1.25,
        of="the depth by the encoders where the calibration is in doubt",
        meaning="95 % quantile of the true depth",
        source="as doubtful_low: 1.01, the largest 1.10; rounded up",
    )
    doubtful_misfit: float = deciding(
        10.0,
        meaning="misfit of the encoders' mesh lines up to which doubtful_low and doubtful_high hold as they are",
        source="the largest of 26 windows beyond the limit of doubt, worn by over 2 µm, in D03, D06, D07, D10 and D11 "
        "without attribution (9.6, rounded up)",
    )
    uncalibrated_level: float = deciding(
        2.0,
        of="variance of the logarithm of a depth by the level",
        meaning="its variance where no unworn window has calibrated the level",
        source="derivation: the level of a structure within its tolerance scatters by 0.35 (CalibrationFit."
        "level_scatter), as much as the depth from a calibrated level (LifeSpread.rms_spread)",
    )

    history_windows: int = deciding(
        3,
        unit="windows",
        meaning="worn windows with an established depth from which they support a later one that is preliminary",
        source="derivation: two windows give a rate, the third tests it",
    )
    history_growth: float = deciding(
        2.0,
        of="mean wear depth per turn until the depth was last established",
        meaning="wear depth per turn since then up to which the earlier windows support the present depth",
        source="not derived: a wear rate changes by up to a factor of two (running-in); a misalignment that was not in "
        "the model made depths up to 88 % too large at once",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HysteresisLimits:
    """When a doubt by a quantity that scatters begins and ends."""

    windows: int = deciding(
        3,
        unit="windows",
        meaning="latest windows of which the majority judges the error on held-out windows",
        source="derivation: every third window is held out, and each joins with an error that the next trace lowers "
        "(0.44 to 0.12 and 0.66 to 0.41 in the published campaign)",
    )
    release: float = deciding(
        0.75,
        of="the limit of a misfit of mesh lines, of an error on held-out windows, or of a level that is not reached",
        meaning="value below which a doubt ends",
        source="D00, D03-D05, D07, D10, D12, D13 and the published campaign, one standard deviation of the change from "
        "window to window: 0.77 for mesh lines (19 pairs), 0.72 for the acceleration of held-out windows (31 pairs)",
    )
    rate_release: float = deciding(
        1.25,
        of="the rate from which wear is measurable (LifeScatter.measurable)",
        meaning="wear rate from which a doubt of it ends",
        source="not derived: as release",
    )
    level_release: float = deciding(
        1.25,
        of="the rise from which a level shows wear (EstablishedLimits.level_rise)",
        meaning="rise from which a doubt of it ends",
        source="not derived: as release",
    )


LIMITS, HYSTERESIS = EstablishedLimits(), HysteresisLimits()


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubts:
    """Which quantities that scatter from window to window are in doubt, and their latest values (twin/noisy.py)."""

    effects: tuple[str, ...] = ()  # in the model that they were compared with
    values: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    raised: tuple[str, ...] = ()  # names of those in doubt


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """Which windows of these gears had an established depth, and what is in doubt; plain serialisable data."""

    rig: str = ""  # which rig file they were judged with
    latest: int = -1  # index of the latest of them
    windows: int = 0
    revolutions: float = 0.0  # of the pinion at the latest of them
    depth: float = 0.0  # there [m]
    depth_high: float = 0.0  # its 95th percentile [m]
    doubts: Doubts = field(default_factory=Doubts)  # at the latest window

    def of_rig(self, rig: Rig) -> History:
        """The history where it was made with this rig file, else an empty one."""
        identity = identity_of(rig)
        return self if self.rig == identity else History(rig=identity)

    def with_window(self, index: int, revolutions: float, depth: float, depth_high: float) -> History:
        """The history with one more window whose depth is established; each window counts once."""
        if index <= self.latest:
            return self
        return replace(
            self, latest=index, windows=self.windows + 1, revolutions=revolutions, depth=depth, depth_high=depth_high
        )  # fmt: skip

    def supports(
        self, depth: float, revolutions: float, limits: EstablishedLimits = LIMITS
    ) -> EstablishedBefore | None:
        """What the earlier windows say for a depth now that is preliminary; None where they do not support it."""
        if self.windows < limits.history_windows or not self.revolutions > 0:
            return None
        grown = limits.history_growth * self.depth / self.revolutions * max(revolutions - self.revolutions, 0.0)
        if depth > self.depth_high + grown:
            return None
        return EstablishedBefore(windows=self.windows, revolutions=self.revolutions, depth=self.depth)


def identity_of(rig: Rig) -> str:
    """What a rig file is recognised by."""
    return sha256(rig.text.encode()).hexdigest()[:16]
