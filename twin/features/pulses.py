"""Edge times of a shaft from the pulses of a tachometer, as an analog column of evenly sampled values.

    levels       threshold of the histogram's greatest variance between two classes (Otsu), then half way between the
                 medians of the two classes
    edges        the signal passes threshold + hysteresis/2 after it was below threshold − hysteresis/2;
                 t = t_j + (threshold − x_j)/(x_{j+1} − x_j)/rate, j the last sample at or below the threshold
    double       an edge after less than half the usual interval is left out: of a pair, the one without which the
                 intervals are more regular
    missed       an interval of k usual ones holds k − 1 edges that were missed; up to some of them are interpolated,
                 more are NaN
    toothed gap  with m missing teeth in a wheel of n, an interval of m + 1 once a turn is no fault; edge 0 is the first
                 after it

The usual interval is the running median of the intervals, which follows a run-up and is blind to single faults.

Source   N. Otsu, IEEE Trans. Syst. Man Cybern. 9 (1979) 62–66 (threshold);
         O. H. Schmitt, J. Sci. Instrum. 15 (1938) 24–26 (hysteresis)
Accuracy of an edge that rises over two samples or more: noise/slope; of one between two samples: half a sample
Limits   a speed that changes by less than a third from one pulse to the next
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from twin.errors import WindowError
from twin.thresholds import deciding

BINS = 256
CLIPPED = (0.02, 99.98)  # percentiles between which the histogram lies: single spikes are no level
SECOND_DIFFERENCE = 6**0.5  # standard deviation of x_{i−1} − 2x_i + x_{i+1} of white noise over that of x
GAUSSIAN = 1.4826  # standard deviation of Gaussian noise over its median absolute deviation


@dataclass(frozen=True, slots=True, kw_only=True)
class PulseThresholds:
    """When a column holds pulses, and which of its intervals are faults."""

    over_noise: float = deciding(
        8.0,
        meaning="height of the pulses over the noise from sample to sample, from which they are pulses",
        source="derivation: Gaussian noise on the lower level reaches the upper switching level, at 0.7 of the height, "
        "at 5.6 standard deviations, once in 10^8 samples",
    )
    least_alone: float = deciding(
        0.1,
        meaning="share of samples with both neighbours on their own level, from which they give the noise",
        source="not derived: chosen; pulses of fewer than six samples have hardly any such samples",
    )
    hysteresis: float = deciding(
        0.4,
        meaning="default hysteresis as a share of the pulses' height",
        source="not derived: chosen; leaves 30 % of the height to either level",
    )
    short: float = deciding(
        0.5,
        meaning="interval over the usual one below which an edge is doubled",
        source="derivation: half way between no edge and a regular one",
    )
    long: float = deciding(
        1.5,
        meaning="interval over the usual one above which an edge was missed",
        source="derivation: half way between a regular interval and one missed edge",
    )
    most_filled: int = deciding(
        3,
        meaning="missed edges in a row that are interpolated; more are left out",
        source="not derived: chosen",
    )
    most_faults: float = deciding(
        0.1,
        meaning="share of missed or doubled edges above which the column is refused",
        source="not derived: chosen; above it the pulses a turn or the threshold are more likely wrong than the signal",
    )


THRESHOLDS = PulseThresholds()
NEIGHBOURS = 11  # intervals that the running median is of
FEWEST_EDGES = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class PulseSettings:
    """How the pulses of a column are read."""

    per_rev: int = 1  # pulses a turn; of a toothed wheel with a gap its teeth with the missing ones
    threshold: float | None = None  # in the column's unit; None: from the histogram
    hysteresis: float | None = None  # in the column's unit; None: from the height of the pulses
    falling: bool = False  # which edge of a pulse counts
    missing_teeth: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pulses:
    """The edges of a tachometer's column."""

    times: np.ndarray  # (n,) rising [s]; NaN of a missed edge that is not interpolated
    threshold: float
    hysteresis: float
    low: float  # level between the pulses
    high: float  # level of the pulses
    first_index: int  # number of the first edge within its turn; 0 where no gap marks the turn
    missed: int  # edges, interpolated or NaN
    filled: int  # of these interpolated
    doubled: int  # edges left out
    speed: float  # mean [turns/s]


