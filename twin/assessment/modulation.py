"""Modulation of the mesh vibration by the turn of a shaft."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class SidebandPair:
    """The two lines at ± n shaft orders about one mesh harmonic."""

    harmonic: int  # of the mesh
    mesh: float  # amplitude of the mesh line [m/s²]
    lower: float  # amplitude of the line below it [m/s²]
    upper: float  # of the line above it [m/s²]
    depth: float  # sum of both over the mesh line
    std: float  # of the depth, from the noise between the lines


@dataclass(frozen=True, slots=True, kw_only=True)
class Modulation:
    """How deep n times the turn of one shaft modulates the mesh vibration in one accelerometer."""

    sensor: str
    shaft: str  # pinion or gear
    multiple: int  # n: so many times a turn
    frequency: float  # spacing of the sidebands [Hz]
    depth: float  # over all mesh harmonics that were read, weighted by their power
    std: float
    amplitude_share: float  # of the modulation's power: 1 amplitude modulation, 0 phase modulation
    pairs: tuple[SidebandPair, ...]  # mesh harmonics whose sidebands are above the noise
    healthy: tuple[float, float] | None = None  # least and largest depth in a healthy baseline; None without one
    new: bool | None = None  # whether it is clearly deeper than in the baseline; None without one
