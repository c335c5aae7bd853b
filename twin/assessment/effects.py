"""Residual, effects and what is unexplained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated

from twin.assessment.key import FILLED, GIVEN, HIDDEN, MICROMETRE, OPTIONAL, PERCENT, Key
from twin.assessment.values import ParameterValue, SpectralLine


@dataclass(frozen=True, slots=True, kw_only=True)
class HarmonicBand:
    """RMS round one mesh harmonic, ± 2 shaft orders [m/s²]."""

    harmonic: int
    frequency: Annotated[float, Key("frequency_hz", null=True)]
    measured: float | None
    predicted: float | None
    predicted_before: Annotated[
        float | None, Key(meaning="without the effects found", shown=lambda band: band.channel is not None)
    ] = None
    channel: Annotated[str | None, Key(shown=GIVEN)] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelErrors:
    """Errors of one channel against a healthy baseline, before and after what was found [%]."""

    rms_before: Annotated[float, Key(null=True)]
    rms_after: Annotated[float, Key(null=True)]
    waveform_before: Annotated[float, Key(null=True)]
    waveform_after: Annotated[float, Key(null=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Residual:
    """What the twin does not explain, over the latest windows."""

    rms_error: Annotated[float | None, Key("rms_error_percent", PERCENT)] = None
    waveform_error: Annotated[
        float | None, Key("waveform_error_percent", PERCENT, "‖measured − predicted‖/‖measured‖")
    ] = None
    windows: Annotated[int | None, Key(meaning="how many the errors are computed over", shown=GIVEN)] = None
    bands: Annotated[tuple[HarmonicBand, ...], Key(meaning="per gear-mesh harmonic: measured and predicted RMS")] = ()
    lines: Annotated[
        tuple[SpectralLine, ...], Key("orders", meaning="the strongest unexplained lines, strongest first")
    ] = ()
    channels: Annotated[
        Mapping[str, ChannelErrors] | None,
        Key(unit=PERCENT, meaning="of a comparison with a healthy baseline", shown=GIVEN),
    ] = None
    reason: Annotated[str | None, Key(meaning="why errors are not available", shown=GIVEN)] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """How much better the machine is explained with the effect."""

    log_evidence: Annotated[
        float | None,
        Key(meaning="natural logarithm of the evidence over the twin without it; null where none is computed"),
    ]
    over_runner_up: Annotated[float | None, Key(meaning="the same over the next best explanation")] = None
    runner_up: str | None = None
    indistinguishable_from: Annotated[
        tuple[str, ...], Key(meaning="effects that these channels cannot tell it from")
    ] = ()
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthyErrors:
    """Errors that a healthy machine has at most, within the rig file's tolerances [%]; null where one is not known."""

    rms: Annotated[float | None, Key("level")] = None
    waveform: Annotated[float | None, Key("acceleration")] = None
    transmission_error: float | None = None


