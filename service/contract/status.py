"""`status`: what a person should know first about a machine.

The level is the most severe that any rule of RULES gives; every rule that applies adds its sentence. `normal` is said
only where no rule applies, so that nothing that the contract names as an alarm can pass for normal:

| rule | level |
| --- | --- |
| the end-of-life criterion is reached | end_of_life |
| the end of life is probable within the horizon | alarm |
| the end of life is possible within the horizon | watch |
| an effect of the alarm class | alarm |
| any other effect, or a change against a baseline | watch |
| content that no effect makes (`unknown_effect`) | watch |
| the wear depth is beyond the validity of the model | watch |
| the encoders contradict the stated ratio | watch |
| no wear depth, no baseline and no pair to judge by | no_verdict |
| the verdict is `insufficient_data` | no_verdict |
| the latest window is refused or degraded | no_verdict |
| no whole window for longer than the service allows | no_verdict |
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field

from service.contract.base import HOUR, MICROMETRE, ContractModel, iso_time
from twin import assessment
from twin.attention import STATUS_LIMITS, StatusLimits, probability_within
from twin.effects import EFFECTS

Level = Literal["normal", "no_verdict", "watch", "alarm", "end_of_life"]
SEVERITY: tuple[Level, ...] = ("normal", "no_verdict", "watch", "alarm", "end_of_life")


class Since(ContractModel):
    """When a level was reached."""

    time: str | None
    revolutions: float | None


class Status(ContractModel):
    """What a person should know first."""

    level: Level
    reasons: list[str] = Field(description="one sentence each, most important first")
    since: Since | None = Field(default=None, description="when this level was reached")


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One rule that applies."""

    level: Level
    reason: str


Rule = Callable[[assessment.Assessment, StatusLimits], Iterable[Finding]]


def _life(found: assessment.Assessment, limits: StatusLimits) -> Iterable[Finding]:
    life = found.life
    if not isinstance(life, assessment.Life):
        return
    depth = _depth(found)
    if life.reached or (depth is not None and depth >= life.limit):
        at = "" if depth is None else f"{depth / MICROMETRE:.1f} µm of "
        yield Finding(level="end_of_life", reason=f"The wear depth has reached {at}{life.limit / MICROMETRE:.1f} µm.")
        return
    run = None if found.window is None else found.window.revolutions
    if not run:
        return
    ahead = limits.horizon * run
    chance = probability_within(life.revolutions, ahead)
    if chance > limits.possible:
        level: Level = "alarm" if chance > limits.probable else "watch"
        hours = ahead / life.speed / HOUR
        yield Finding(
            level=level,
            reason=f"The end of life ({life.limit / MICROMETRE:.0f} µm) is reached within {ahead:,.0f} revolutions "
            f"({hours:.3g} h) with a probability of {100 * chance:.0f} %.",
        )


def _effects(found: assessment.Assessment, limits: StatusLimits) -> Iterable[Finding]:
    for effect in found.effects:
        known = EFFECTS.get(effect.name)
        alarm = known is not None and known.facts.alarm_class == "alarm"
        label = effect.name.replace("_", " ") if known is None else known.facts.label
        what = f"{label[:1].upper()}{label[1:]}"
        where = f" in {', '.join(effect.channels)}" if effect.channels else ""
        sizes = ", ".join(_size(name, p) for name, p in effect.parameters.items())
        yield Finding(
            level="alarm" if alarm else "watch",
            reason=f"{what} was found{where}" + (f": {sizes}." if sizes else "."),
        )


def _size(name: str, parameter: assessment.ParameterValue) -> str:
    value, unit = parameter.value, parameter.unit
    if unit == "m":
        value, unit = value / MICROMETRE, "µm"
    return f"{name.replace('_', ' ')} {value:.3g}" + (f" {unit}" if unit else "")


def _unknown(found: assessment.Assessment, limits: StatusLimits) -> Iterable[Finding]:
    left = found.unexplained
    if left.verdict == "unknown_effect":
        reason = _sentence(f"The vibration has a cause that no effect explains: {left.reason}")
        yield Finding(level="watch", reason=reason)


def _validity(found: assessment.Assessment, limits: StatusLimits) -> Iterable[Finding]:
    wear, depth = found.wear, _depth(found)
    if isinstance(wear, assessment.Wear) and depth is not None and not wear.validity.valid:
        ends = [wear.validity.steady_state_to, wear.validity.contact_loss_from or wear.validity.steady_state_to]
        yield Finding(
            level="watch",
            reason=f"The wear depth of {depth / MICROMETRE:.1f} µm is beyond the validity of "
            f"the model ({min(ends) / MICROMETRE:.1f} µm).",
        )


