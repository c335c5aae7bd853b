"""RMS of a signal in a frequency band.

    RMS² = 2·Σ_band |X_m|² / (N·Σ w²),   X = FFT(w·(x − x̄)),   w a Tukey window

w   flat but for the outer tenth at each end, so a line that is no whole number of cycles long
    neither leaks across the band's edge nor loses level
x̄   mean under w: the band's lower edge 0 means "without the mean"

Source   J. S. Bendat, A. G. Piersol, Random Data, 4th ed. (2010), chapter 11
Holds    a band below half the sampling rate; stationary over the window
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import fft

from twin.errors import NotAvailable, WindowError
from twin.features.gaps import filled, runs
from twin.features.transforms import bins_within, power_of
from twin.windows import Samples

LONGEST_REPAIR = 2  # samples that a straight line may bridge
SHORTEST_STRETCH = 0.1  # valid stretches shorter than this are not used [s]
USABLE = 0.45  # of the sampling rate: an anti-aliasing filter falls above it
TAPERED = 0.1  # share of a stretch that the window tapers at each end


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """RMS in a band, and how much of the record it rests on."""

    rms: float  # in the signal's unit
    valid_share: float  # share of the record's samples that were used, 0 … 1


@lru_cache(maxsize=4)
def tukey(n: int) -> np.ndarray:
    """Window (n,), 1 but for raised cosines over the outer tenths; read-only."""
    m = max(1, round(TAPERED * n))
    window = np.ones(n)
    ramp = np.sin(0.5 * np.pi * (np.arange(m) + 0.5) / m) ** 2
    window[:m] *= ramp
    window[n - m :] *= ramp[::-1]
    window.flags.writeable = False
    return window


def _band_energy(values, rate: float, band: tuple[float, float]) -> tuple[float, float]:
    """Energy in the band and weight Σw² of one stretch without gaps (n,)."""
    w = tukey(values.size)
    x = w * (values - (w @ values) / w.sum())
    length = fft.next_fast_len(values.size, real=True)
    X = fft.rfft(x, length)
    inside = bins_within(band, lambda k: k * rate / length, X.size)
    power = power_of(X[inside])
    f = np.arange(inside.start, inside.stop) * rate / length
    once = (f == 0) | (f == rate / 2)
    return float((2 * power.sum() - power[once].sum()) / length), float(w @ w)


def band_level(samples: Samples, band: tuple[float, float]) -> Level:
    """RMS in the band [Hz], without the mean, over the valid stretches of the record.

    Gaps of up to two samples are bridged; longer ones split the record into stretches, each taken
    by itself; stretches shorter than 0.1 s are left out.
    """
    if band[1] > samples.rate / 2:
        raise NotAvailable(
            f"RMS up to {band[1]:g} Hz is not available: the sampling rate {samples.rate:g} Hz ends at "
            f"{samples.rate / 2:g} Hz (sample faster, or end sensors.band_hz of the rig file at "
            f"{USABLE * samples.rate:.0f} Hz)"
        )
    values = samples.values
    if not np.isfinite(values).any():
        raise WindowError("RMS: not one of the channel's samples is valid")
    whole, usable = filled(values, LONGEST_REPAIR)
    shortest = min(values.size, max(16, round(SHORTEST_STRETCH * samples.rate)))
    parts = [(a, b) for a, b in runs(usable) if b - a >= shortest]
    if not parts:
        raise WindowError(f"RMS: no stretch of {SHORTEST_STRETCH:g} s without a gap in {samples.duration:.3g} s")
    energy, weight = np.sum([_band_energy(whole[a:b], samples.rate, band) for a, b in parts], axis=0)
    used = sum(b - a for a, b in parts)
    return Level(rms=float(np.sqrt(energy / weight)), valid_share=used / values.size)


def band_rms(samples: Samples, band: tuple[float, float]) -> float:
    """RMS in the band [Hz], without the mean, in the signal's unit."""
    return band_level(samples, band).rms