_where_compared = partial(Key, unit=PERCENT, shown=lambda errors: bool(errors.windows))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutErrors:
    """Errors on windows that took no part in fitting; null where there were none."""

    rms: Annotated[float | None, Key("rms_percent", PERCENT)] = None
    waveform: Annotated[float | None, Key("waveform_percent", PERCENT)] = None
    noise: Annotated[
        float | None, _where_compared("noise_percent", meaning="what noise alone would leave of the waveform")
    ] = None
    transmission_error: Annotated[float | None, _where_compared("transmission_error_percent")] = None
    windows: Annotated[tuple[int, ...], Key(shown=FILLED)] = ()
    note: Annotated[str, Key(meaning="which held-out windows were left out, and why", shown=FILLED)] = ""
    healthy: Annotated[HealthyErrors | None, HIDDEN] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MovedLines:
    """Errors of one channel on held-out windows, on the lines that the effect moves beyond their scatter."""

    channel: Annotated[str, Key(choices=("acceleration", "transmission_error", "pinion_motion", "torque"))]
    lines: Annotated[int, Key(meaning="how many lines, over all windows")]
    before: Annotated[
        float, Key("before_percent", PERCENT, "without this effect alone, all others in the twin", null=True)
    ]
    after: Annotated[float, Key("after_percent", PERCENT, null=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Growth:
    """How the size of an effect has gone on after its onset, where it is not constant."""

    law: Annotated[str, Key(choices=("linear", "second_change"))]
    parameter: Annotated[str, Key(meaning="the one of the effect's parameters that gives its size")]
    size: Annotated[ParameterValue, Key("size_at_latest_window")]
    rate: Annotated[ParameterValue | None, Key("rate_per_million_revolutions", shown=GIVEN)] = None  # per revolution
    second_change: Annotated[
        ParameterValue | None,
        Key("second_change_at", meaning="revolutions at which the size changed again", shown=GIVEN),
    ] = None
    factor: Annotated[
        ParameterValue | None,
        Key(
            "factor_after",
            meaning="on the size from the second change on; 0 where the effect was taken back",
            shown=GIVEN,
        ),
    ] = None


_kept = partial(Key, shown=lambda effect: effect.status is not None)
_in_each_window = partial(Key, shown=lambda effect: effect.status is None)


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectAssessment:
    """An effect that the model lacked and that was added, or a change against a healthy baseline."""

    name: str
    status: Annotated[
        str | None,
        _kept(
            meaning="suspected: fewer than three held-out windows since its onset could test it",
            choices=("found", "suspected", "accepted", "pinned", "rejected"),
        ),
    ] = "found"  # None where it is judged anew in each window
    parameters: Mapping[str, ParameterValue]
    evidence: Evidence
    error_before: HeldOutErrors = field(default_factory=HeldOutErrors)
    error_after: HeldOutErrors = field(default_factory=HeldOutErrors)
    moved_lines: Annotated[
        tuple[MovedLines, ...],
        Key(meaning="what the effect claims to explain, by channel; absent where it moves no line", shown=FILLED),
    ] = ()
    depth_before: Annotated[
        float | None, Key("wear_depth_um_before", MICROMETRE, "at the latest window, without the effect [µm]")
    ] = None
    depth_after: Annotated[float | None, Key("wear_depth_um_after", MICROMETRE, "with it [µm]")] = None
    life_before: Annotated[float | None, _kept("rul_revolutions_before")] = None
    life_after: Annotated[float | None, _kept("rul_revolutions_after")] = None
    onset_revolutions: Annotated[float | None, Key(meaning="of the pinion; 0 if there from the start")] = None
    onset_std: Annotated[
        float | None,
        Key(
            "onset_std_revolutions",
            meaning="the interval between the windows about the onset included",
            shown=GIVEN,
        ),
    ] = None
    growth: Annotated[Growth | None, Key(meaning="absent where the size is constant", shown=GIVEN)] = None
    channels: Annotated[tuple[str, ...], _in_each_window(meaning="in which a change against a baseline is seen")] = ()
    windows: Annotated[tuple[int, ...], _in_each_window()] = ()
    curves: Annotated[Mapping[str, tuple[float, ...]], _in_each_window()] = field(default_factory=dict)  # SI
    caveats: Annotated[
        tuple[str, ...],
        Key(meaning="what of it is preliminary and why, a sentence each; absent where nothing is", shown=FILLED),
    ] = ()


_LIMIT = Key(
    "limit_percent",
    PERCENT,
    "the larger of the limits for acceleration and transmission error",
    shown=OPTIONAL,
    after="reason",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Unexplained:
    """What the model with its effects does not explain."""

    share: Annotated[float | None, Key("share_percent", PERCENT, "of the measured energy over the noise floor")] = None
    lines: Annotated[tuple[SpectralLine, ...], Key("orders")] = ()
    verdict: Annotated[str, Key(choices=("explained", "unknown_effect", "insufficient_data"))]
    reason: str = ""
    limits: Annotated[
        HealthyErrors,
        Key(
            "limits_percent",
            PERCENT,
            "errors on held-out windows up to which the machine counts as explained: the most that a healthy machine "
            "has within the rig file's tolerances, at the conditions of these windows",
            shown=OPTIONAL,
        ),
    ] = field(default_factory=HealthyErrors)
    struck: Annotated[str, HIDDEN] = ""  # shaft whose turn impacts repeat with, always at the same tooth: or ""

    @property
    def limit(self) -> Annotated[float | None, _LIMIT]:
        """The larger of the limits for acceleration and transmission error; None where none is known."""
        known = [limit for limit in (self.limits.waveform, self.limits.transmission_error) if limit is not None]
        return max(known, default=None)
