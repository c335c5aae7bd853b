"""Single samples that no sensor can have measured: errors of transmission or of the converter.

    d_i = |x_i − median x|,   s = 1.4826 · median d    (the standard deviation of normal data with this median)
    a spike: d_i > k·s for one or two samples in a row, while the sample before and the one behind lie below q·d_i

Source   F. R. Hampel, J. Am. Stat. Assoc. 69 (1974) 383–393 (median and median deviation as centre and scale)
Holds    a signal behind an anti-aliasing filter: one that passes up to 0.45 of the sampling rate leaves at least
         sinc(0.9) = 0.11 of the peak of any event in the samples beside it
Ignores  errors that last for three samples and more: the sensor's range finds those
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.compiled.statistics import all_near, middle
from twin.thresholds import deciding

NORMAL = 1.4826  # standard deviation of normal data over their median distance from the median
ROUNDING = 1e-9
FEWEST = 16  # finite samples from which a scale can be told


@dataclass(frozen=True, slots=True, kw_only=True)
class SpikeThresholds:
    """From when on a sample is a spike."""

    deviations: float = deciding(
        30.0,
        of="robust standard deviation of the record",
        meaning="distance k from the median",
        source="not derived: chosen so that the remaining spikes move the mean of 1000 samples by less than 3 % of "
        "their standard deviation",
    )
    neighbour: float = deciding(
        0.05,
        of="the spike's distance from the median",
        meaning="largest distance q of the samples next to a spike",
        source="derivation: below half of sinc(0.9) = 0.11, what an anti-aliasing filter passes next to any event",
    )
    longest: int = deciding(
        2,
        unit="samples",
        meaning="longest spike",
        source="not derived: one damaged value of a transmission, or two where it was interpolated",
    )


DEFAULT = SpikeThresholds()


def spikes(values: np.ndarray, thresholds: SpikeThresholds = DEFAULT) -> np.ndarray:
    """Which samples are spikes; values (n,), NaN where missing → (n,) bool."""
    found = np.zeros(values.size, dtype=bool)
    if all_near(values, thresholds.deviations * NORMAL * (1 - ROUNDING)):
        return found
    record = middle(values)
    if record.finite < FEWEST:
        return found
    scale = NORMAL * record.deviation
    if scale == 0:  # most samples are equal: steps of the converter are no spikes
        steps = np.diff(np.unique(values[np.isfinite(values)]))
        scale = float(steps.min()) if steps.size else 0.0
    if max(record.high - record.median, record.median - record.low) <= thresholds.deviations * scale:
        return found
    distance = np.abs(values - record.median)
    distance[~np.isfinite(values)] = 0.0
    places = np.flatnonzero(distance > thresholds.deviations * scale)
    for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1):
        if 0 < run.size <= thresholds.longest:
            beside = [i for i in (run[0] - 1, run[-1] + 1) if 0 <= i < values.size]
            if max(distance[beside]) <= thresholds.neighbour * distance[run].min():
                found[run] = True
    return found


def without_spikes(values: np.ndarray, thresholds: SpikeThresholds = DEFAULT) -> np.ndarray:
    """The values (n,) with spikes as NaN; the very same array where there are none."""
    found = spikes(values, thresholds)
    if not found.any():
        return values
    return np.where(found, np.nan, values)
