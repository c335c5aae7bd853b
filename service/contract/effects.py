"""`effects[]`, `residual` and `unexplained`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from service.contract.base import MICROMETRE, PERCENT, ContractModel, Figure, in_unit

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment

MILLION = 1e6  # revolutions that a rate is given over
CURVES = {"frequency": "frequency_hz"}  # keys of curves that say their unit


class Line(ContractModel):
    """One unexplained line."""

    order: float | None = Field(description="of pinion rotation")
    frequency_hz: float | None
    share_percent: float | None = Field(description="of the measured energy")
    kind: str | None = Field(default=None, description="what repeats it, where that is known")

    @classmethod
    def of(cls, line: assessment.SpectralLine) -> Line:
        parts = {"kind": line.kind} if line.kind else {}
        return cls(
            order=line.order, frequency_hz=line.frequency, share_percent=in_unit(line.share, PERCENT), **parts
        )  # fmt: skip


class HarmonicBand(ContractModel):
    """RMS round one mesh harmonic, ± 2 shaft orders [m/s²]."""

    harmonic: int
    frequency_hz: float | None
    measured: float | None
    predicted: float | None
    predicted_before: float | None = Field(default=None, description="without the effects found")
    channel: str | None = None

    @classmethod
    def of(cls, band: assessment.HarmonicBand) -> HarmonicBand:
        parts: dict[str, Any] = {}
        if band.channel is not None:
            parts = {"channel": band.channel, "predicted_before": band.predicted_before}
        return cls(
            harmonic=band.harmonic,
            frequency_hz=band.frequency,
            measured=band.measured,
            predicted=band.predicted,
            **parts,
        )


class ChannelErrors(ContractModel):
    """Errors of one channel against a healthy baseline, before and after what was found [%]."""

    rms_before: float | None
    rms_after: float | None
    waveform_before: float | None
    waveform_after: float | None


class Residual(ContractModel):
    """What the twin does not explain, over the latest windows."""

    rms_error_percent: float | None
    waveform_error_percent: float | None
    windows: int | None = Field(default=None, description="how many windows the errors are computed over")
    bands: list[HarmonicBand] = Field(description="per gear-mesh harmonic: measured and predicted RMS")
    orders: list[Line] = Field(description="the strongest unexplained lines, strongest first")
    channels: dict[str, ChannelErrors] | None = None
    reason: str | None = Field(default=None, description="why errors are not available")

    @classmethod
    def of(cls, residual: assessment.Residual) -> Residual:
        parts: dict[str, Any] = {}
        if residual.windows is not None:
            parts["windows"] = residual.windows
        if residual.reason is not None:
            parts["reason"] = residual.reason
        if residual.channels is not None:
            parts["channels"] = {
                name: ChannelErrors(
                    rms_before=e.rms_before / PERCENT,
                    rms_after=e.rms_after / PERCENT,
                    waveform_before=e.waveform_before / PERCENT,
                    waveform_after=e.waveform_after / PERCENT,
                )
                for name, e in residual.channels.items()
            }
        return cls(
            rms_error_percent=in_unit(residual.rms_error, PERCENT),
            waveform_error_percent=in_unit(residual.waveform_error, PERCENT),
            bands=[HarmonicBand.of(b) for b in residual.bands],
            orders=[Line.of(line) for line in residual.lines],
            **parts,
        )


class Evidence(ContractModel):
    """How much better the machine is explained with the effect."""

    log_evidence: float | None = Field(
        description="natural logarithm of the evidence over the twin without it; null where none is computed"
    )
    over_runner_up: float | None = Field(description="the same over the next best explanation")
    runner_up: str | None
    indistinguishable_from: list[str] = Field(description="effects that these channels cannot tell it from")
    detail: str

    @classmethod
    def of(cls, evidence: assessment.Evidence) -> Evidence:
        return cls(
            log_evidence=evidence.log_evidence,
            over_runner_up=evidence.over_runner_up,
            runner_up=evidence.runner_up,
            indistinguishable_from=list(evidence.indistinguishable_from),
            detail=evidence.detail,
        )


class Errors(ContractModel):
    """Errors on windows that took no part in fitting; null where there were none."""

    rms_percent: float | None
    waveform_percent: float | None
    noise_percent: float | None = Field(default=None, description="what noise alone would leave of the waveform")
    transmission_error_percent: float | None = None
    windows: list[int] | None = None
    note: str | None = Field(default=None, description="which held-out windows were left out, and why")

    @classmethod
    def of(cls, errors: assessment.HeldOutErrors) -> Errors:
        parts: dict[str, Any] = {}
        if errors.windows:
            parts = {
                "noise_percent": in_unit(errors.noise, PERCENT),
                "transmission_error_percent": in_unit(errors.transmission_error, PERCENT),
                "windows": list(errors.windows),
            }
        if errors.note:
            parts["note"] = errors.note
        return cls(
            rms_percent=in_unit(errors.rms, PERCENT), waveform_percent=in_unit(errors.waveform, PERCENT), **parts
        )  # fmt: skip


class MovedLines(ContractModel):
    """Errors of one channel on held-out windows, on the lines that the effect moves beyond their scatter."""

    channel: Literal["acceleration", "transmission_error", "pinion_motion", "torque"]
    lines: int = Field(description="how many lines, over all windows")
    before_percent: float | None = Field(description="without this effect alone, all others in the twin")
    after_percent: float | None

    @classmethod
    def of(cls, moved: assessment.MovedLines) -> MovedLines:
        return cls(
            channel=moved.channel,  # type: ignore[arg-type]
            lines=moved.lines,
            before_percent=in_unit(moved.before, PERCENT),
            after_percent=in_unit(moved.after, PERCENT),
        )


class Growth(ContractModel):
    """How the size of an effect has gone on after its onset, where it is not constant."""

    law: Literal["linear", "second_change"]
    parameter: str = Field(description="the one of the effect's parameters that gives its size")
    size_at_latest_window: Figure
    rate_per_million_revolutions: Figure | None = Field(
        default=None, description="of a size that grows evenly: mean since the onset, per 1e6 revolutions of the pinion"
    )
    second_change_at: Figure | None = Field(default=None, description="revolutions at which the size changed again")
    factor_after: Figure | None = Field(
        default=None, description="on the size from the second change on; 0 where the effect was taken back"
    )

    @classmethod
    def of(cls, growth: assessment.Growth) -> Growth:
        parts: dict[str, Any] = {}
        if growth.rate is not None:
            rate = growth.rate
            per = rate.unit.removesuffix("/rev")
            unit = "1/1e6 rev" if per == "1" else f"{per}/1e6 rev"
            parts["rate_per_million_revolutions"] = Figure(
                value=rate.value * MILLION, unit=unit, std=rate.std * MILLION
            )
        if growth.second_change is not None:
            parts["second_change_at"] = Figure.of(growth.second_change)
        if growth.factor is not None:
            parts["factor_after"] = Figure.of(growth.factor)
        return cls(
            law=growth.law,  # type: ignore[arg-type]
            parameter=growth.parameter,
            size_at_latest_window=Figure.of(growth.size),
            **parts,
        )


class Effect(ContractModel):
    """An effect that the model lacked and that was added, or a change against a healthy baseline."""

    name: str
    label: str | None = Field(default=None, description="for people; absent where the effect is none of the table")
    status: Literal["found", "suspected", "accepted", "pinned", "rejected"] | None = Field(
        default=None, description="suspected: fewer than three held-out windows since its onset could test it"
    )
    parameters: dict[str, Figure]
    evidence: Evidence
    error_before: Errors
    error_after: Errors
    moved_lines: list[MovedLines] | None = Field(
        default=None, description="what the effect claims to explain, by channel; absent where it moves no line"
    )
    wear_depth_um_before: float | None = Field(description="at the latest window, without the effect [µm]")
    wear_depth_um_after: float | None = Field(description="with it [µm]")
    rul_revolutions_before: float | None = None
    rul_revolutions_after: float | None = None
    onset_revolutions: float | None = Field(description="of the pinion; 0 if there from the start")
    onset_std_revolutions: float | None = Field(
        default=None, description="the interval between the windows about the onset included"
    )
    growth: Growth | None = Field(default=None, description="absent where the size is constant")
    channels: list[str] | None = Field(default=None, description="in which a change against a baseline is seen")
    windows: list[int] | None = None
    curves: dict[str, list[float | None]] | None = Field(default=None, description="to be drawn")
    caveats: list[str] | None = Field(
        default=None, description="what of it is preliminary and why, a sentence each; absent where nothing is"
    )

    @classmethod
    def of(cls, effect: assessment.EffectAssessment) -> Effect:
        from twin.effects.channel_faults import label_of  # loads half of the twin, which a start does without

        parts: dict[str, Any]
        if effect.status is not None:
            parts = {
                "status": effect.status,
                "rul_revolutions_before": effect.life_before,
                "rul_revolutions_after": effect.life_after,
            }
        else:
            parts = {
                "channels": list(effect.channels),
                "windows": list(effect.windows),
                "curves": {CURVES.get(name, name): list(values) for name, values in effect.curves.items()},
            }
        label = label_of(effect.name)
        if label is not None:
            parts["label"] = label
        if effect.onset_std is not None:
            parts["onset_std_revolutions"] = effect.onset_std
        if effect.moved_lines:
            parts["moved_lines"] = [MovedLines.of(moved) for moved in effect.moved_lines]
        if effect.growth is not None:
            parts["growth"] = Growth.of(effect.growth)
        if effect.caveats:
            parts["caveats"] = list(effect.caveats)
        return cls(
            name=effect.name,
            parameters={name: Figure.of(p) for name, p in effect.parameters.items()},
            evidence=Evidence.of(effect.evidence),
            error_before=Errors.of(effect.error_before),
            error_after=Errors.of(effect.error_after),
            wear_depth_um_before=in_unit(effect.depth_before, MICROMETRE),
            wear_depth_um_after=in_unit(effect.depth_after, MICROMETRE),
            onset_revolutions=effect.onset_revolutions,
            **parts,
        )


class HealthyErrors(ContractModel):
    """Errors that a healthy machine has at most [%]; null where one is not known."""

    level: float | None
    acceleration: float | None
    transmission_error: float | None


class Unexplained(ContractModel):
    """What the model with its effects does not explain."""

    share_percent: float | None = Field(description="of the measured energy over the noise floor")
    orders: list[Line]
    verdict: Literal["explained", "unknown_effect", "insufficient_data"]
    reason: str
    limit_percent: float | None = Field(
        default=None, description="the larger of the limits for acceleration and transmission error"
    )
    limits_percent: HealthyErrors | None = Field(
        default=None,
        description="errors on held-out windows up to which the machine counts as explained: the most that a healthy "
        "machine has within the rig file's tolerances, at the conditions of these windows",
    )

    @classmethod
    def of(cls, unexplained: assessment.Unexplained) -> Unexplained:
        most = unexplained.limits
        known = [limit for limit in (most.waveform, most.transmission_error) if limit is not None]
        return cls(
            share_percent=in_unit(unexplained.share, PERCENT),
            orders=[Line.of(line) for line in unexplained.lines],
            verdict=unexplained.verdict,  # type: ignore[arg-type]
            reason=unexplained.reason,
            limit_percent=in_unit(max(known), PERCENT) if known else None,
            limits_percent=HealthyErrors(
                level=in_unit(most.rms, PERCENT),
                acceleration=in_unit(most.waveform, PERCENT),
                transmission_error=in_unit(most.transmission_error, PERCENT),
            ),
        )
