"""Limits of a level or an indicator, learned from the machine's own first windows under one operating condition.

    ln L = ln m + k·s,      s = 1.4826·median |ln x − ln m|,      k = t(1 − p; ν)·√(1 + π/(2n)),      ν = 0.37·(n − 1)

L   limit                                                      [unit of x]
x   the quantity in the n windows, taken as healthy; positive   [its unit]
m   their median                                               [unit of x]
s   robust standard deviation of ln x
p   probability that a further healthy window lies beyond L
t   quantile of Student's distribution with ν degrees of freedom

Source   prediction limit of a normal sample (ISO 16269-8) with median and MAD in place of mean and standard deviation:
         the median has the variance π/(2n)·s², the MAD an efficiency of 0.37 (P. J. Rousseeuw, C. Croux, J. Am. Stat.
         Assoc. 88 (1993) 1273). tests/claims/test_learned_limits.py compares p with the rate of simulated windows.
Holds    a quantity whose healthy scatter is log-normal and not correlated from window to window
Ignores  a drift of the healthy machine, and whether the machine was healthy while the limit was learned
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log, pi, sqrt

import numpy as np

from twin.thresholds import deciding

MAD_TO_STD = 1.4826
MAD_EFFICIENCY = 0.37


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedLimits:
    """When a learned level is exceeded."""

    windows: int = deciding(
        10,
        meaning="healthy windows under one operating condition from which its limits are learned",
        source="not derived: chosen; with 10 windows the limits lie 9.5 and 19 robust standard deviations above the "
        "median, with 5 they would lie 63 and 297 above",
    )
    watch_rate: float = deciding(
        1e-3,
        meaning="share of healthy windows beyond the watch limit",
        source="not derived: chosen; one false watch in 1000 windows, before the duration is applied",
    )
    alarm_rate: float = deciding(
        1e-4,
        meaning="share of healthy windows beyond the alarm limit",
        source="not derived: chosen; one false alarm in 10,000 windows, before the duration is applied",
    )
    watch_ratio: float = deciding(
        1.25,
        meaning="least ratio of the watch limit to the healthy median",
        source="standard: ISO 20816-1, criterion II, calls a change by a quarter of a zone's limit significant",
    )
    alarm_ratio: float = deciding(
        2.0,
        meaning="least ratio of the alarm limit to the healthy median",
        source="not derived: chosen as a doubling (6 dB)",
    )
    same_speed: float = deciding(
        0.1,
        of="speed of an operating condition",
        meaning="difference up to which a window is of that condition",
        source="not derived: chosen so that resonances are passed by little within a condition",
    )
    same_torque: float = deciding(
        0.15,
        of="torque of an operating condition",
        meaning="difference up to which a window is of that condition",
        source="not derived: chosen so that a drive which holds its set point within some per cent is recognised",
    )


DEFAULT = LearnedLimits()


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Two limits of one quantity under one operating condition."""

    median: float  # of the healthy windows
    scatter: float  # s, of the logarithm
    watch: float
    alarm: float
    windows: int


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatingPoint:
    """Speed and torque of a window; None where they are not known."""

    speed: float | None  # of the pinion [Hz]
    torque: float | None  # [N·m]

    def matches(self, other: OperatingPoint, limits: LearnedLimits = DEFAULT) -> bool:
        """Whether both are the same operating condition."""
        return _near(self.speed, other.speed, limits.same_speed) and _near(
            self.torque, other.torque, limits.same_torque
        )


def deviations(windows: int, rate: float) -> float:
    """k: how many robust standard deviations a limit with a false-alarm rate lies above the median."""
    from scipy.special import stdtrit  # loads scipy, which a start of the service does without

    return float(stdtrit(MAD_EFFICIENCY * (windows - 1), 1 - rate)) * sqrt(1 + pi / (2 * windows))


def learned(values: Sequence[float], limits: LearnedLimits = DEFAULT) -> Limits | None:
    """The limits from healthy windows (n,); None where there are too few, or not all are positive."""
    x = np.asarray(values, dtype=float)
    if x.size < limits.windows or not (np.isfinite(x).all() and (x > 0).all()):
        return None
    logs = np.log(x)
    middle = float(np.median(logs))
    scatter = MAD_TO_STD * float(np.median(np.abs(logs - middle)))
    ends = [
        exp(middle + max(deviations(x.size, rate) * scatter, log(ratio)))
        for rate, ratio in ((limits.watch_rate, limits.watch_ratio), (limits.alarm_rate, limits.alarm_ratio))
    ]
    return Limits(median=exp(middle), scatter=scatter, watch=ends[0], alarm=ends[1], windows=int(x.size))


def _near(a: float | None, b: float | None, share: float) -> bool:
    if a is None or b is None:
        return a is None and b is None
    return abs(a - b) <= share * max(abs(a), abs(b))
