"""Wear, life, residual and effects by the model of the machine, where the rig file suffices for one.

A window that cannot update the model (a channel is missing, or no steady state was found) says so in its record and
leaves the answer as the latest window has left it: that is not the same as a machine without a model.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from twin.assessment import (
    Assessment,
    Event,
    LevelWear,
    Life,
    LifeEvent,
    Unavailable,
    UpdateEvent,
    Wear,
    WindowAssessment,
)
from twin.capabilities.context import Context, Draft, carried_over
from twin.errors import NotAvailable, NotConverged
from twin.inspected import with_inspections
from twin.preliminary import Confidence, confidence_of, history_after
from twin.rig import Rig
from twin.state import LatestParts, State
from twin.tracing.attribution_loop import LoopResult, attribute_window
from twin.tracing.stages import staged
from twin.tracing.state import Tracing, TwinStage
from twin.tracing.summary import attribution_of, effects_of
from twin.tracing.unexplained import doubts_of, unexplained_of, with_unknown_content
from twin.tracing.wear_alone import band_of_wear_alone
from twin.updating.calibrated import calibration_of
from twin.updating.history import WindowInput, update_window
from twin.updating.life import life_of
from twin.updating.rate_change import rate_change
from twin.updating.residual import WindowResidual, residual_of_window, residual_over
from twin.updating.running_time import dated
from twin.updating.update import NEEDED, UpdateOutcome
from twin.updating.wear_now import as_age_allows, depth_of, methods_of, wear_coefficient, wear_of

RATTLE = (
    "tooth separation (rattle) detected: wear depth and remaining life are not available, because there is no steady "
    "mesh to estimate them from"
)
RECENT = 3  # windows that the residual is computed over


def applies(context: Context, draft: Draft) -> bool:
    """Where the rig file gives all that a model needs."""
    return context.rig.has(*NEEDED)


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with everything that the model says, or with the reason why this window says nothing."""
    rig, state, options = context.rig, context.state, context.options
    try:
        outcome = update_window(rig, state.memory, context.input, options.updating(rig))
    except NotAvailable as reason:
        return carried_over(context, str(reason))
    except NotConverged as reason:
        return carried_over(context, f"the model found no steady state for this window and was not updated: {reason}")
    if options.trace:
        result = attribute_window(rig, state.tracing, context.input, outcome, options.updating(rig))
    else:
        result = LoopResult(tracing=_updated(rig, state.tracing, context.input, outcome), outcome=outcome)
    recent = recent_residuals(rig, state.recent, ((context.input, result.outcome),))
    if result.again:
        recent = recent_residuals(rig, (), result.again)
    alone = band_of_wear_alone(rig, result.tracing)
    confidence = confidence_of(rig, result.outcome, result.tracing.error, state.history, alone=alone)
    assessment = answer_of(rig, state, result.tracing, recent, result.outcome, confidence)
    record = _with_answer(_record(context, result.outcome, result.tracing, confidence), assessment.wear)
    index = context.input.index if isinstance(assessment.wear, Wear) else None
    history = history_after(rig, state.history, result.outcome, confidence, index)
    events: list[Event] = [*result.events]
    if result.outcome.updated:
        events.append(UpdateEvent(window=record))
    if result.outcome.kind == "measurement" and isinstance(assessment.life, Life):
        events.append(LifeEvent(life=assessment.life))
    return replace(
        draft,
        state=replace(state, recent=recent, latest=latest_of(assessment), tracing=result.tracing, history=history),
        assessment=replace(assessment, window=record, events=tuple(events)),
        modelled=True,
        judged=True,
    )


def answer_of(
    rig: Rig,
    state: State,
    tracing: Tracing,
    recent: tuple[WindowResidual, ...],
    outcome: UpdateOutcome,
    confidence: Confidence,
) -> Assessment:
    """The answer of a machine with a model, without a window's record."""
    unexplained = unexplained_of(recent, doubts_of(rig, outcome), tracing.error)
    wear, life = with_inspections(
        rig, outcome.memory, *_wear_and_life(rig, tracing, outcome, confidence), state.inspections, outcome.age_known
    )  # fmt: skip
    wear, life = as_age_allows(outcome, wear, life)
    life = dated(rig, life, state.running)
    return Assessment(
        window=None,
        wear=wear,
        life=life,
        residual=residual_over(recent),
        effects=effects_of(rig, tracing),
        unexplained=with_unknown_content(tracing, replace(unexplained, struck=tracing.struck)),
        calibration=calibration_of(rig, outcome.memory),
        attribution=attribution_of(tracing),
        verdict=state.rhythm.verdict_window(),
    )


