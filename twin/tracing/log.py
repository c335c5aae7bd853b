"""Changes of the effects in the twin, as they are reported and kept."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from twin.assessment import EffectEvent, Evidence
from twin.tracing.attribution import AttributedEffect
from twin.tracing.state import Tracing, parameters_of

MOST_ENTRIES = 200  # of the log


def evidence_of(item: AttributedEffect, rivals: Sequence[str] = ()) -> Evidence:
    """What speaks for an effect; `rivals` are what held-out windows cannot tell it from."""
    return Evidence(
        log_evidence=item.log_evidence,
        runner_up=item.runner_up,
        over_runner_up=item.over_runner_up,
        indistinguishable_from=tuple(sorted({*item.alike, *rivals})),
        detail=item.detail,
    )


def event_of(tracing: Tracing, action: str, item: AttributedEffect) -> EffectEvent:
    """An effect that was found, changed or dropped at the latest window."""
    last = tracing.history[-1] if tracing.history else None
    return EffectEvent(
        action=action,
        name=item.name,
        window=None if last is None else last.index,
        revolutions=None if last is None else last.features.revolutions,
        parameters=parameters_of(item),
        evidence=evidence_of(item),
        onset_revolutions=item.addition.onset_revolutions,
    )


def decision_event(tracing: Tracing, action: str, name: str) -> EffectEvent:
    """A decision that an engineer has taken on an effect."""
    last = tracing.history[-1] if tracing.history else None
    return EffectEvent(
        action=action,
        name=name,
        window=None if last is None else last.index,
        revolutions=None if last is None else last.features.revolutions,
    )


def changes(
    tracing: Tracing, before: Iterable[AttributedEffect], now: Sequence[AttributedEffect]
) -> tuple[EffectEvent, ...]:
    """What became of the effects from one set to the next: found or changed ones first, then those dropped."""
    old, new = {f.name: f for f in before}, {f.name: f for f in now}
    events = [
        event_of(tracing, "changed" if name in old else "found", item)
        for name, item in new.items()
        if name not in old or old[name].addition != item.addition
    ]
    return (*events, *(event_of(tracing, "dropped", item) for name, item in old.items() if name not in new))


def logged(tracing: Tracing, events: Iterable[EffectEvent]) -> Tracing:
    """The memory with more entries of the log, the oldest dropped."""
    return replace(tracing, log=(*tracing.log, *events)[-MOST_ENTRIES:])