def pulses_of(values: np.ndarray, rate: float, settings: PulseSettings, limits: PulseThresholds = THRESHOLDS) -> Pulses:
    """The edges of a column of evenly sampled values (n,); WindowError where it holds no pulses."""
    x = np.asarray(values, dtype=float)
    low, high, noise, threshold = _levels(x, settings.threshold, limits)
    height = high - low
    if not height > limits.over_noise * noise:
        raise WindowError(
            f"no pulses stand out: the levels on either side of {threshold:.4g} are {low:.4g} and {high:.4g}, their "
            f"noise {noise:.3g}; the right column, or a threshold of your own?"
        )
    hysteresis = limits.hysteresis * height if settings.hysteresis is None else settings.hysteresis
    found = _crossings(-x if settings.falling else x, -threshold if settings.falling else threshold, hysteresis) / rate
    if found.size < FEWEST_EDGES:
        raise WindowError(
            f"{found.size} pulses pass {threshold:.4g} with a hysteresis of {hysteresis:.3g}; at least {FEWEST_EDGES} "
            f"are needed"
        )
    kept, doubled = _without_doubled(found, limits)
    times, gap, missed, filled = _with_missed(kept, limits, settings)
    faults = missed + doubled
    if faults > limits.most_faults * times.size:
        raise WindowError(
            f"{missed} pulses are missed and {doubled} doubled of {times.size}; threshold {threshold:.4g} with "
            f"hysteresis {hysteresis:.3g}, or a wheel with a gap (missing_teeth)?"
        )
    known = np.flatnonzero(np.isfinite(times))
    turns = (known[-1] - known[0]) / settings.per_rev
    return Pulses(
        times=times,
        threshold=threshold,
        hysteresis=hysteresis,
        low=low,
        high=high,
        first_index=0 if gap is None else (settings.per_rev - gap) % settings.per_rev,
        missed=missed,
        filled=filled,
        doubled=doubled,
        speed=float(turns / (times[known[-1]] - times[known[0]])),
    )


def _levels(x: np.ndarray, given: float | None, limits: PulseThresholds) -> tuple[float, float, float, float]:
    """Low and high level, the noise from sample to sample, and the threshold between the levels."""
    good = x[np.isfinite(x)]
    if good.size < FEWEST_EDGES or np.ptp(good) == 0:
        raise WindowError("the column is constant or empty: it holds no pulses")
    split = _otsu(good) if given is None else given
    below, above = good[good <= split], good[good > split]
    if below.size == 0 or above.size == 0:
        raise WindowError(
            f"the threshold {split:.4g} is outside the values, which go from {good.min():.4g} to {good.max():.4g}"
        )
    low, high = float(np.median(below)), float(np.median(above))
    return low, high, _noise(good, split, low, high, limits.least_alone), (low + high) / 2 if given is None else given


def _noise(x: np.ndarray, split: float, low: float, high: float, least_alone: float) -> float:
    """The noise on the levels, from three samples in a row on one; where pulses are too short for that, of each one."""
    upper = x > split
    alone = (upper[:-2] == upper[1:-1]) & (upper[1:-1] == upper[2:])
    if np.mean(alone) > least_alone:
        return GAUSSIAN * float(np.median(np.abs(np.diff(x, 2)[alone]))) / SECOND_DIFFERENCE
    return GAUSSIAN * float(np.median(np.abs(x - np.where(upper, high, low))))


