"""What the status of a machine is made of: every rule that applies gives a finding with its reason and what to do.

| rule | level |
| --- | --- |
| the end-of-life criterion is reached | end_of_life |
| the end of life is probable within the horizon | alarm |
| the end of life is possible within the horizon | watch |
| the wear depth is near its limit, or its 5–95 % band reaches it | watch |
| the wear rate has risen by more than a factor of three | watch |
| the wear rate has fallen by as much | said, the level stays |
| an effect of the alarm class | alarm |
| any other effect, or a change against a baseline | watch |
| a vibration level beyond the alarm limit of the machine's own first windows, three windows in a row | alarm |
| the same in the latest window | watch |
| a modulation of the mesh, a tooth pattern, lines of no shaft, or a raw level, that is new against a baseline | watch |
| an effect of whatever class whose cause is preliminary (estimated structure), not accepted | watch |
| content that no effect makes (`unknown_effect`) | watch |
| impacts of no name, always at the same tooth of a shaft | alarm |
| the wear depth is beyond the validity of the model | watch |
| an inspection contradicts the windows | watch |
| the encoders contradict the stated ratio | watch |
| no wear depth, no baseline and no pair to judge by | no_verdict |
| the verdict is `insufficient_data` | no_verdict |
| depth or life are preliminary | no_verdict |

Of one level, that comes first which explains most of what is measured, or lies furthest beyond its limit.

A depth or life that is preliminary gives at most `watch`, and the action is then the measurement that would settle it.
The exception is a machine whose depth earlier windows had established, and whose model has come to its end since
(twin/established.py):

| at or beyond the end of life | depth established | preliminary, established before | preliminary |
| --- | --- | --- | --- |
| the 5th percentile | end_of_life | end_of_life | watch |
| the median | end_of_life | alarm: stop, measure | watch |
| the 95th percentile alone | watch | watch | watch |
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from service.contract.base import iso_time, spoken_time
from service.contract.effect_findings import EFFECT_RULES, Rule
from service.contract.finding import NO_ACTION, SEVERITY, Finding, Level, by_severity, cause, sentence
from service.contract.parts import contradiction
from twin import assessment
from twin.assessment.key import MICROMETRE
from twin.attention import DAY, StatusLimits, probability_within, revolutions_ahead

INCOMPLETE = (
    "Complete the rig file (`gear-twin init` makes one), or learn a healthy baseline (`gear-twin baseline`), so that "
    "the machine can be judged."
)
UNJUDGED = (
    "Remove the reason (`gear-twin doctor` examines recording and rig file), or learn a healthy baseline (`gear-twin "
    "baseline`), so that the machine can be judged."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Limit:
    """The depth as a share of its limit, as text and number."""

    depth: float | None  # [m]
    limit: float  # [m]

    @property
    def said(self) -> str:
        """For example "511.0 µm of 500 µm"."""
        limit = f"{self.limit / MICROMETRE:.4g} µm"
        return limit if self.depth is None else f"{self.depth / MICROMETRE:.4g} µm of {limit}"


def _depth(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    """The depth against its limit."""
    life, band = found.life, depth_of(found)
    if not isinstance(life, assessment.Life):
        return
    depth = None if band is None else band.median
    at = _Limit(depth=depth, limit=life.limit)
    if life.reached or (depth is not None and depth >= life.limit):
        yield Finding(
            subject="depth",
            level="end_of_life",
            reason=f"The wear depth has reached the end of life: {at.said}.",
            action=f"Stop the machine and replace the gear pair: {at.said}.",
            share=1.0,
        )
        return
    possible = band is not None and band.p95 is not None and band.p95 >= life.limit
    if possible or (depth is not None and depth >= limits.depth_share * life.limit):
        assert band is not None
        share = "" if depth is None else f" ({100 * depth / life.limit:.0f} %)"
        reach = "" if band.p95 is None else f"; its 95th percentile is {band.p95 / MICROMETRE:.4g} µm"
        yield Finding(
            subject="depth",
            level="watch",
            reason=f"The wear depth is near its limit: {at.said}{share}{reach}.",
            action=f"Plan the replacement of the gear pair and measure the wear depth at the next stop: {at.said}.",
            share=min((depth or 0.0) / life.limit, 1.0),
        )


def _life(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    """The remaining life against the horizon."""
    life = found.life
    if not isinstance(life, assessment.Life) or life.reached:
        return
    chance = probability_within(life.revolutions, revolutions_ahead(life, limits))
    if chance <= limits.possible:
        return
    left = _until(life)
    action = (
        f"Replace the gear pair {left}"
        if chance > limits.probable
        else f"Prepare the replacement of the gear pair for a stop {left}"
    )
    yield Finding(
        subject="life",
        level="alarm" if chance > limits.probable else "watch",
        reason=f"The end of life ({life.limit / MICROMETRE:.4g} µm) is reached within {_ahead(life, limits)} with a "
        f"probability of {100 * chance:.0f} %.",
        action=f"{action} (5th percentile of the remaining life).",
        share=chance,
    )


def _rate(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    change = found.wear.rate_change if isinstance(found.wear, assessment.Wear) else None
    if change is None:
        return
    risen = change.factor > 1
    factor = f"risen {change.factor:.2g} times" if risen else f"fallen to {100 * change.factor:.2g} %"
    yield Finding(
        subject="wear_rate",
        level="watch" if risen else "normal",
        reason=f"The wear rate has {factor} since {change.revolutions:,.0f} revolutions.",
        action="Inspect the flanks and the lubrication of the gears at the next stop." if risen else NO_ACTION,
        share=1 - 1 / change.factor if risen else None,
    )


def _ahead(life: assessment.Life, limits: StatusLimits) -> str:
    """The horizon in words."""
    days = f"{limits.horizon / DAY:.3g} day{'' if limits.horizon == DAY else 's'}"
    known = isinstance(life.date, assessment.LifeDate)
    return days if known else f"{days} of operation"


def _until(life: assessment.Life) -> str:
    """When something must have happened: by the lower end of the remaining life, with the date where it is known."""
    hours = f"{spoken_time(life.time.p05)} of operation"
    date = life.date
    if isinstance(date, assessment.LifeDate) and date.p05_ns is not None:
        return f"before {iso_time(date.p05_ns)[:16].replace('T', ' ')} UTC, that is within {hours}"
    return f"within {hours}"


def _validity(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    wear, band = found.wear, depth_of(found)
    if not isinstance(wear, assessment.Wear) or band is None or band.median is None or wear.validity.valid:
        return
    ends = [wear.validity.steady_state_to, wear.validity.contact_loss_from or wear.validity.steady_state_to]
    depth = f"{band.median / MICROMETRE:.1f} µm"
    yield Finding(
        subject="validity",
        level="watch",
        reason=f"The wear depth of {depth} is beyond the validity of the model ({min(ends) / MICROMETRE:.1f} µm).",
        action=f"Measure the wear depth at the next stop: the model's {depth} is an extrapolation.",
    )


def _inspections(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    result = found.wear.inspected if isinstance(found.wear, assessment.Wear) else None
    for compared in result.compared if result else ():
        if compared.contradicts:
            yield Finding(
                subject="inspection",
                level="watch",
                reason=contradiction(compared),
                action="Check tooth, flank and revolution count of the inspection, and measure the wear depth again.",
            )


def _pair(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    pair = found.encoder_pair
    if isinstance(pair, assessment.EncoderPair) and pair.stated is not None and pair.stated.contradicted:
        yield Finding(
            subject="encoder_ratio",
            level="watch",
            reason=f"The encoders' ratio {pair.ratio.value:.4f} contradicts {pair.stated.source}.",
            action="Check the tooth counts in the rig file and the edges per revolution of both encoders.",
        )


def _basis(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    if isinstance(found.wear, assessment.Unavailable) and found.baseline is None:
        yield Finding(
            subject="basis",
            level="no_verdict",
            reason=sentence(f"The machine cannot be judged: {cause(found.wear.reason)}"),
            action=INCOMPLETE if "the rig file does not give" in found.wear.reason else UNJUDGED,
        )


def _insufficient(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    rest = found.unexplained
    said = (
        found.baseline is None and isinstance(found.wear, assessment.Unavailable) and found.wear.reason == rest.reason
    )
    if rest.verdict == "insufficient_data" and found.baseline is not None:
        yield Finding(
            subject="explanation",
            level="no_verdict",
            reason=sentence(f"The window cannot be judged by the healthy recordings: {rest.reason}"),
            action="Record a window under a load and speed of the healthy recordings, or learn more of them.",
        )
    elif rest.verdict == "insufficient_data" and not said:  # `_basis` gives the reason already
        silent = _without_accelerometer(found)
        what = "The model of the machine is not confirmed yet" if silent else "The vibration is not explained yet"
        also = "mount an accelerometer" if silent else "compare the rig file with the machine"
        yield Finding(
            subject="explanation",
            level="no_verdict",
            reason=sentence(f"{what}: {rest.reason}"),
            action=f"Record further windows, and {also}: {what[:1].lower()}{what[1:]}.",
        )


def _without_accelerometer(found: assessment.Assessment) -> bool:
    """Whether the window has no vibration at all, as that of a machine with encoders only."""
    return found.window is not None and found.window.rms_measured is None and not found.window.indicators


def _depth_as_established(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    doubts = _doubts(found.wear, found.life)
    for finding in _weighed(_depth(found, limits), doubts):
        yield finding if finding.level != "end_of_life" or not doubts else _unsure_end(found, finding)


def _life_as_established(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    return _weighed(_life(found, limits), _doubts(found.life, found.wear))


def _unsure_end(found: assessment.Assessment, finding: Finding) -> Finding:
    """An end of life by a preliminary depth that earlier windows support: certain where its 5th percentile is there."""
    life, band = found.life, depth_of(found)
    assert isinstance(life, assessment.Life)
    if band is not None and band.p05 >= life.limit:
        return finding
    at = _Limit(depth=None if band is None else band.median, limit=life.limit)
    action = f"Stop the machine, measure the wear depth, and replace the gear pair if it is as estimated: {at.said}."
    return finding.model_copy(update={"level": "alarm", "action": action})


def _figures(found: assessment.Assessment, limits: StatusLimits) -> Iterator[Finding]:
    """Figures that are only preliminary leave nothing normal, however far they are from their limits."""
    doubts = _doubts(found.wear, found.life)
    if not doubts or any((*_depth(found, limits), *_life(found, limits))):
        return
    yield Finding(
        subject="preliminary",
        level="no_verdict",
        reason=sentence(f"Wear depth and remaining life are preliminary: {_listed(doubts[0])}"),
        action=imperative(doubts[0].remedies, "Record further windows."),
    )


def _doubts(*parts: Any) -> list[assessment.Preliminary]:
    """Why depth or life is only preliminary, with the measurements that would settle it; empty where neither is."""
    known = (part for part in parts if isinstance(part, assessment.Wear | assessment.Life))
    return [part.preliminary for part in known if part.preliminary is not None]


def _listed(preliminary: assessment.Preliminary) -> str:
    return "; ".join(reason.removesuffix(".") for reason in preliminary.reasons)


def _weighed(findings: Iterable[Finding], doubts: Sequence[assessment.Preliminary]) -> Iterator[Finding]:
    """Findings from figures that are preliminary, with why.

    At most `watch`, with the measurement that would settle it, unless earlier windows of the same gears had established
    the depth and nothing that speaks against it now says anything against them: then level and action stay.
    """
    before = [doubt.before for doubt in doubts]
    for finding in findings:
        if not doubts:
            yield finding
            continue
        reason = f"{finding.reason.removesuffix('.')}, but the figure is preliminary: {_listed(doubts[0])}"
        supported = before[0] if None not in before else None
        if supported is not None:
            yield finding.model_copy(update={"reason": sentence(f"{reason}; {_supported(supported)}")})
            continue
        level: Level = min(finding.level, "watch", key=SEVERITY.index)
        action = imperative(doubts[0].remedies, finding.action)
        yield finding.model_copy(update={"level": level, "reason": sentence(reason), "action": action})


def _supported(before: assessment.EstablishedBefore) -> str:
    """What earlier windows say for a preliminary figure."""
    return (
        f"it counts all the same, because {before.windows} earlier windows had established the depth "
        f"({before.depth / MICROMETRE:.4g} µm at {before.revolutions:,.0f} revolutions) and it has grown on as before"
    )


def imperative(remedies: Iterable[str], otherwise: str) -> str:
    """The first measurement that would settle a preliminary figure, as a sentence; remedies begin with a verb."""
    first = next(iter(remedies), None)
    return otherwise if first is None else sentence(f"{first[:1].upper()}{first[1:]}")


RULES: tuple[Rule, ...] = (
    _depth_as_established,
    _life_as_established,
    _rate,
    *EFFECT_RULES,
    _validity,
    _inspections,
    _pair,
    _basis,
    _insufficient,
    _figures,
)


def findings_of(found: assessment.Assessment, limits: StatusLimits) -> list[Finding]:
    """All findings of an assessment, most severe first."""
    return by_severity(finding for rule in RULES for finding in rule(found, limits))


def normal_reason(found: assessment.Assessment) -> str:
    """What a machine without any finding is said to be, by what it is judged by."""
    if isinstance(found.wear, assessment.Wear):
        what = "what the encoders measure" if _without_accelerometer(found) else "the vibration"
        far = ", and wear is far from its limit" if isinstance(found.life, assessment.Life) else ""
        return f"The twin explains {what}{far}."
    if found.baseline is not None:
        return "The vibration is as in the healthy recordings."
    return "Nothing that calls for attention was found."


def depth_of(found: assessment.Assessment) -> assessment.Interval | None:
    """The largest combined depth [m], of whatever method; None where there is none."""
    wear = found.wear
    if isinstance(wear, assessment.Wear):
        return wear.depth["combined"]
    return wear.depth if isinstance(wear, assessment.LevelWear) else None
