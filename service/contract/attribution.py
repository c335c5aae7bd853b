"""`tracing`: what the effects rest on; and `calibration`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field

from service.contract.base import ContractModel, in_unit
from service.contract.parts import Errors, Figure
from twin.assessment.key import DEGREE, MICROMETRE, PERCENT

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment


class Calibration(ContractModel):
    """Calibrated values with their relative uncertainty and what they rest on."""

    from_: str = Field(alias="from", description="`rig file` or `windows`")
    values: dict[str, float]
    std_percent: dict[str, float | None] | None
    windows: int
    misfit: float | None = None
    doubts: list[str] | None = None
    compliance_scale: float | None = None
    mesh_phase_deg: float | None = None
    path_lines_learned: int | None = None
    mesh_stiffness: str | None = Field(default=None, description="`potential-energy method` or `given in the rig file`")

    @classmethod
    def of(cls, calibration: assessment.CalibrationAssessment) -> Calibration:
        parts: dict[str, Any] = {"from": calibration.source}
        std = calibration.std
        if calibration.source == "windows":
            parts |= {
                "misfit": calibration.misfit,
                "doubts": list(calibration.doubts),
                "compliance_scale": calibration.compliance_scale,
                "mesh_phase_deg": in_unit(calibration.mesh_phase, DEGREE),
                "path_lines_learned": calibration.path_lines_learned,
            }
        return cls(
            values=dict(calibration.values),
            std_percent=None if std is None else {name: s / PERCENT for name, s in std.items()},
            windows=calibration.windows,
            mesh_stiffness=calibration.mesh_stiffness,
            **parts,
        )


class Candidate(ContractModel):
    """One effect that was tried on the mesh lines."""

    name: str
    log_evidence: float | None


class SkippedWindow(ContractModel):
    """One window of the history that could not be used."""

    window: int
    reason: str


class DepthPair(ContractModel):
    """The depth at one window without and with the effects [µm]."""

    index: int
    revolutions: float | None
    wear_depth_um_before: float | None
    wear_depth_um_after: float | None


class HeldOutBand(ContractModel):
    """RMS round one mesh harmonic of a held-out window, without and with the effects [m/s²]."""

    harmonic: int
    frequency_hz: float
    measured: float
    before: float
    after: float
    residual_before: float
    residual_after: float


class HeldOutLine(ContractModel):
    """One line of a held-out window: measured, and what is left of it without and with the effects [m/s²]."""

    order: float
    frequency_hz: float
    measured: float
    before: float
    after: float


class HeldOutResidual(ContractModel):
    """The residual of one held-out window, without and with the effects."""

    window: int
    bands: list[HeldOutBand]
    orders: list[HeldOutLine]

    @classmethod
    def of(cls, residual: assessment.HeldOutResidual) -> HeldOutResidual:
        return cls(
            window=residual.window,
            bands=[
                HeldOutBand(
                    harmonic=b.harmonic,
                    frequency_hz=b.frequency,
                    measured=b.measured,
                    before=b.before,
                    after=b.after,
                    residual_before=b.residual_before,
                    residual_after=b.residual_after,
                )
                for b in residual.bands
            ],
            orders=[
                HeldOutLine(
                    order=line.order,
                    frequency_hz=line.frequency,
                    measured=line.measured,
                    before=line.before,
                    after=line.after,
                )
                for line in residual.lines
            ],
        )


class LogEntry(ContractModel):
    """One change of the effects in the twin."""

    action: str
    name: str
    window: int | None
    revolutions: float | None = None
    parameters: dict[str, Figure] | None = None
    onset_revolutions: float | None = None
    log_evidence: float | None = None
    runner_up: str | None = None
    over_runner_up: float | None = None

    @classmethod
    def of(cls, event: assessment.EffectEvent) -> LogEntry:
        parts: dict[str, Any] = {}
        if event.parameters is not None:
            parts = {
                "parameters": {name: Figure.of(p) for name, p in event.parameters.items()},
                "onset_revolutions": event.onset_revolutions,
            }
        if event.evidence is not None:
            parts |= {
                "log_evidence": event.evidence.log_evidence,
                "runner_up": event.evidence.runner_up,
                "over_runner_up": event.evidence.over_runner_up,
            }
        return cls(
            action=event.action, name=event.name, window=event.window, revolutions=event.revolutions, **parts
        )  # fmt: skip


class Tracing(ContractModel):
    """What the effects rest on, and what the twin would say without them."""

    reason: str | None = Field(description="why the latest attribution could not be made, where it could not")
    candidates: list[Candidate]
    misfit_before: float | None
    misfit_after: float | None
    other_structure: bool = Field(description="whether the transfer path is not that of the rig file")
    held_out: list[int] = Field(description="indices of windows kept from all fits")
    fitted: list[int]
    not_confirmed: list[str] = Field(description="effects that were refused")
    refused: dict[str, str] = Field(description="the same with the reason: no smaller error, impossible, or chance")
    rejected: list[str] = Field(description="effects that an engineer has ruled out")
    errors: Errors | None = Field(description="of the twin in use, on held-out windows")
    depths: list[DepthPair] = Field(description="depth by window without and with the effects")
    residual: HeldOutResidual | None
    unknown: str = Field(description="content that has no name, in words")
    skipped: list[SkippedWindow] = Field(description="windows of the history that could not be used")
    log: list[LogEntry] = Field(description="every change of the model with its evidence")

    @classmethod
    def of(cls, found: assessment.Attribution) -> Tracing:
        return cls(
            reason=found.reason,
            candidates=[Candidate(name=name, log_evidence=gain) for name, gain in found.candidates],
            misfit_before=found.misfit_before,
            misfit_after=found.misfit_after,
            other_structure=found.other_structure,
            held_out=list(found.held_out),
            fitted=list(found.fitted),
            not_confirmed=list(found.not_confirmed),
            refused=dict(found.refused),
            rejected=list(found.rejected),
            errors=None if found.errors is None else Errors.of(found.errors),
            depths=[
                DepthPair(
                    index=d.index,
                    revolutions=d.revolutions,
                    wear_depth_um_before=d.before / MICROMETRE,
                    wear_depth_um_after=d.after / MICROMETRE,
                )
                for d in found.depths
            ],
            residual=None if found.residual is None else HeldOutResidual.of(found.residual),
            unknown=found.unknown,
            skipped=[SkippedWindow(window=index, reason=reason) for index, reason in found.skipped],
            log=[LogEntry.of(entry) for entry in found.log],
        )
