"""Condition indicators of one accelerometer; their definitions are in twin/features/indicators.py."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class GearIndicators:
    """Indicators of one gear by one accelerometer; None where the part of the signal they describe is empty."""

    turns: int  # of the gear that the synchronous average is made of
    fm0: float | None
    fm4: float | None
    m6a: float | None
    m8a: float | None
    energy_ratio: float | None
    sideband_level_factor: float | None
    residual_moments: tuple[float, float]  # second and fourth of the residual [(m/s²)²], [(m/s²)⁴]
    na4: float | None = None  # needs the windows before: twin/features/indicator_record.py


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorIndicators:
    """Indicators of one accelerometer in one window."""

    rms: float  # of all samples, without their mean [m/s²]
    kurtosis: float | None
    crest_factor: float | None
    gears: Mapping[str, GearIndicators] = field(default_factory=dict)  # by `pinion`, `gear`
    unavailable: Mapping[str, str] = field(default_factory=dict)  # gear → reason
    calibrated: bool = True  # whether the unit of the samples is known; else the RMS is that of raw values
    doubt: str = ""  # why those of gears may be of another speed
