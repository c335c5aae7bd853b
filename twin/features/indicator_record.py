"""NA4: the residual's fourth moment against the mean of its variance over the record so far.

    NA4 = μ_4/(1/M·Σ_{m ≤ M} μ_2m)²

μ_2m, μ_4   central moments of the residual in window m, and in the present one (M)

A damage that grows raises the residual's variance as well; against the variance of the whole record NA4 goes on rising
where FM4 falls again. The record is kept for each sensor and gear under each operating condition: a residual grows with
load and speed, so that windows of different conditions are not comparable.

Source   J. J. Zakrajsek, D. P. Townsend, H. J. Decker, NASA TM-105950 (1993)
Holds    constant speed and load within a condition
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.assessment import GearIndicators, SensorIndicators
from twin.features.window_features import WindowFeatures

SAME_SPEED, SAME_TORQUE = 0.05, 0.1  # relative differences of one operating condition
MOST_CONDITIONS = 8  # that are kept of one gear and sensor, the latest used
SOUND = ("good", "repaired")  # quality of windows that enter the record


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualRecord:
    """Mean variance of one gear's residual by one sensor under one operating condition."""

    sensor: str
    gear: str
    speed: float  # of the pinion, of the first window [Hz]
    torque: float | None  # likewise [N·m]
    windows: int
    mean_variance: float  # [(m/s²)²]

    @property
    def condition(self) -> tuple[str, str, float, float | None]:
        """The key of the record."""
        return self.sensor, self.gear, self.speed, self.torque

    def holds_for(self, sensor: str, gear: str, speed: float, torque: float | None) -> bool:
        """Whether a window belongs to this record."""
        same = (self.sensor, self.gear) == (sensor, gear) and abs(speed - self.speed) <= SAME_SPEED * self.speed
        if self.torque is None or torque is None:
            return same and self.torque is torque
        return same and abs(torque - self.torque) <= SAME_TORQUE * abs(self.torque)

    def with_variance(self, variance: float) -> ResidualRecord:
        """The record with one more window."""
        mean = self.mean_variance + (variance - self.mean_variance) / (self.windows + 1)
        return replace(self, windows=self.windows + 1, mean_variance=mean)


Records = tuple[ResidualRecord, ...]


def with_na4(records: Records, features: WindowFeatures) -> tuple[Records, dict[str, SensorIndicators]]:
    """The records with one window more, and the window's indicators with NA4.

    A window whose data are degraded is compared with the record and does not enter it.
    """
    out: dict[str, SensorIndicators] = {}
    speed, kept = features.speed_hz, records
    for sensor, indicators in features.indicators.items():
        gears: dict[str, GearIndicators] = {}
        for gear, found in indicators.gears.items():
            if speed is None:
                gears[gear] = found
                continue
            record = _extended(records, sensor, gear, speed, features.torque_nm, found.residual_moments[0])
            gears[gear] = replace(found, na4=_na4(found.residual_moments[1], record.mean_variance))
            if features.quality in SOUND:
                kept = _with(kept, record)
        out[sensor] = replace(indicators, gears=gears)
    return kept, out


def _extended(
    records: Records, sensor: str, gear: str, speed: float, torque: float | None, variance: float
) -> ResidualRecord:
    known = [r for r in records if r.holds_for(sensor, gear, speed, torque)]
    if known:
        return min(known, key=lambda r: abs(r.speed - speed)).with_variance(variance)
    return ResidualRecord(sensor=sensor, gear=gear, speed=speed, torque=torque, windows=1, mean_variance=variance)


def _na4(fourth: float, mean_variance: float) -> float | None:
    return fourth / mean_variance**2 if mean_variance > 0 else None


def _with(records: Records, new: ResidualRecord) -> Records:
    """The records with one renewed or added, the latest last; the oldest conditions of its gear are dropped."""
    others = [r for r in records if r.condition != new.condition]
    own = [r for r in others if (r.sensor, r.gear) == (new.sensor, new.gear)]
    dropped = own[: max(0, len(own) + 1 - MOST_CONDITIONS)]
    return (*(r for r in others if r not in dropped), new)
