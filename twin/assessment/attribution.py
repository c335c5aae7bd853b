"""What the effects rest on: calibration, held-out windows, and the log of changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated

from twin.assessment.effects import Evidence, HeldOutErrors
from twin.assessment.key import DEGREE, HIDDEN, MICROMETRE, OPTIONAL, PERCENT, Key
from twin.assessment.values import ParameterValue

_by_windows = partial(Key, shown=lambda calibration: calibration.source == "windows")


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationAssessment:
    """Calibrated values with their relative uncertainty and what they rest on."""

    source: Annotated[str, Key("from", meaning="`rig file` or `windows`")]
    values: Mapping[str, float]  # SI
    std: Annotated[Mapping[str, float] | None, Key("std_percent", PERCENT, null=True)] = None
    windows: int = 0
    misfit: Annotated[float | None, _by_windows()] = None
    doubts: Annotated[tuple[str, ...], _by_windows()] = ()
    compliance_scale: Annotated[float | None, _by_windows()] = None
    mesh_phase: Annotated[float | None, _by_windows("mesh_phase_deg", DEGREE, "against the encoder's zero")] = None
    path_lines_learned: Annotated[int | None, _by_windows()] = None
    mesh_stiffness: Annotated[
        str | None, Key(meaning="`potential-energy method` or `given in the rig file`", shown=OPTIONAL)
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One effect that was tried on the mesh lines."""

    name: str
    log_evidence: Annotated[float, Key(null=True)]  # [nat]


@dataclass(frozen=True, slots=True, kw_only=True)
class SkippedWindow:
    """One window of the history that could not be used."""

    window: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthPair:
    """The depth at one window without and with the effects [µm]."""

    index: int
    revolutions: float | None
    before: Annotated[float, Key("wear_depth_um_before", MICROMETRE, null=True)]
    after: Annotated[float, Key("wear_depth_um_after", MICROMETRE, null=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutBand:
    """RMS round one mesh harmonic of a held-out window, without and with the effects [m/s²]."""

    harmonic: int
    frequency: Annotated[float, Key("frequency_hz")]
    measured: float
    before: float
    after: float
    residual_before: float
    residual_after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutLine:
    """One line of a held-out window: measured, and what is left of it without and with the effects [m/s²]."""

    order: float
    frequency: Annotated[float, Key("frequency_hz")]
    measured: float
    before: float
    after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutResidual:
    """The residual of one held-out window, without and with the effects."""

    window: int
    bands: tuple[HeldOutBand, ...]
    lines: Annotated[tuple[HeldOutLine, ...], Key("orders")]


_with_parameters = partial(Key, shown=lambda event: event.parameters is not None)
_with_evidence = partial(Key, shown=lambda event: event.evidence is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectEvent:
    """One change of the effects in the twin."""

    action: str  # found, changed, dropped, accepted, rejected, pinned, released; or accept, reject, pin, release
    name: str
    window: int | None = None
    revolutions: Annotated[float | None, Key(shown=OPTIONAL)] = None
    parameters: Annotated[Mapping[str, ParameterValue] | None, _with_parameters()] = None
    onset_revolutions: Annotated[float | None, _with_parameters()] = None
    evidence: Annotated[Evidence | None, HIDDEN] = None

    @property
    def log_evidence(self) -> Annotated[float | None, _with_evidence(after="onset_revolutions")]:
        """That of its evidence, as the next two."""
        return None if self.evidence is None else self.evidence.log_evidence

    @property
    def runner_up(self) -> Annotated[str | None, _with_evidence(after="log_evidence")]:
        """The next best explanation."""
        return None if self.evidence is None else self.evidence.runner_up

    @property
    def over_runner_up(self) -> Annotated[float | None, _with_evidence(after="runner_up")]:
        """The evidence over it."""
        return None if self.evidence is None else self.evidence.over_runner_up


@dataclass(frozen=True, slots=True, kw_only=True)
class Attribution:
    """What the effects rest on, and what the twin would say without them."""

    reason: Annotated[str | None, Key(meaning="why the latest attribution could not be made, where it could not")] = (
        None
    )
    candidates: tuple[Candidate, ...] = ()
    misfit_before: float | None = None
    misfit_after: float | None = None
    other_structure: Annotated[bool, Key(meaning="whether the transfer path is not that of the rig file")] = False
    held_out: Annotated[tuple[int, ...], Key(meaning="indices of windows kept from all fits")] = ()
    fitted: tuple[int, ...] = ()
    not_confirmed: Annotated[tuple[str, ...], Key(meaning="effects that were refused")] = ()
    refused: Annotated[
        Mapping[str, str], Key(meaning="the same with the reason: no smaller error, impossible, or chance")
    ] = field(default_factory=dict)
    rejected: Annotated[tuple[str, ...], Key(meaning="effects that an engineer has ruled out")] = ()
    errors: Annotated[HeldOutErrors | None, Key(meaning="of the twin in use, on held-out windows")] = None
    depths: Annotated[tuple[DepthPair, ...], Key(meaning="depth by window without and with the effects")] = ()
    residual: HeldOutResidual | None = None
    unknown: Annotated[str, Key(meaning="content that has no name, in words")] = ""
    skipped: Annotated[tuple[SkippedWindow, ...], Key(meaning="windows of the history that could not be used")] = ()
    log: Annotated[tuple[EffectEvent, ...], Key(meaning="every change of the model with its evidence")] = ()
