"""A limit on raw RMS and kurtosis beside every comparison with a baseline: what anybody can compute.

    |y − ȳ| > t·s·√(1 + 1/n)        t of Student's distribution with n − 1 degrees of freedom, at α/(2·M)

y   logarithm of the RMS, or of the kurtosis, of one accelerometer; ȳ, s their mean and standard deviation over the
    healthy windows
n   healthy recordings: windows of one source, day and load are one
M   measures, two of each accelerometer
α   false alarms that are meant, of all measures together: half of those of a verdict

Nothing of the machine enters: neither shafts nor load, and sensors at their rail, too. Where healthy recordings that
are left out in turn exceed the limit, it is raised as every other one (repeats.py).

Source   prediction interval of a normal sample; correction of Bonferroni
Holds    recordings inside the operating points that were learned
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from twin.assessment import RawLimit, RawMeasure
from twin.baseline.learned import Baseline
from twin.baseline.operating import DEFAULT as OPERATING
from twin.baseline.operating import distance_beyond
from twin.baseline.reading import WindowReading
from twin.baseline.recordings import recording_of
from twin.baseline.repeats import DEFAULT, RAW

NAMES = ("rms", "kurtosis")
LEAST_SCATTER = 1e-6  # of a logarithm, below which values are the same


@dataclass(frozen=True, slots=True, kw_only=True)
class _Learned:
    """One measure of one accelerometer over the healthy recordings."""

    channel: str
    name: str  # of `NAMES`
    mean: float  # of the logarithm
    reach: float  # from it to the limit

    def over(self, values: Sequence[float]) -> float:
        """Distance of the median of windows' values from the mean, over that of the limit."""
        return abs(float(np.median(np.log(values))) - self.mean) / self.reach


Raw = Mapping[str, tuple[float, float]]  # RMS and kurtosis by accelerometer (`WindowReading.raw`)


def raw_limit(baseline: Baseline, windows: Sequence[WindowReading]) -> RawLimit:
    """The raw measures of a recording's windows beside their limits; none beyond the learned operating points."""
    points = np.array([baseline.operating_point(r) for r in baseline.readings])
    if all(distance_beyond(points, baseline.operating_point(r)) > OPERATING.far for r in windows):
        beyond = "the operating point lies beyond those of the healthy recordings"
        return RawLimit(measures=(), false_alarms=DEFAULT.half, not_compared=beyond)
    return limit_on(baseline, [r.raw for r in windows])


def limit_on(baseline: Baseline, windows: Sequence[Raw], meant: float = DEFAULT.half) -> RawLimit:
    """Raw measures of windows of any load beside their limits, for so many false alarms."""
    factor = baseline.repeats.factor(RAW)
    learned = _learned(baseline, meant)
    reason = _reason(learned, factor)
    if reason:
        return RawLimit(measures=(), false_alarms=meant, not_compared=reason)
    measures = []
    for one in learned:
        values = [raw[one.channel][NAMES.index(one.name)] for raw in windows if one.channel in raw]
        if not values or min(values) <= 0:
            continue
        low, high = (float(np.exp(one.mean + sign * one.reach * factor)) for sign in (-1, 1))
        value = float(np.median(values))
        measures.append(
            RawMeasure(
                channel=one.channel, name=one.name, value=value, low=low, high=high, beyond=not low <= value <= high
            )
        )
    return RawLimit(measures=tuple(measures), false_alarms=meant)


def raw_over(baseline: Baseline, windows: Sequence[WindowReading]) -> float | None:
    """The measure of some windows that is most over its limit, none of it raised; None where there is no limit."""
    found = []
    for one in _learned(baseline, DEFAULT.half):
        values = [r.raw[one.channel][NAMES.index(one.name)] for r in windows if one.channel in r.raw]
        if values and min(values) > 0:
            found.append(one.over(values))
    return max(found, default=None)


def _learned(baseline: Baseline, false_alarms: float) -> list[_Learned]:
    """Every measure that all healthy windows have; none with too few recordings."""
    count = len(set(recording_of(baseline.readings)))
    channels = set.intersection(*(set(r.raw) for r in baseline.readings))
    if count < DEFAULT.least_recordings or not channels:
        return []
    t = float(-stdtrit(count - 1, false_alarms / (2 * len(NAMES) * len(channels))))
    out = []
    for channel in sorted(channels):
        for i, name in enumerate(NAMES):
            values = np.array([r.raw[channel][i] for r in baseline.readings])
            if values.min() > 0:
                y = np.log(values)
                scatter = max(float(y.std(ddof=1)), LEAST_SCATTER)
                reach = t * scatter * np.sqrt(1 + 1 / count)
                out.append(_Learned(channel=channel, name=name, mean=float(y.mean()), reach=float(reach)))
    return out


def _reason(learned: Sequence[_Learned], factor: float) -> str:
    """Why there is no limit; empty where there is one."""
    if not learned:
        return f"fewer than {DEFAULT.least_recordings} healthy recordings with raw levels give no limit"
    if not np.isfinite(factor):
        return "most healthy recordings, left out, exceed the limit that the others give"
    return ""
