"""One measurement window: what was measured, predicted and updated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from twin.assessment.indicators import SensorIndicators
from twin.assessment.values import Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class FusedEstimate:
    """Depth by the encoders, wear coefficient by the slope of depth over revolutions."""

    wear_coefficient: float  # K [1/N]
    depth: float  # combined [m]
    depth_std: float | None  # [m]; None where the lines do not bound the depth
    depth_from_lines: float  # of the mesh lines alone, without the mean transmission error [m]
    misfit: float  # of the mesh lines, chi-square per line


@dataclass(frozen=True, slots=True, kw_only=True)
class RmsEstimate:
    """Wear coefficient by the RMS of one accelerometer."""

    wear_coefficient: float  # K [1/N]
    depth: float  # combined [m]
    rms_predicted: float  # [m/s²]
    rms_after: float  # [m/s²]
    updated: bool
    converged: bool
    iterations: int


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodEstimates:
    """Both methods of updating; None for a method that the window did not allow."""

    fused: FusedEstimate | None = None
    rms: RmsEstimate | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowAssessment:
    """One measurement window: what was measured, predicted and updated."""

    index: int
    kind: str  # "measurement" or "calibration"
    start_time_ns: int
    revolutions: float | None  # of the pinion since new, at the window's middle
    speed: float | None  # of the pinion [Hz]
    torque: float | None  # [N·m]
    rms_measured: float | None  # in the rig's band [m/s²]
    rms_predicted: float | None = None  # before any update in this window [m/s²]
    rms_after: float | None = None  # predicted again after the update [m/s²]
    updated: bool = False
    wear_coefficient: float | None = None  # K [1/N]
    depth: Interval | None = None  # combined [m]
    method: str | None = None  # what set the depth: "transmission error", "pinion encoder", "rms", "projection", …
    methods: MethodEstimates | None = None
    contact_loss: float | None = None  # share of the mesh period without contact
    modelled: bool = True  # whether the twin of the machine was updated by this window
    speed_std: float | None = None  # [Hz]
    speed_source: str | None = None  # the channel that gave the angle
    mesh_frequency: float | None = None  # [Hz]
    mesh_bands: tuple[float | None, ...] | None = None  # RMS of the mesh harmonics' bands [m/s²]
    indicators: Mapping[str, SensorIndicators] = field(default_factory=dict)  # by accelerometer
    notes: tuple[str, ...] = ()
    unavailable: Mapping[str, str] = field(default_factory=dict)  # feature → reason

    @property
    def error(self) -> float | None:
        """(predicted − measured)/measured of the RMS before any update."""
        return _relative(self.rms_predicted, self.rms_measured)

    @property
    def error_after(self) -> float | None:
        """The same after the update."""
        return _relative(self.rms_after, self.rms_measured)


def _relative(predicted: float | None, measured: float | None) -> float | None:
    return None if predicted is None or not measured else predicted / measured - 1