def _pair(found: assessment.Assessment, limits: StatusLimits) -> Iterable[Finding]:
    pair = found.encoder_pair
    if isinstance(pair, assessment.EncoderPair) and pair.stated is not None and pair.stated.contradicted:
        yield Finding(
            level="watch",
            reason=f"The encoders' ratio {pair.ratio.value:.4f} contradicts {pair.stated.source}.",
        )


def _basis(found: assessment.Assessment, limits: StatusLimits) -> Iterable[Finding]:
    if isinstance(found.wear, assessment.Unavailable) and found.baseline is None:
        reason = _sentence(f"The machine cannot be judged: {found.wear.reason}")
        yield Finding(level="no_verdict", reason=reason)


def _insufficient(found: assessment.Assessment, limits: StatusLimits) -> Iterable[Finding]:
    left = found.unexplained
    if left.verdict == "insufficient_data":
        yield Finding(level="no_verdict", reason=_sentence(f"The vibration is not explained yet: {left.reason}"))


RULES: tuple[Rule, ...] = (_life, _effects, _unknown, _validity, _pair, _basis, _insufficient)


def status_of(found: assessment.Assessment, limits: StatusLimits = STATUS_LIMITS) -> Status:
    """The status that an assessment alone gives, without `since`."""
    return _most_severe([finding for rule in RULES for finding in rule(found, limits)])


def _most_severe(findings: Sequence[Finding]) -> Status:
    if not findings:
        return Status(level="normal", reasons=["The twin explains the vibration, and wear is far from its limit."])
    ordered = sorted(findings, key=lambda f: -SEVERITY.index(f.level))
    return Status(level=ordered[0].level, reasons=list(dict.fromkeys(f.reason for f in ordered)))


def _depth(found: assessment.Assessment) -> float | None:
    wear = found.wear
    if isinstance(wear, assessment.Wear):
        return wear.depth["combined"].median
    return wear.depth.median if isinstance(wear, assessment.LevelWear) else None


def _sentence(text: str) -> str:
    return text if text.endswith(".") else f"{text}."


# -- what the service adds ---------------------------------------------------------------------------------


def with_data_quality(status: Mapping[str, Any], record: Mapping[str, Any] | None) -> dict[str, Any]:
    """A status with the quality of the latest window: one that could not be used leaves nothing `normal`."""
    grade = (record or {}).get("quality")
    if grade not in ("degraded", "refused"):
        return dict(status)
    assert record is not None
    faults = dict.fromkeys(f"{f['kind']} in {f['channel']}" for f in record.get("faults") or ())
    why = record.get("reason") or ", ".join(faults) or "the cause was not recorded"
    return lowered(status, _sentence(f"The latest window is {grade}: {why}"))


def lowered(status: Mapping[str, Any], reason: str, since: str | None = None) -> dict[str, Any]:
    """A status that is at best `no_verdict`, for a reason: stale data, contradicting clocks, an unusable window.

    since  when that began, ISO 8601; it replaces the status's own where the level changes
    """
    level = max(status["level"], "no_verdict", key=SEVERITY.index)
    others = [] if status["level"] == "normal" else list(status["reasons"])
    reasons = [reason, *others] if level == "no_verdict" else [*others, reason]
    began = status.get("since")
    if level != status["level"]:
        began = None if since is None else Since(time=since, revolutions=None).as_json()
    return {**status, "level": level, "reasons": list(dict.fromkeys(reasons)), "since": began}


def with_status_since(
    before: Mapping[str, Any] | None, now: Mapping[str, Any], time_ns: int, revolutions: float | None
) -> dict[str, Any]:
    """A report whose status says since when its level holds: as before where the level is the same, else this window.

    before  the report of the window before; time_ns and revolutions are this window's
    """
    if "status" not in now:
        return dict(now)
    old, status = (before or {}).get("status") or {}, now["status"]
    since = old.get("since") if old.get("level") == status["level"] else None
    since = since or Since(time=iso_time(time_ns), revolutions=revolutions).as_json()
    return {**now, "status": {**status, "since": since}}


def none_yet(reason: str) -> dict[str, Any]:
    """The status of an asset before its first assessment."""
    return Status(level="no_verdict", reasons=[_sentence(reason)]).as_json()
