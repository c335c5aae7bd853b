"""The attribution loop: watch the residual window by window, trace it, add the effect, replay the history.

    result = attribute_window(rig, tracing, window, outcome, options)

The twin in use is accompanied by twins with fewer effects (stages.py), so that depth and life are known before and
after each effect. When a trace is made, and with which windows: schedule.py. What of it joins the twin: joining.py.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from twin.assessment import EffectEvent
from twin.errors import NotAvailable, NotConverged
from twin.observed import TRACING, part
from twin.rig import Rig
from twin.scales import Scales
from twin.tracing.attribution import AttributedEffect
from twin.tracing.change_detection import change_indicators, is_new, widened
from twin.tracing.content_left import with_content_left
from twin.tracing.decisions import Decision
from twin.tracing.detectors import non_gear
from twin.tracing.earned import asked_again, refusal_of, refused, with_errors
from twin.tracing.joining import STAYING, LoopResult, joined, same_effect, unattributed_lines, with_found
from twin.tracing.log import changes, decision_event, logged
from twin.tracing.remounts import trace_over_remounts
from twin.tracing.schedule import after_search, after_trace, search_due, thinned, tolerated_misfit, trace_due
from twin.tracing.stages import advanced, staged
from twin.tracing.state import LEAST_WINDOWS, Tracing, TwinStage
from twin.updating.history import UpdateOptions, WindowInput
from twin.updating.update import UpdateOutcome

VERDICTS = {"accept": "accepted", "reject": "rejected", "pin": "pinned"}
NON_GEAR_ONLY = "only non-gear content is searched for, because no model of this machine was updated by a window"

__all__ = ["LoopResult", "attribute_non_gear_content", "attribute_window", "decide"]


def attribute_window(
    rig: Rig, tracing: Tracing, window: WindowInput, outcome: UpdateOutcome, options: UpdateOptions
) -> LoopResult:
    """One window more, which has updated the twin in use already."""
    measurement = outcome.kind == "measurement"
    before = [advanced(rig, stage, window, options) for stage in tracing.stages[:-1]]
    latest = tracing.stages[-1] if tracing.stages else TwinStage(memory=outcome.memory)
    tracing = replace(
        tracing,
        history=thinned(rig, (*tracing.history, window)),
        stages=(*before, staged(rig, latest, window, outcome)),
        measured=tracing.measured + measurement,
    )
    if not measurement or tracing.few_windows:
        return LoopResult(tracing=tracing, outcome=outcome)
    shown = change_indicators(rig, window, outcome)
    if not trace_due(tracing) and not is_new(shown, tracing.signs, Scales.of(rig)):
        return LoopResult(tracing=tracing, outcome=outcome)
    search = search_due(tracing)
    tracing = replace(after_trace(tracing), signs=widened(tracing.signs, shown))
    kept = [f for f in tracing.found if not search or tracing.decisions.get(f.name) in STAYING]
    with part(TRACING):
        try:
            tracing, traced = trace_over_remounts(
                rig, tracing, outcome.memory, kept, tolerated_misfit(tracing, search), options.required
            )  # fmt: skip
        except (NotAvailable, NotConverged) as reason:
            tracing = replace(tracing, latest=replace(tracing.latest, reason=str(reason)))
            return LoopResult(tracing=tracing, outcome=outcome)
        if traced.waiting or search:
            tracing = after_search(tracing, traced.waiting)
        result = joined(rig, tracing, traced, outcome, options)
        tracing = replace(result.tracing, struck=traced.non_gear.struck_shaft)
        return replace(result, tracing=with_content_left(rig, tracing))


def attribute_non_gear_content(
    rig: Rig, tracing: Tracing, window: WindowInput
) -> tuple[Tracing, tuple[EffectEvent, ...]]:
    """One window more of a machine without a model: non-gear content is attributed all the same."""
    history = thinned(rig, (*tracing.history, window))
    seen = [(t.features.revolutions or float(t.index), t.non_gear) for t in history if t.non_gear is not None]
    tracing = replace(tracing, history=history, measured=tracing.measured + 1)
    if len(seen) < LEAST_WINDOWS or tracing.stages:
        return tracing, ()
    floor, teeth = rig.tolerances.acceleration_floor, None
    with suppress(NotAvailable):  # without them, no order of the mesh is known
        teeth = rig.teeth
    content = non_gear.find_non_gear_content(seen, False, noise_floor=floor, teeth=teeth)
    found: tuple[AttributedEffect, ...] = ()
    if content.defect is not None and "bearing_defect" not in tracing.rejected:
        found = (non_gear.attributed(content.defect),)
    found = _with_known(found, tracing, tuple(w.index for w in tracing.history))
    names = {f.name for f in tracing.found}
    asked = tuple(f for f in found if f.name in names or asked_again(rig, tracing, f))
    judged = with_errors(rig, replace(tracing, found=asked))
    gone = {item.name: refusal_of(judged, item, reason) for item, reason in refused(judged)}
    refuted = {name: r for name, r in tracing.refuted.items() if name not in {f.name for f in asked}} | gone
    found = tuple(f for f in asked if f.name not in gone)
    events = tuple(
        e for e in changes(tracing, tracing.found, found) if e.name not in names or e.action == "dropped"
    )  # fmt: skip
    tracing = replace(
        tracing,
        found=found,
        refuted=refuted,
        errors=tuple(e for f, e in zip(judged.found, judged.errors, strict=True) if f.name not in gone),
        unattributed=unattributed_lines(tracing, content),
        unknown=content.sentence(),
        struck=content.struck_shaft,
        latest=replace(tracing.latest, reason=NON_GEAR_ONLY),
    )
    return logged(tracing, events), events


def _with_known(
    found: tuple[AttributedEffect, ...], tracing: Tracing, fitted: tuple[int, ...]
) -> tuple[AttributedEffect, ...]:
    """What was found, with the numbers of before where it is the same; else with the windows that they rest on."""
    known = {f.name: f for f in tracing.found}
    return tuple(
        known[f.name]
        if f.name in known and same_effect(known[f.name], f)
        else replace(f, fitted=fitted).refit_of(known.get(f.name))
        for f in found
    )


def decide(
    rig: Rig, tracing: Tracing, decision: Decision, outcome: UpdateOutcome, options: UpdateOptions
) -> LoopResult:
    """The memory after an engineer's decision; `outcome` of the latest window.

    Raises NotAvailable where an effect is to stay that is not in the twin.
    """
    present = any(f.name == decision.name for f in tracing.found)
    if decision.verb in ("accept", "pin") and not present:
        raise NotAvailable(f"{decision.name} is not in the twin: only an effect that was found can stay")
    decisions = {name: verdict for name, verdict in tracing.decisions.items() if name != decision.name}
    if decision.verb in VERDICTS:
        decisions[decision.name] = VERDICTS[decision.verb]
    judged_again = decision.verb in ("reject", "release")
    tracing = replace(
        logged(tracing, [decision_event(tracing, VERDICTS.get(decision.verb, "released"), decision.name)]),
        decisions=decisions,
        next_search=tracing.measured + 1 if judged_again else tracing.next_search,
        next_trace=tracing.measured + 1,
    )
    rest = tuple(f for f in tracing.found if f.name not in tracing.rejected)
    if len(rest) == len(tracing.found):
        return LoopResult(tracing=tracing, outcome=outcome)
    return with_found(rig, tracing, rest, outcome, options)
