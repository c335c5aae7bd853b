"""What shakes the housing without coming from the gears: effects that no twin of the gears can name.

Each takes the housing's acceleration at the samples and gives it back with its own part in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

Felt = Callable[[np.ndarray, np.ndarray, np.ndarray, np.random.Generator], np.ndarray]


@dataclass(frozen=True, slots=True)
class OrderTone:
    """A part driven by belt from the pinion's shaft, with harmonics that fall as 1/n: A·Σ sin(n·o·θ)/n."""

    amplitude: float  # [m/s²]
    order: float  # of the pinion's turn, no whole number
    harmonics: int

    def __call__(self, acceleration, time, angle, rng):
        """(n,) [m/s²] at times [s] and pinion angles [rad] → (n,)."""
        own = sum(np.sin(n * self.order * angle) / n for n in range(1, self.harmonics + 1))
        return acceleration + self.amplitude * own


@dataclass(frozen=True, slots=True)
class LevelModulation:
    """The level of all vibration breathes at a rate of its own: 1 + m·sin(2πft), as where a path loosens."""

    depth: float
    frequency: float  # [Hz]

    def __call__(self, acceleration, time, angle, rng):
        """(n,) [m/s²] at times [s] → (n,)."""
        return acceleration * (1 + self.depth * np.sin(2 * pi * self.frequency * time + rng.uniform(0, 2 * pi)))


@dataclass(frozen=True, slots=True)
class RandomImpacts:
    """Blows at random times that ring the housing: a decaying sine each, sizes spread by half."""

    amplitude: float  # mean first peak [m/s²]
    rate: float  # blows a second [1/s]
    frequency: float  # that the housing rings at [Hz]
    damping_ratio: float

    def __call__(self, acceleration, time, angle, rng):
        """(n,) [m/s²] at times [s] → (n,)."""
        dt = time[1] - time[0]
        blows = rng.poisson(self.rate * dt, time.size) * self.amplitude * np.exp(0.5 * rng.normal(0, 1, time.size))
        ω, ζ = 2 * pi * self.frequency, self.damping_ratio
        radius, turn = np.exp(-ζ * ω * dt), ω * np.sqrt(1 - ζ**2) * dt
        ringing = lfilter([0.0, radius * np.sin(turn)], [1.0, -2 * radius * np.cos(turn), radius**2], blows)
        return acceleration + ringing


@dataclass(frozen=True, slots=True)
class Rub:
    """A part that brushes the housing over some of every pinion turn: bursts of noise in a band."""

    amplitude: float  # standard deviation within a burst [m/s²]
    low: float  # band [Hz]
    high: float
    share: float  # of the turn in contact

    def __call__(self, acceleration, time, angle, rng):
        """(n,) [m/s²] at times [s] and pinion angles [rad] → (n,)."""
        rate = 1 / (time[1] - time[0])
        band = butter(2, [self.low, min(self.high, 0.45 * rate)], "bandpass", fs=rate, output="sos")
        noise = sosfilt(band, rng.normal(0, 1, time.size))
        contact = np.clip(np.cos(angle) - np.cos(pi * self.share), 0, None) / (1 - np.cos(pi * self.share))
        return acceleration + self.amplitude * contact * noise / noise.std()


@dataclass(frozen=True, slots=True)
class DriftingTone:
    """A tone of something that runs by itself, as a fan with slip: off its frequency, anew in every window.

    f = f0·(1 + d·u + w·(t/T − ½)), u drawn from −1 … 1 for a window of T, harmonics falling as 1/n.
    """

    amplitude: float  # [m/s²]
    frequency: float  # f0 [Hz]
    between: float  # d, relative
    within: float  # w, relative
    harmonics: int

    def __call__(self, acceleration, time, angle, rng):
        """(n,) [m/s²] at times [s] → (n,)."""
        t = time - time[0]
        f = self.frequency * (1 + self.between * rng.uniform(-1, 1) - self.within / 2)
        turned = 2 * pi * (f * t + self.frequency * self.within * t**2 / (2 * t[-1])) + rng.uniform(0, 2 * pi)
        own = sum(np.sin(n * turned) / n for n in range(1, self.harmonics + 1))
        return acceleration + self.amplitude * own


@dataclass(frozen=True, slots=True)
class SecondMesh:
    """Another machine's gears on the same base: mesh harmonics and their sidebands, at a speed of its own.

    a·Σ (1/k)·(1 + m·cos θ)·sin(k·z·θ + φ_k), with its shaft's speed f0·(1 − s·u), slip u drawn for every window,
    which wanders slowly by a tenth of that.
    """

    amplitude: float  # of the first mesh harmonic [m/s²]
    teeth: int  # z
    frequency: float  # of its shaft without slip, f0 [Hz]
    slip: float  # s
    modulation: float  # m
    harmonics: int

    def __call__(self, acceleration, time, angle, rng):
        """(n,) [m/s²] at times [s] → (n,)."""
        t = time - time[0]
        slip = self.slip * (rng.uniform(0, 1) + 0.1 * np.sin(2 * pi * rng.uniform(0.1, 0.5) * t + rng.uniform(0, 6)))
        turned = 2 * pi * np.cumsum(self.frequency * (1 - slip)) * (t[1] - t[0]) + rng.uniform(0, 2 * pi)
        level = self.amplitude * (1 + self.modulation * np.cos(turned))
        phases = rng.uniform(0, 2 * pi, self.harmonics)
        own = sum(np.sin(k * self.teeth * turned + phase) / k for k, phase in enumerate(phases, start=1))
        return acceleration + level * own
