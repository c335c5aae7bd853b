"""What one measurement window says, as plain data.

A line is named by what it belongs to: (k, p, g) is the order k·z1 + p + g·z1/z2 of pinion rotation, that is
mesh harmonic k with a sideband of p pinion orders and g gear orders; (0, p, 0) are pinion orders and
(0, 0, g) gear orders. What the channels do not allow is None, and `unavailable` says why.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from twin.assessment import SensorIndicators
from twin.errors import NotAvailable
from twin.serial import Numbers, Packed

Key = tuple[int, int, int]
Keys = Annotated[tuple[Key, ...], Packed("i2,i2,i2")]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredLines:
    """Complex lines of one signal: x(θ) ≈ Re Σ X exp(i·order·θ), θ the absolute pinion angle."""

    unit: str
    keys: Keys
    orders: Numbers
    amplitudes: Annotated[tuple[complex, ...], Packed("c16")]  # peak, in `unit`; (0, 0, 0) is the mean
    std: Numbers  # of the real and of the imaginary part
    unresolved: Keys = ()  # too close to a line named before them for this many turns

    def get(self, k: int, pinion: int = 0, gear: int = 0) -> complex | None:
        """The amplitude of one line; None where it was not read."""
        key = (k, pinion, gear)
        return self.amplitudes[self.keys.index(key)] if key in self.keys else None

    def at(self, k: int, pinion: int = 0, gear: int = 0) -> complex:
        """The amplitude of one line; NotAvailable where it was not read."""
        value = self.get(k, pinion, gear)
        if value is None:
            raise NotAvailable(f"line ({k}, {pinion}, {gear}) was not read")
        return value

    def std_at(self, k: int, pinion: int = 0, gear: int = 0) -> float:
        """Standard deviation of the real and of the imaginary part of one line; NotAvailable where not read."""
        value = self.get_std(k, pinion, gear)
        if value is None:
            raise NotAvailable(f"line ({k}, {pinion}, {gear}) was not read")
        return value

    def get_std(self, k: int, pinion: int = 0, gear: int = 0) -> float | None:
        """Standard deviation of the real and of the imaginary part of one line."""
        key = (k, pinion, gear)
        return self.std[self.keys.index(key)] if key in self.keys else None

    def mesh(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The mesh harmonics without sidebands: k, complex amplitudes and std, (n,) each."""
        chosen = [i for i, (k, p, g) in enumerate(self.keys) if k > 0 and p == g == 0]
        return (
            np.array([self.keys[i][0] for i in chosen], dtype=int),
            np.array([self.amplitudes[i] for i in chosen], dtype=complex),
            np.array([self.std[i] for i in chosen]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowFeatures:
    """Features of one window; compact, comparable, JSON-safe."""

    start_time_ns: int
    duration: float  # [s]
    quality: str  # the window's own: good, repaired, degraded
    valid_share: Mapping[str, float] = field(default_factory=dict)  # by channel, 0 … 1

    angle_from: str | None = None  # encoder/pinion, encoder/gear, or "mesh lines of accel/…"
    speed_hz: float | None = None  # pinion, mean over the window
    speed_std_hz: float | None = None  # how well it is known
    speed_variation: float | None = None  # standard deviation over the window, relative
    revolutions: float | None = None  # pinion, absolute, at the window's middle
    age_known: bool = True  # whether the revolutions count from new gears; else since the count began
    turns: float | None = None  # pinion turns covered

    torque_nm: float | None = None  # mean at the pinion's shaft

    sensor: str | None = None  # the accelerometer that all of the following come from
    rms: float | None = None  # in `band`, without the mean [m/s²]
    level_uncertainty: float | None = None  # relative, of comparing it with that of the mean speed; None: steady speed
    noise_rms: float | None = None  # the part of it that lies between the orders [m/s²]
    band: tuple[float, float] | None = None  # [Hz]
    mesh_bands: tuple[float | None, ...] | None = None  # RMS of mesh harmonics 1 … 5 ± 2 shaft orders [m/s²]

    acceleration: MeasuredLines | None = None  # [m/s²]
    transmission_error: MeasuredLines | None = None  # [m], or [rad] at the pinion where no base radius is known
    pinion_motion: MeasuredLines | None = None  # r_b1·θ1 about its smoothed rotation, where the gear has no encoder [m]
    torque: MeasuredLines | None = None  # [N·m]

    indicators: Mapping[str, SensorIndicators] = field(default_factory=dict)  # by accelerometer, without NA4

    unavailable: Mapping[str, str] = field(default_factory=dict)  # what is None, and why
