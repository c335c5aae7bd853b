"""From the machine's motion to what its instruments report.

Acceleration and torque: sensor, anti-alias filter, decimation, white noise, and a converter of so many bits.
Encoders: edges pass when shaft angle, disc angle and graduation error add up to a multiple of the pitch; the
time of each is off by a jitter and read on a clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from scipy.signal import bilinear, firwin, lfilter, upfirdn

TAPS = 48  # of the anti-alias filter, for every step of decimation
PASS = 0.90  # its cut-off, of half the output rate


@dataclass(frozen=True, slots=True)
class Disc:
    """One encoder's disc as it came from the maker and was mounted."""

    edges_per_rev: int
    angle: float  # at which it was mounted [rad]
    amplitude: np.ndarray  # graduation error of orders 1, 2, … (orders,) [rad]
    phase: np.ndarray  # (orders,) [rad]

    def reading(self, shaft_angle: np.ndarray) -> np.ndarray:
        """The angle that the edges tell [rad]; (n,) → (n,)."""
        out = shaft_angle + self.angle
        for k, (a, φ) in enumerate(zip(self.amplitude, self.phase, strict=True), start=1):
            out = out + a * np.cos(k * shaft_angle + φ)
        return out


def make_disc(edges_per_rev: int, graduation, base_radius: float, rng: np.random.Generator) -> Disc:
    """A disc with graduation errors [m, on the line of action] of orders 1, 2, …, each within ±20 %."""
    size = len(graduation)
    amplitude = np.array(graduation) * rng.uniform(0.8, 1.2, size) / base_radius
    return Disc(edges_per_rev, rng.uniform(0, 2 * pi), amplitude, rng.uniform(0, 2 * pi, size))


def edges(disc: Disc, times, shaft_angle, start: float, stop: float, jitter: float, clock: float, rng):
    """Number of the first edge in [start, stop) [s] and the times of all of them there [s].

    times (n,) [s] and shaft_angle (n,) [rad] must reach beyond both ends.
    """
    told = np.maximum.accumulate(disc.reading(shaft_angle))
    pitch = 2 * pi / disc.edges_per_rev
    first, last = (int(np.ceil(np.interp(t, times, told) / pitch)) for t in (start, stop))
    at = np.interp(pitch * np.arange(first, last), told, times)
    at = at + jitter * rng.normal(0, 1, at.size)
    at = np.maximum.accumulate(np.round(at / clock) * clock)
    return first, np.clip(at, start, np.nextafter(stop, start))


def decimated(signal, factor: int, skip: int, count: int) -> np.ndarray:
    """Anti-alias filtered and decimated without delay: `count` values from index `skip` on; → (count,)."""
    taps = firwin(TAPS * factor + 1, PASS / factor, window=("kaiser", 8.0)) if factor > 1 else np.ones(1)
    half = taps.size // 2
    low, high = skip - half, skip + (count - 1) * factor + half + 1
    if low < 0 or high > signal.size:
        raise ValueError(f"the filter needs [{low}, {high}) of {signal.size} samples")
    return upfirdn(taps, signal[low:high], 1, factor)[2 * half // factor :][:count]


def mounted(acceleration, rate: float, frequency: float, ratio: float) -> np.ndarray:
    """What an accelerometer on a soft mount feels: (2ζω p + ω²)/(p² + 2ζω p + ω²); (n,) → (n,)."""
    ω = 2 * pi * frequency
    b, a = bilinear([2 * ratio * ω, ω**2], [1.0, 2 * ratio * ω, ω**2], rate)
    return lfilter(b, a, acceleration)


def converted(values, noise: float, span: float, bits: int, rng: np.random.Generator) -> np.ndarray:
    """With white noise, and rounded by a converter for ±span of so many bits; (n,) → (n,)."""
    step = 2 * span / 2**bits
    noisy = values + noise * rng.normal(0, 1, values.size)
    return np.clip(np.round(noisy / step), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1) * step


def rms_below(values, rate: float, limit: float) -> float:
    """RMS of the band above 0 and below `limit` [Hz]."""
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    f = np.fft.rfftfreq(values.size, 1 / rate)
    keep = (f > 0) & (f < limit)
    return float(np.sqrt(2 * power[keep].sum()) / values.size)