def _otsu(x: np.ndarray) -> float:
    """The threshold with the greatest variance between the classes on either side of it."""
    least, most = np.percentile(x, CLIPPED)
    if most <= least:
        least, most = float(x.min()), float(x.max())
    count, edge = np.histogram(np.clip(x, least, most), bins=BINS)
    middle = 0.5 * (edge[1:] + edge[:-1])
    weight = np.cumsum(count) / x.size
    mean = np.cumsum(count * middle) / x.size
    with np.errstate(divide="ignore", invalid="ignore"):
        between = (mean[-1] * weight - mean) ** 2 / (weight * (1 - weight))
    between[~np.isfinite(between)] = 0.0
    best = np.flatnonzero(between >= between.max() * (1 - 1e-9))  # empty bins between the classes are equally good
    return float(0.5 * (edge[best[0] + 1] + edge[best[-1] + 1]))


def _crossings(x: np.ndarray, threshold: float, hysteresis: float) -> np.ndarray:
    """Samples, with fractions, at which the signal rises through the threshold (n,)."""
    place = np.arange(x.size)
    with np.errstate(invalid="ignore"):
        above, below = x > threshold + hysteresis / 2, x < threshold - hysteresis / 2
        under = x <= threshold
    decided = np.maximum.accumulate(np.where(above | below, place, -1))
    state = np.where(decided >= 0, above[decided], True)  # a pulse that is there at the start has no edge
    rise = np.flatnonzero(state[1:] & ~state[:-1]) + 1
    last = np.maximum.accumulate(np.where(under, place, -1))[rise]
    with np.errstate(invalid="ignore"):
        return last + (threshold - x[last]) / (x[last + 1] - x[last])


def _usual(interval: np.ndarray) -> np.ndarray:
    """The running median of the intervals."""
    return median_filter(interval, min(NEIGHBOURS, interval.size), mode="mirror")


def _without_doubled(times: np.ndarray, limits: PulseThresholds) -> tuple[np.ndarray, int]:
    """The edges without those that come too early, and how many these were; edges at lost samples are left out."""
    t, doubled = times[np.isfinite(times)], 0
    while t.size > FEWEST_EDGES:
        interval = np.diff(t)
        usual = _usual(interval)
        short = np.flatnonzero(interval < limits.short * usual)
        if short.size == 0:
            break
        i = int(short[0])
        drop = i + 1 if _irregular(t, i + 1, usual[i]) <= _irregular(t, i, usual[i]) else i
        t, doubled = np.delete(t, drop), doubled + 1
        if doubled > limits.most_faults * times.size + 1:
            break  # the caller refuses the column
    return t, doubled


def _irregular(t: np.ndarray, drop: int, usual: float) -> float:
    """How far from the usual interval those around an edge are without it."""
    around = np.diff(np.delete(t, drop)[max(drop - 2, 0) : drop + 2])
    return float(np.abs(around / usual - 1).sum())


def _with_missed(
    t: np.ndarray, limits: PulseThresholds, settings: PulseSettings
) -> tuple[np.ndarray, int | None, int, int]:
    """The edges with those that were missed; where in a turn the wheel's gap is; how many were missed and filled."""
    interval = np.diff(t)
    usual = _usual(interval)
    steps = np.where(interval > limits.long * usual, np.maximum(np.rint(interval / usual), 2), 1).astype(int)
    place = np.concatenate(([0], np.cumsum(steps)))
    of_gap = np.zeros(steps.size, dtype=bool)
    gap = None
    if settings.missing_teeth:
        wide = np.flatnonzero(steps == settings.missing_teeth + 1)
        after = place[wide + 1] % settings.per_rev  # of the first tooth after each gap
        if after.size == 0:
            raise WindowError(f"no gap of {settings.missing_teeth} missing teeth was found in {t.size} pulses")
        gap = int(np.bincount(after).argmax())
        of_gap[wide[after == gap]] = True
    most = max(limits.most_filled, settings.missing_teeth)
    out = np.full(int(place[-1]) + 1, np.nan)
    out[place] = t
    fill = np.flatnonzero((steps > 1) & (steps - 1 <= most))
    for i in fill:
        a, b = place[i], place[i + 1]
        out[a : b + 1] = np.linspace(t[i], t[i + 1], b - a + 1)
    missed = int((steps[~of_gap] - 1).sum())
    filled = int((steps[fill[~of_gap[fill]]] - 1).sum())
    return out, gap, missed, filled
