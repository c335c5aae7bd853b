"""`windows[]`: one record for each measurement window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field

from service.contract.base import ContractModel, in_unit
from service.contract.indicators import SensorIndicators
from twin.assessment.key import MICROMETRE, PERCENT

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment


class FusedMethod(ContractModel):
    """Depth by the encoders, wear coefficient by the slope of depth over revolutions."""

    k_wear_per_n: float | None
    wear_depth_um: float | None
    std_um: float | None
    from_lines_um: float | None = Field(description="depth by the mesh lines alone [µm]")
    misfit: float | None


class RmsMethod(ContractModel):
    """Wear coefficient by the RMS of one accelerometer."""

    k_wear_per_n: float | None
    wear_depth_um: float | None
    rms_predicted: float | None
    rms_after: float | None
    updated: bool
    converged: bool
    iterations: int


class Methods(ContractModel):
    """Both methods of updating; a method is absent where the window did not allow it."""

    fused: FusedMethod | None = None
    rms: RmsMethod | None = None

    @classmethod
    def of(cls, methods: assessment.MethodEstimates) -> Methods:
        parts: dict[str, Any] = {}
        if methods.fused is not None:
            own = methods.fused
            parts["fused"] = FusedMethod(
                k_wear_per_n=own.wear_coefficient,
                wear_depth_um=own.depth / MICROMETRE,
                std_um=in_unit(own.depth_std, MICROMETRE),
                from_lines_um=own.depth_from_lines / MICROMETRE,
                misfit=own.misfit,
            )
        if methods.rms is not None:
            rms = methods.rms
            parts["rms"] = RmsMethod(
                k_wear_per_n=rms.wear_coefficient,
                wear_depth_um=rms.depth / MICROMETRE,
                rms_predicted=rms.rms_predicted,
                rms_after=rms.rms_after,
                updated=rms.updated,
                converged=rms.converged,
                iterations=rms.iterations,
            )
        return cls(**parts)


class SlowValue(ContractModel):
    """What a window says of a slow channel."""

    value: float | None
    unit: str
    values: int = Field(description="how many of the window it summarises; 0 where it is an older one")
    age_s: float | None = Field(description="of the newest value at the window's end")


class WindowRecord(ContractModel):
    """One measurement window."""

    index: int
    kind: str = Field(description="`measurement` or `calibration`")
    start_time: str | None = Field(default=None, description="start of the window, ISO 8601")
    start_time_ns: int | None = Field(default=None, description="Unix time [ns]")
    revolutions: float | None = Field(default=None, description="of the pinion since new, at the window's middle")
    speed_hz: float | None = Field(default=None, description="pinion speed [Hz]")
    torque_nm: float | None = Field(default=None, description="input torque [N·m]")
    rms_measured: float | None = Field(default=None, description="reference accelerometer, in the rig's band [m/s²]")
    rms_predicted: float | None = Field(default=None, description="before any update in this window [m/s²]")
    error_percent: float | None = Field(default=None, description="100·(predicted − measured)/measured")
    updated: bool | None = Field(default=None, description="true where the error passed the threshold")
    rms_after: float | None = Field(default=None, description="predicted again after the update [m/s²]")
    error_after_percent: float | None = None
    k_wear_per_n: float | None = Field(default=None, description="Archard coefficient K [1/N]")
    wear_depth_um: float | None = Field(default=None, description="largest combined depth [µm]")
    wear_depth_p05_um: float | None = None
    wear_depth_p95_um: float | None = None
    method: str | None = Field(default=None, description="what set the depth")
    methods: Methods | None = None
    contact_loss_percent: float | None = Field(default=None, description="share of the mesh period without contact")
    speed_std_hz: float | None = None
    speed_from: str | None = Field(default=None, description="the channel that gave the angle")
    mesh_frequency_hz: float | None = None
    mesh_bands: list[float | None] | None = Field(default=None, description="RMS of the mesh harmonics' bands [m/s²]")
    temperatures: dict[str, SlowValue] | None = Field(default=None, description="slow channels, by place")
    loads: dict[str, SlowValue] | None = Field(
        default=None, description="slow channels of load, by place, in % of the rated load; shown, and not used"
    )
    indicators: dict[str, SensorIndicators] | None = Field(default=None, description="by accelerometer")
    notes: list[str] | None = None
    not_available: dict[str, str] | None = Field(default=None, description="what the window does not have, and why")
    quality: str | None = Field(default=None, description="`good`, `repaired`, `degraded` or `refused`")
    faults: list[dict[str, Any]] | None = Field(default=None, description="what was wrong with the window's data")
    reason: str | None = Field(default=None, description="why a refused window could not be used")

    @classmethod
    def of(cls, window: assessment.WindowAssessment) -> WindowRecord:
        depth = window.depth
        parts: dict[str, Any] = {}
        if window.modelled:
            parts = {
                "error_after_percent": in_unit(window.error_after, PERCENT),
                "method": window.method,
                "methods": None if window.methods is None else Methods.of(window.methods),
                "contact_loss_percent": in_unit(window.contact_loss, PERCENT),
            }
        else:
            parts = {
                "speed_std_hz": window.speed_std,
                "speed_from": window.speed_source,
                "mesh_frequency_hz": window.mesh_frequency,
            }
        if window.mesh_bands is not None or not window.modelled:
            parts["mesh_bands"] = None if window.mesh_bands is None else list(window.mesh_bands)
        if window.indicators:
            parts["indicators"] = {name: SensorIndicators.of(own) for name, own in window.indicators.items()}
        return cls(
            index=window.index,
            kind=window.kind,
            start_time_ns=window.start_time_ns,
            revolutions=window.revolutions,
            speed_hz=window.speed,
            torque_nm=window.torque,
            rms_measured=window.rms_measured,
            rms_predicted=window.rms_predicted,
            error_percent=in_unit(window.error, PERCENT),
            updated=window.updated,
            rms_after=window.rms_after,
            k_wear_per_n=window.wear_coefficient,
            wear_depth_um=None if depth is None else in_unit(depth.median, MICROMETRE),
            wear_depth_p05_um=None if depth is None else depth.p05 / MICROMETRE,
            wear_depth_p95_um=None if depth is None else in_unit(depth.p95, MICROMETRE),
            notes=list(window.notes),
            not_available=dict(window.unavailable),
            **parts,
        )


REQUIRED = (
    "index", "kind", "start_time", "revolutions", "speed_hz", "torque_nm", "rms_measured", "rms_predicted",
    "error_percent", "updated", "rms_after", "k_wear_per_n", "wear_depth_um",
)  # fmt: skip
"""Keys that every record carries, with or without a value."""


def refused_record(reason: str) -> dict[str, Any]:
    """The record of a window that could not be used: all required keys, without values."""
    return {**dict.fromkeys(REQUIRED), "kind": "measurement", "updated": False, "reason": reason}
