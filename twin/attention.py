"""When a wear depth or a remaining life calls for attention.

    P(life ≤ x) = Φ(ln(x/m)/s),      s = ln(m/p05)/z95

m, p05  median and 5th percentile of the remaining life     [revolutions]
x       how far ahead is looked                              [revolutions]

Holds    a remaining life that is log-normal, as updating/remaining_life.py gives it
"""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, log, sqrt
from typing import TYPE_CHECKING

from twin.quantiles import Z95
from twin.thresholds import deciding

if TYPE_CHECKING:  # limits are settings of programs that compute nothing
    from twin.assessment import Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusLimits:
    """When a wear depth or a remaining life calls for attention."""

    horizon: float = deciding(
        0.1,
        of="revolutions run so far",
        meaning="how far ahead the end of life is looked for",
        source="not derived: chosen so that a tenth of the life so far is left to plan a repair",
    )
    horizon_time: float = deciding(
        0.0,
        unit="s",
        meaning="the same as a time of operation; the wider of the two counts",
        source="not derived: a setting of the user (GEAR_TWIN_LIFE_HORIZON_HOURS); 0 leaves the share of revolutions",
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


STATUS_LIMITS = StatusLimits()


@dataclass(frozen=True, slots=True, kw_only=True)
class Horizon:
    """How far ahead the end of life is looked for."""

    revolutions: float  # of the pinion
    time: float  # the same at the present speed [s]
    stated: bool  # whether the stated time is the wider; else the share of the revolutions run so far


def horizon_of(run: float | None, speed: float, limits: StatusLimits = STATUS_LIMITS) -> Horizon | None:
    """The wider of the share of the revolutions run so far and of the stated time; None where neither is known.

    run    pinion revolutions so far; None where they are not known
    speed  of the pinion at the present condition [Hz]
    """
    shared, stated = limits.horizon * (run or 0.0), limits.horizon_time * speed
    ahead = max(shared, stated)
    if ahead <= 0 or speed <= 0:
        return None
    return Horizon(revolutions=ahead, time=ahead / speed, stated=stated > shared)


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
