"""What the effects rest on: calibration, held-out windows, and the log of changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.assessment.effects import Evidence, HeldOutErrors
from twin.assessment.values import ParameterValue


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationAssessment:
    """Calibrated values with what they rest on."""

    source: str  # "rig file" or "windows"
    values: Mapping[str, float]  # SI
    std: Mapping[str, float] | None = None  # relative
    windows: int = 0
    misfit: float | None = None
    doubts: tuple[str, ...] = ()
    compliance_scale: float | None = None
    mesh_phase: float | None = None  # against the encoder's zero [rad]
    path_lines_learned: int | None = None
    mesh_stiffness: str | None = None  # in words, where the stiffness of the mesh comes from


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthPair:
    """The depth at one window without and with the effects."""

    index: int
    revolutions: float | None
    before: float  # [m]
    after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutBand:
    """RMS round one mesh harmonic of a held-out window, without and with the effects [m/s²]."""

    harmonic: int
    frequency: float  # [Hz]
    measured: float
    before: float
    after: float
    residual_before: float
    residual_after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutLine:
    """One line of a held-out window: measured, and what is left of it without and with the effects [m/s²]."""

    order: float
    frequency: float  # [Hz]
    measured: float
    before: float
    after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutResidual:
    """The residual of one held-out window, without and with the effects."""

    window: int
    bands: tuple[HeldOutBand, ...]
    lines: tuple[HeldOutLine, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectEvent:
    """One change of the effects in the twin, or a decision on one."""

    action: str  # found, changed, dropped, accepted, rejected, pinned, released; or accept, reject, pin, release
    name: str
    window: int | None = None
    revolutions: float | None = None
    parameters: Mapping[str, ParameterValue] | None = None
    evidence: Evidence | None = None
    onset_revolutions: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Attribution:
    """What the effects rest on, and what the twin would say without them."""

    reason: str | None = None  # why the latest trace found nothing, where it could not be made
    candidates: tuple[tuple[str, float], ...] = ()  # name and log-evidence [nat]
    misfit_before: float | None = None
    misfit_after: float | None = None
    other_structure: bool = False
    held_out: tuple[int, ...] = ()  # indices of windows
    fitted: tuple[int, ...] = ()
    not_confirmed: tuple[str, ...] = ()  # effects that were refused
    refused: tuple[tuple[str, str], ...] = ()  # the same with the reason, a clause each
    rejected: tuple[str, ...] = ()  # effects that an engineer has ruled out
    errors: HeldOutErrors | None = None  # of the twin in use, on held-out windows
    depths: tuple[DepthPair, ...] = ()
    residual: HeldOutResidual | None = None
    unknown: str = ""  # what has no name, in words
    skipped: tuple[tuple[int, str], ...] = ()  # windows of the history that could not be used: index, and why
    log: tuple[EffectEvent, ...] = ()
