"""Whether a sensor's response to low frequencies explains what one shaft's lines have changed by.

    Y_n = g(f_n)·x_n,    g(f) = c₀ + c₁·ln f + c₂·ln² f, c complex      x the healthy lines of the shaft

A pulse that stands in the healthy machine, too, becomes another one by a smooth gain over its lines; one that is new
does not: there x_n is next to nothing.

Source   least squares; the corner of a high-pass filter or of a charge amplifier is one such curve
Holds    shafts with more strong lines than the curve has parameters
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.baseline.findings import BaselineComparison, ShaftChange
from twin.thresholds import deciding

PARAMETERS = 3  # of the curve


@dataclass(frozen=True, slots=True, kw_only=True)
class LowFrequencyThresholds:
    """When a sensor's low-frequency response explains a change as well."""

    explained: float = deciding(
        0.1, meaning="share of the change's energy that a smooth gain may leave", source="convention: 90 % explained",
    )  # fmt: skip


DEFAULT = LowFrequencyThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class LowFrequencyRival:
    """A smooth gain over the lines of one shaft in one channel."""

    left: float  # share of the change's energy that it leaves
    log_evidence: float  # of the gain [nat]
    gain: tuple[float, ...]  # |g| at the first lines
    frequencies: tuple[float, ...]  # of these [Hz]


def low_frequency_rival(
    compared: BaselineComparison, change: ShaftChange, limits: LowFrequencyThresholds = DEFAULT
) -> LowFrequencyRival | None:
    """The gain that explains a change as well as a fault does; None where none does."""
    y, x = compared.reading.channels[change.channel].lines, compared.expected.lines[change.channel]
    at = np.rint(change.multiples * float(change.shaft) * compared.reading.period).astype(int) - 1
    at = at[at < x.size]
    if at.size == 0:
        return None
    f = (at + 1) / compared.reading.period * compared.reading.speed_hz
    σ = compared.expected.std[change.channel][at]
    base = np.vander(np.log(f / f[0]), PARAMETERS, increasing=True)
    if at.size <= base.shape[1]:
        return None
    c, *_ = np.linalg.lstsq(base * (x[at] / σ)[:, None], y[at] / σ, rcond=None)
    g = base @ c
    whole, left = (float(np.sum(np.abs(y[at] - v) ** 2 / σ**2)) for v in (x[at], g * x[at]))
    if left > limits.explained * whole:
        return None
    return LowFrequencyRival(
        left=left / whole,
        log_evidence=whole - left - PARAMETERS,
        gain=tuple(np.abs(g[:PARAMETERS]).tolist()),
        frequencies=tuple(f[:PARAMETERS].tolist()),
    )
