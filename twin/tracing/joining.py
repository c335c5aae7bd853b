"""From the effects that a trace has found to the effects in the twin: kept, replaced, refused or dropped."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.assessment import EffectEvent, SpectralLine
from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.earned import asked_again, implausible, refusal_of, refused, with_errors
from twin.tracing.findings import NonGearContent
from twin.tracing.log import changes, logged
from twin.tracing.mesh_fits import ALIKE, MeshSearchThresholds
from twin.tracing.stages import Replayed, with_effects
from twin.tracing.state import TraceSummary, Tracing, relevant
from twin.tracing.trace import Traced
from twin.updating.conditions import kind_of
from twin.updating.history import UpdateOptions
from twin.updating.update import UpdateOutcome

MOST_LINES = 12  # unattributed lines that are reported
LEVEL_WINDOWS = 3  # latest windows whose level unattributed lines are compared with
STAYING = ("accepted", "pinned")


@dataclass(frozen=True, slots=True, kw_only=True)
class JoiningLimits:
    """When a refit replaces the effect in the twin."""

    same_onset: float = deciding(
        1.0,
        unit="revolutions",
        meaning="difference of onset up to which a refit is the same effect",
        source="derivation: onsets are revolution counts of windows, so that equal ones differ by rounding only",
    )
    changed_std: float = deciding(
        1.0,
        of="standard deviation of the parameter",
        meaning="change of a parameter that is worth replaying the history",
        source="derivation: a smaller change is within the parameter's own uncertainty",
    )
    changed_share: float = deciding(
        0.1,
        of="value of the parameter",
        meaning="change of a parameter that is worth replaying the history",
        source="not derived: chosen",
    )


JOINING_LIMITS = JoiningLimits()


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopResult:
    """The memory after a window, the twin with what was found, and what happened."""

    tracing: Tracing
    outcome: UpdateOutcome
    again: Replayed = ()  # the latest windows as the changed twin was updated by them, oldest first
    events: tuple[EffectEvent, ...] = ()


def joined(rig: Rig, tracing: Tracing, traced: Traced, outcome: UpdateOutcome, options: UpdateOptions) -> LoopResult:
    """The twin with the effects of a trace that have earned their place (earned.py)."""
    old, refuted = {f.name: f for f in tracing.found}, {}
    new: list[AttributedEffect] = []
    for item in _candidates(rig, tracing, traced):
        reason = None if item.name in tracing.fixed else implausible(rig, item)
        if reason is not None:
            refuted[item.name] = refusal_of(tracing, item, reason)
        elif item.name in old or asked_again(rig, tracing, item):
            new.append(item)
        else:
            refuted[item.name] = tracing.refuted[item.name]
    tracing = replace(_summarised(tracing, traced), refuted=refuted)
    changed = _with(rig, tracing, tuple(new), outcome, options)
    while doubted := refused(changed.tracing):
        refuted = refuted | {item.name: refusal_of(changed.tracing, item, reason) for item, reason in doubted}
        tracing = replace(tracing, refuted=refuted)
        rest = tuple(f for f in changed.tracing.found if all(f is not item for item, _ in doubted))
        changed = _with(rig, tracing, rest, outcome, options)
    return changed


def _with(
    rig: Rig, tracing: Tracing, found: tuple[AttributedEffect, ...], outcome: UpdateOutcome, options: UpdateOptions
) -> LoopResult:
    """The twin with these effects; the history is replayed only where they are others."""
    if [f.addition for f in found] == [f.addition for f in tracing.found]:
        return LoopResult(tracing=with_errors(rig, replace(tracing, found=found)), outcome=outcome)
    return with_found(rig, tracing, found, outcome, options)


def with_found(
    rig: Rig,
    tracing: Tracing,
    found: tuple[AttributedEffect, ...],
    outcome: UpdateOutcome,
    options: UpdateOptions,
) -> LoopResult:
    """The twin with other effects: the history is replayed for every stage that they change."""
    stages, again = with_effects(
        rig, tracing, relevant(tracing.found), relevant(found), options
    )  # fmt: skip
    if again and again[-1][0] is tracing.history[-1]:
        outcome = replace(again[-1][1], memory=stages[-1].memory)
    else:
        outcome = replace(outcome, memory=stages[-1].memory)
    events = changes(tracing, tracing.found, found)
    tracing = logged(replace(tracing, found=found, stages=stages, errors=()), events)
    return LoopResult(tracing=with_errors(rig, tracing), outcome=outcome, again=again, events=events)


def _candidates(rig: Rig, tracing: Tracing, traced: Traced) -> list[AttributedEffect]:
    """What the trace has found, where it is the same as before with the numbers of before; in the order found.

    Whatever speaks as well for a rival as for it, is indistinguishable from it.
    """
    old = {f.name: f for f in tracing.found}
    measured = tuple(w.index for w in tracing.history if kind_of(w.features, rig) == "measurement")
    new: list[AttributedEffect] = []
    for item in traced.found:
        known = old.get(item.name)
        if known is not None and (tracing.decisions.get(item.name) == "pinned" or same_effect(known, item)):
            item = replace(
                known,
                log_evidence=item.log_evidence,
                runner_up=item.runner_up,
                over_runner_up=item.over_runner_up,
                alike=item.alike,
                detail=item.detail,
            )
        else:
            by_all = item.addition.effect.facts.claims == "envelope"
            item = replace(item, fitted=measured if by_all else traced.fitted).refit_of(known)
        new.append(with_rivals(item))
    names = {f.name for f in new}
    new += [f for f in tracing.found if f.name not in names and tracing.decisions.get(f.name) in STAYING]
    rank = {name: i for i, name in enumerate(old)}
    return sorted(new, key=lambda f: rank.get(f.name, len(rank)))


def with_rivals(item: AttributedEffect, limits: MeshSearchThresholds = ALIKE) -> AttributedEffect:
    """The effect with its runner-up among what it cannot be told from, where it has hardly more evidence."""
    behind, runner_up = item.over_runner_up, item.runner_up
    if runner_up is None or behind is None or behind > limits.indistinguishable_within or runner_up in item.alike:
        return item
    return replace(item, alike=tuple(sorted((*item.alike, runner_up))))


def _summarised(tracing: Tracing, traced: Traced) -> Tracing:
    """The memory with what a trace says beside its effects."""
    return replace(
        tracing,
        unattributed=unattributed_lines(tracing, traced.non_gear),
        unknown=traced.non_gear.sentence(),
        latest=TraceSummary(
            candidates=tuple((name, float(gain)) for name, gain in traced.table) or tracing.latest.candidates,
            other_structure=bool(traced.other_structure),
            misfit_before=_number(traced.misfit_before),
            misfit_after=_number(traced.misfit_after),
            held_out=tuple(traced.held_out),
            fitted=tuple(traced.fitted),
            skipped=tuple(traced.skipped),
        ),
    )


def _number(value: float | None) -> float | None:
    return None if value is None else float(value)


def same_effect(old: AttributedEffect, new: AttributedEffect, limits: JoiningLimits = JOINING_LIMITS) -> bool:
    """Whether a refit says what the twin has already."""
    if not _same_law(old, new, limits):
        return False
    if type(old.addition.effect) is not type(new.addition.effect) or set(old.parameters) != set(new.parameters):
        return False
    law, grown = new.addition.law, old.addition.effect
    if law.kind == "linear":  # as large as the effect in the twin has become by the latest window
        grown = old.addition.at(law.revolutions[0]) or grown
    replayed = new.addition.effect.facts.changes_mesh_lines or new.addition.effect.facts.acts_on != "unknown"
    share = limits.changed_share if replayed else 0.0
    for name, (value, _, std) in new.parameters.items():
        before = getattr(grown, name, old.parameters[name][0]) if law.kind == "linear" else old.parameters[name][0]
        if abs(value - before) > max(limits.changed_std * std, share * abs(before)):
            return False
    return True


def _same_law(old: AttributedEffect, new: AttributedEffect, limits: JoiningLimits) -> bool:
    """Whether onset and law of a refit are those of the effect in the twin: a growing one's within its std."""
    before, now = old.addition, new.addition
    grows = now.law.kind == "linear"
    allowed = max(limits.same_onset, (new.onset_std or 0.0) * limits.changed_std) if grows else limits.same_onset
    if abs(before.onset_revolutions - now.onset_revolutions) > allowed or before.law.kind != now.law.kind:
        return False
    if grows:
        return True
    knots = zip(before.law.revolutions, now.law.revolutions, strict=False)
    factors = zip(before.law.factors, now.law.factors, strict=False)
    share = max(limits.changed_share, 0.0 if new.change_std is None else new.change_std[1] * limits.changed_std)
    same = len(before.law.revolutions) == len(now.law.revolutions)
    return (
        same and all(abs(a - b) <= limits.same_onset for a, b in knots) and all(abs(a - b) <= share for a, b in factors)
    )


def unattributed_lines(tracing: Tracing, content: NonGearContent) -> tuple[SpectralLine, ...]:
    """Lines that no gear makes, by frequency and order, the strongest first."""
    windows = [t for t in tracing.history if t.features.speed_hz and t.features.rms]
    if not (content.unknown or content.forces) or not windows:
        return ()
    speed = windows[-1].features.speed_hz or 1.0
    energy = float(np.mean([(t.features.rms or 0.0) ** 2 for t in windows[-LEVEL_WINDOWS:]]))
    seen: list[tuple[float, float, float | None, str]] = [
        (tone.frequency / speed, tone.frequency, max((a or 0.0) for a in tone.amplitudes), "steady in hertz")
        for tone in content.tones
    ]
    seen += [(order, order * speed, amplitude, "order of no shaft") for order, amplitude in content.orders]
    seen += [(order, order * speed, level, "force that turns with the pinion") for order, level in content.forces]
    lines = [
        SpectralLine(
            order=float(o), frequency=float(f), share=None if a is None else float(0.5 * a**2 / energy), kind=kind
        )
        for o, f, a, kind in seen
    ]
    return tuple(sorted(lines, key=lambda line: -(line.share or 0.0))[:MOST_LINES])