def _wear_and_life(
    rig: Rig, tracing: Tracing, outcome: UpdateOutcome, confidence: Confidence
) -> tuple[Wear | Unavailable, Life | Unavailable]:
    """Depth and life with what speaks against relying on them, or why they are not available."""
    missing = _why_none(tracing, confidence)
    if missing is not None:
        return Unavailable(reason=missing), Unavailable(reason=missing)
    wear = wear_of(rig, replace(outcome, depth_band=confidence.band))
    life = life_of(rig, outcome, confidence.life_doubt)
    if isinstance(life, Life) and confidence.no_life is not None:
        life = Unavailable(reason=f"remaining life is not available: {confidence.no_life}")
    if isinstance(life, Life):
        life = replace(life, preliminary=confidence.life)
    memory = outcome.memory
    changed = rate_change(memory.rms_points if outcome.method == "rms" else memory.points)
    return replace(wear, preliminary=confidence.depth, rate_change=changed), life


def _why_none(tracing: Tracing, confidence: Confidence) -> str | None:
    """Why neither depth nor life is available; None where they are."""
    if separates_teeth(tracing):
        return RATTLE
    if confidence.missing is not None:
        return f"wear depth and remaining life are not available: {confidence.missing}"
    return None


def latest_of(assessment: Assessment) -> LatestParts:
    """The parts of an answer that later windows may carry over."""
    return LatestParts(
        wear=assessment.wear,
        life=assessment.life,
        residual=assessment.residual,
        unexplained=assessment.unexplained,
        calibration=assessment.calibration,
    )


def recent_residuals(
    rig: Rig, before: tuple[WindowResidual, ...], windows: Iterable[tuple[WindowInput, UpdateOutcome]]
) -> tuple[WindowResidual, ...]:
    """The latest windows' residuals with more windows."""
    recent = before
    for window, outcome in windows:
        if outcome.kind == "measurement":
            residual = residual_of_window(window.features, outcome, rig.teeth)
            if residual is not None:
                recent = (*recent, residual)[-RECENT:]
    return recent


def separates_teeth(tracing: Tracing) -> bool:
    """Whether an effect is in the twin that leaves no steady mesh."""
    return any(found.addition.effect.facts.separates_teeth for found in tracing.found)


def _updated(rig: Rig, tracing: Tracing, window: WindowInput, outcome: UpdateOutcome) -> Tracing:
    """The memory after a window whose effects are not sought: of the twin in use alone."""
    latest = tracing.stages[-1] if tracing.stages else TwinStage(memory=outcome.memory)
    return replace(tracing, stages=(*tracing.stages[:-1], staged(rig, latest, window, outcome)))


def _record(context: Context, outcome: UpdateOutcome, tracing: Tracing, confidence: Confidence) -> WindowAssessment:
    features, rig = context.features, context.rig
    loss = None if outcome.expectation is None else outcome.expectation.contact_loss
    missing = _why_none(tracing, confidence)
    record = WindowAssessment(
        index=context.input.index,
        kind=outcome.kind,
        start_time_ns=features.start_time_ns,
        revolutions=features.revolutions,
        speed=features.speed_hz,
        torque=features.torque_nm,
        rms_measured=features.rms,
        rms_predicted=float(outcome.rms_predicted),
        rms_after=float(outcome.rms_after),
        updated=outcome.updated,
        wear_coefficient=wear_coefficient(rig, outcome),
        depth=depth_of(replace(outcome, depth_band=confidence.band)),
        method=outcome.method,
        methods=methods_of(rig, outcome),
        contact_loss=None if loss is None or loss != loss else float(loss),
        mesh_bands=features.mesh_bands,
        notes=outcome.notes,
        unavailable=dict(features.unavailable),
    )
    if missing is None:
        return record
    return replace(
        record, wear_coefficient=None, depth=None, method=None, methods=None, notes=(*record.notes, missing)
    )  # fmt: skip


def _with_answer(record: WindowAssessment, wear: Wear | LevelWear | Unavailable) -> WindowAssessment:
    """The record with the depth and the coefficient of the answer, where the window's own are not all that it says."""
    if not isinstance(wear, Wear):
        return record
    if wear.depth["combined"].median is None:
        return replace(record, depth=wear.depth["combined"], methods=None)
    if wear.inspected is None:
        return record
    return replace(record, depth=wear.depth["combined"], wear_coefficient=wear.wear_coefficient)


def state_after(state: State, tracing: Tracing, recent: tuple[WindowResidual, ...], assessment: Assessment) -> State:
    """The state after a change of the twin that no window made."""
    return replace(state, recent=recent, latest=latest_of(assessment), tracing=tracing)
