"""When a wear depth or a remaining life calls for attention.

    P(life ≤ x) = Φ(ln(x/m)/s),      s = ln(m/p05)/z95

m, p05  median and 5th percentile of the remaining life     [revolutions]
x       how far ahead is looked                              [revolutions]

Holds    a remaining life that is log-normal, as updating/remaining_life.py gives it
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import erf, log, sqrt
from typing import TYPE_CHECKING

from twin.quantiles import Z95
from twin.thresholds import deciding

if TYPE_CHECKING:  # limits are settings of programs that compute nothing
    from twin.assessment import Interval, Life
    from twin.rig import Rig

DAY = 86_400.0  # [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusLimits:
    """When a wear depth or a remaining life calls for attention."""

    horizon: float = deciding(
        30 * DAY,
        unit="s",
        meaning="how far ahead the end of life is looked for: calendar time, of running without a break where the "
        "running time per day is not known",
        source="not derived: chosen so that a month is left to plan a repair; the rig file's end_of_life.horizon_days "
        "and the setting GEAR_TWIN_LIFE_HORIZON_HOURS state another",
    )
    depth_share: float = deciding(
        0.8,
        of="wear depth at the end of life",
        meaning="wear depth from which the level is watch",
        source="not derived: chosen so that a fifth of the allowed depth is left to plan a repair",
    )
    possible: float = deciding(
        0.05,
        meaning="probability of reaching the end of life within the horizon from which the level is watch",
        source="derivation: the 5th percentile of the remaining life lies within the horizon",
    )
    probable: float = deciding(
        0.5,
        meaning="the same, from which the level is alarm",
        source="derivation: the median of the remaining life lies within the horizon",
    )

    def of_rig(self, rig: Rig) -> StatusLimits:
        """These limits, with the horizon that the rig file states."""
        days = rig.get("end_of_life.horizon_days")
        return self if days is None else replace(self, horizon=days * DAY)


STATUS_LIMITS = StatusLimits()


def revolutions_ahead(life: Life, limits: StatusLimits = STATUS_LIMITS) -> float:
    """Revolutions of the pinion within the horizon, at the speed of the life.

    The share of the time that the machine runs is the stated or the observed one; 1 where neither is known.
    """
    return limits.horizon * getattr(life.date, "running_share", 1.0) * life.speed


def probability_within(life: Interval, ahead: float) -> float:
    """The probability that a remaining life, log-normal with this median and 5th percentile, is at most `ahead`.

    Where only a lower bound is known, that is the 5th percentile: 0.05 beyond it, 0 before.
    """
    if ahead <= 0:
        return 0.0
    if life.median is None:
        return 0.05 if ahead >= life.p05 else 0.0
    if not 0 < life.p05 < life.median:
        return float(life.median <= ahead)
    spread = log(life.median / life.p05) / Z95
    return 0.5 * (1 + erf(log(ahead / life.median) / (spread * sqrt(2))))
