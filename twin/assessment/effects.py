"""Residual, effects and what is unexplained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from twin.assessment.values import ParameterValue, SpectralLine


@dataclass(frozen=True, slots=True, kw_only=True)
class HarmonicBand:
    """RMS round one mesh harmonic [m/s²]."""

    harmonic: int
    frequency: float  # [Hz]
    measured: float | None
    predicted: float | None
    predicted_before: float | None = None  # without the effects found
    channel: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelErrors:
    """Errors of one channel against a healthy baseline, before and after what was found."""

    rms_before: float
    rms_after: float
    waveform_before: float
    waveform_after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Residual:
    """What the twin leaves over the latest windows."""

    rms_error: float | None = None  # relative
    waveform_error: float | None = None  # ‖measured − predicted‖/‖measured‖
    windows: int | None = None
    bands: tuple[HarmonicBand, ...] = ()
    lines: tuple[SpectralLine, ...] = ()  # strongest first
    channels: Mapping[str, ChannelErrors] | None = None  # of a comparison with a healthy baseline
    reason: str | None = None  # why errors are not available


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What speaks for an effect."""

    log_evidence: float | None  # over the model without it [nat]; None where none is computed
    runner_up: str | None = None
    over_runner_up: float | None = None  # [nat]
    indistinguishable_from: tuple[str, ...] = ()
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthyErrors:
    """Relative errors that a healthy machine has at most, within the rig file's tolerances; None where unknown."""

    rms: float | None = None
    waveform: float | None = None
    transmission_error: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutErrors:
    """Errors on windows that took no part in fitting, relative; None where there were none."""

    rms: float | None = None
    waveform: float | None = None
    noise: float | None = None  # what noise alone would leave of the waveform
    transmission_error: float | None = None
    windows: tuple[int, ...] = ()
    note: str = ""  # why not all held-out windows were compared
    healthy: HealthyErrors | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MovedLines:
    """Errors of one channel of held-out windows on the lines that an effect moves, relative."""

    channel: str  # acceleration, transmission_error, pinion_motion or torque
    lines: int  # how many, over all windows
    before: float  # without the effect, all others in the twin
    after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """How the size of an effect has gone on after its onset, where it is not constant."""

    law: str  # "linear" or "second_change"
    parameter: str  # that gives the size
    size: ParameterValue  # at the latest window
    rate: ParameterValue | None = None  # of a linear law: mean since the onset, per revolution
    second_change: ParameterValue | None = None  # when the size changed again [revolutions]
    factor: ParameterValue | None = None  # of the size from the second change on; 0 where the effect was taken back


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectAssessment:
    """An effect that was added to the twin, or seen against a healthy baseline."""

    name: str
    parameters: Mapping[str, ParameterValue]
    evidence: Evidence
    status: str | None = "found"  # or suspected, accepted, pinned; None where it is judged anew in each window
    error_before: HeldOutErrors = field(default_factory=HeldOutErrors)
    error_after: HeldOutErrors = field(default_factory=HeldOutErrors)
    moved_lines: tuple[MovedLines, ...] = ()  # on held-out windows; () where it moves none beyond their scatter
    depth_before: float | None = None  # at the latest window, without the effect [m]
    depth_after: float | None = None  # with it [m]
    life_before: float | None = None  # [revolutions]
    life_after: float | None = None
    onset_revolutions: float | None = None  # 0 if there from the start
    onset_std: float | None = None  # the interval between the windows about it included [revolutions]
    growth: Growth | None = None  # None where the size is constant
    channels: tuple[str, ...] = ()  # in which it is seen; () where that is not said
    windows: tuple[int, ...] = ()
    curves: Mapping[str, tuple[float, ...]] = field(default_factory=dict)  # to be drawn, SI
    caveats: tuple[str, ...] = ()  # what of it is preliminary and why, a sentence each


@dataclass(frozen=True, slots=True, kw_only=True)
class Unexplained:
    """What is left beyond the model and its effects."""

    verdict: str  # "explained", "unknown_effect" or "insufficient_data"
    share: float | None = None  # of the measured energy over the noise floor
    lines: tuple[SpectralLine, ...] = ()
    reason: str = ""
    limits: HealthyErrors = field(default_factory=HealthyErrors)  # held-out errors up to which it counts as explained
    struck: str = ""  # shaft whose turn impacts repeat with, always at the same tooth: "pinion" or "gear"
