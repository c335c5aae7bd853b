"""Single-sided amplitude spectra on an even grid of time or of angle.

    A_k = 2·|Σ w·x·exp(−2πi·k·n/N)|/Σ w            half of that at 0 and at half the sampling rate
    ⟨x²⟩ = Σ A_k²/2/B,    B = N·Σ w²/(Σ w)²        A_0 and A_{N/2} count double; B = 1.5 bins for the Hann window

w   Hann window; the mean is taken off before
A   peak amplitude: a line of amplitude a in the middle of a bin reads a, and 0.849·a at the border of two bins
B   equivalent noise bandwidth

Averaged (P. D. Welch): the mean power of segments that overlap by half, which steadies the floor between the lines
at the price of resolution.

Source   F. J. Harris, Proc. IEEE 66 (1978) 51–83 (window, scalloping, noise bandwidth);
         P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70–73 (averaging)
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from scipy import fft

from twin.errors import WindowError
from twin.features.gaps import filled
from twin.features.resample import AngleSignal, spline_response
from twin.features.transforms import hann

LEAST_VALUES = 16
NOISE_BANDWIDTH = 1.5  # of the Hann window [bins]
FAITHFUL = 0.4  # cycles per sample up to which an interpolated signal is shown; beyond, folded lines come through


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Spectrum:
    """Amplitudes over frequency or order."""

    x: np.ndarray  # (n,) in cycles per unit of the grid: Hz, or orders
    amplitude: np.ndarray  # (n,) peak, in the signal's unit
    segments: int  # that were averaged
    lost: float = 0.0  # share of the values that was missing, and bridged by straight lines

    @property
    def resolution(self) -> float:
        """Distance of two values of x."""
        return float(self.x[1] - self.x[0])

    @property
    def rms(self) -> float:
        """RMS of the signal without its mean, by Parseval's theorem."""
        power = 0.5 * self.amplitude**2
        ends = power[0] + (power[-1] if self.x.size > 1 else 0.0)
        return float(np.sqrt((power.sum() + ends) / NOISE_BANDWIDTH))


def amplitude_spectrum(values, rate: float, segments: int = 1) -> Spectrum:
    """The spectrum of values (n,), NaN where they were lost.

    rate      values per unit of the grid
    segments  overlapping by half, whose power is averaged
    """
    x = np.asarray(values, dtype=float)
    if np.isfinite(x).sum() < LEAST_VALUES:
        raise WindowError(f"{int(np.isfinite(x).sum())} valid samples are too few for a spectrum")
    lost = 1.0 - float(np.isfinite(x).mean())
    x, _ = filled(x, x.size)
    length = 2 * x.size // (segments + 1) // 2 * 2
    if length < LEAST_VALUES:
        raise WindowError(f"{x.size} samples are too few for {segments} segments")
    weight = hann(length)
    x = x - x.mean()
    power = np.zeros(length // 2 + 1)
    for k in range(segments):
        begin = k * (x.size - length) // max(segments - 1, 1)
        power += np.abs(fft.rfft(weight * x[begin : begin + length])) ** 2
    amplitude = 2 / weight.sum() * np.sqrt(power / segments)
    amplitude[[0, -1]] /= 2
    return Spectrum(x=np.arange(power.size) * rate / length, amplitude=amplitude, segments=segments, lost=lost)


def order_spectrum(signal: AngleSignal, per_turn: float, segments: int = 1) -> Spectrum:
    """The spectrum of a signal on an even grid of pinion angle, what interpolation took from it given back.

    per_turn  mean number of the original samples in a pinion turn
    """
    values = np.where(signal.usable, signal.values, np.nan)
    found = amplitude_spectrum(values, 2 * pi / signal.step, segments)
    shown = found.x <= FAITHFUL * per_turn
    x = found.x[shown]
    return Spectrum(
        x=x,
        amplitude=found.amplitude[shown] / spline_response(x / per_turn),
        segments=segments,
        lost=found.lost,
    )
