"""One measurement window in, one assessment out.

    state, assessment = step(rig, state, window)
    state, assessment = inspect(rig, state, inspection)

No hidden memory: the same three things give the same answer. `State.to_dict()` is a checkpoint. What the twin can say
of a machine is a list of capabilities (twin/capabilities), each of which says whether it applies.
"""

from __future__ import annotations

from dataclasses import replace

from twin.assessment import (
    Assessment,
    CountEvent,
    EffectEvent,
    EncoderPair,
    Life,
    LifeEvent,
    Unavailable,
    Wear,
    WindowEvent,
)
from twin.capabilities import CAPABILITIES
from twin.capabilities.context import Context, answer_as_of, carried_over
from twin.capabilities.modelled import answer_of, recent_residuals, state_after
from twin.encoder_pair.assessing import assess_pair
from twin.errors import NotAvailable, WindowError
from twin.fallen_count import OWN, count_restarted, with_count_checked
from twin.features.extract import WindowSignals, extract
from twin.features.non_gear import non_gear_features
from twin.features.window_features import WindowFeatures
from twin.inspected import with_inspections
from twin.machine_change import MachineChange
from twin.machine_changes import changed
from twin.options import Options
from twin.preliminary import confidence_of
from twin.revolution_count import CountOffset, counted
from twin.rig import Rig
from twin.state import State
from twin.tracing.attribution_loop import decide as decided
from twin.tracing.decisions import Decision
from twin.tracing.stages import replay
from twin.tracing.wear_alone import band_of_wear_alone
from twin.updating.changing_speed import with_changing_speed
from twin.updating.conditions import swing_of
from twin.updating.history import WindowInput
from twin.updating.inspections import Inspection, with_inspection
from twin.updating.running_time import dated, with_mark
from twin.updating.update import NEEDED
from twin.windows import Window

DEFAULT = Options()
LEVEL_FAULTS = ("clipping", "stuck")  # faults of an accelerometer that falsify its level
TORQUE_FAULTS = ("clipping", "stuck", "out_of_range")  # faults of a torque meter that falsify its mean
NO_TORQUE = ("stuck",)  # faults after which its mean is any value; clipped peaks move it by little

DONE = {
    "gears_replaced": "the gears have been replaced,",
    "sensor_moved": "an accelerometer has been moved,",
    "oil_changed": "the oil has been changed,",
    "counter_reset": "the revolution counter has been reset,",
    "reassembled": "the gears have been reassembled,",
}

__all__ = ["Options", "State", "change", "decide", "inspect", "step"]


def step(rig: Rig, state: State, window: Window, options: Options = DEFAULT) -> tuple[State, Assessment]:
    """Updates the twin of a machine by one window; raises WindowError where the window cannot be used at all.

    A CountFellError carries the state that remembers the fallen count; go on from it.

    What the rig file or the channels do not allow is reported as not available, with the reason.
    """
    context = _context(rig, state, window, options)
    state = context.state
    draft = carried_over(context, _why_no_model(rig))
    for capability in CAPABILITIES:
        if capability.applies(context, draft):
            draft = capability.assess(context, draft)
    record = draft.record
    missing = None if draft.judged else (*record.notes, "it was not assessed")[0]
    rhythm = state.rhythm.with_window(record.index, record.start_time_ns, missing)
    restarted = () if context.restarted is None else (context.restarted,)
    events = (WindowEvent(window=record), *restarted, *draft.assessment.events)
    found, latest = draft.assessment, draft.state.latest
    if draft.judged:
        latest = replace(latest, unexplained=found.unexplained, detectable=found.detectable)
    return (
        replace(draft.state, windows_seen=state.windows_seen + 1, rhythm=rhythm, latest=latest),
        replace(found, events=events, verdict=rhythm.verdict_window()),
    )


def _context(rig: Rig, state: State, window: Window, options: Options) -> Context:
    """The window's features; WindowError where it has neither a level nor a speed nor a pair in motion."""
    signals = WindowSignals(rig, window)
    measured = with_changing_speed(rig, extract(rig, window, signals))
    state, restarted = _with_count_followed(rig, state, measured, options)
    count, features = counted(state.count, measured, rig.gear_age)
    pair = None if rig.has(*NEEDED) else assess_pair(rig, window, state.windows_seen)
    if features.rms is None and features.speed_hz is None and not isinstance(pair, EncoderPair):
        reasons = [*features.unavailable.values(), *([pair.reason] if isinstance(pair, Unavailable) else [])]
        raise WindowError(
            f"the window has neither a usable vibration level nor a shaft speed: {'; '.join(dict.fromkeys(reasons))}"
        )
    state = with_count_checked(rig, replace(state, count=count), features)
    if features.revolutions is not None:
        state = replace(state, counted=max(state.counted, features.revolutions))
    marks = with_mark(state.running, window.start_time_ns, features.revolutions, features.speed_hz)
    return Context(
        rig=rig,
        state=replace(state, running=marks),
        window=window,
        options=options,
        signals=signals,
        input=_window_input(signals, state, features, options),
        pair=pair,
        restarted=restarted,
    )


def _with_count_followed(
    rig: Rig, state: State, measured: WindowFeatures, options: Options
) -> tuple[State, CountEvent | None]:
    """The state after a count of the same gears has begun again, and how; itself where none has."""
    restarted = count_restarted(state, measured)
    if restarted is None:
        return state, None
    state = changed(rig, state, MachineChange(kind="counter_reset"), options)
    offset = restarted.revolutions - restarted.count
    return replace(state, count=CountOffset(offset=offset, own=restarted.reason == OWN)), restarted


def _window_input(signals: WindowSignals, state: State, features: WindowFeatures, options: Options) -> WindowInput:
    rig, window = signals.rig, signals.window
    beside = non_gear_features(rig, window, signals=signals) if options.trace else None
    return WindowInput(
        index=state.windows_seen,
        features=features,
        level_fault=_fault_of(window, f"accel/{features.sensor}", LEVEL_FAULTS),
        torque_fault=_fault_of(window, "torque/pinion", TORQUE_FAULTS) or swing_of(beside, features.torque_nm),
        torque_unknown=_fault_of(window, "torque/pinion", NO_TORQUE),
        non_gear=beside,
    )


def _fault_of(window: Window, channel: str, kinds: tuple[str, ...]) -> str | None:
    """Why a channel may not be relied on in this window; None where it may."""
    for fault in window.faults:
        if fault.channel == channel and fault.action == "degraded" and fault.kind in kinds:
            return f"{fault.channel}: {fault.kind}, {fault.detail}"
    return None


def _why_no_model(rig: Rig) -> str:
    """Why the rig file allows no model of the machine."""
    try:
        rig.require("wear", *NEEDED)
    except NotAvailable as reason:
        return str(reason)
    return "no window has updated the model of this machine yet"


def change(rig: Rig, state: State, made: MachineChange, options: Options = DEFAULT) -> tuple[State, Assessment]:
    """Follows a change of the machine; the assessment has no record of a window.

    What the change ends is not available until a window of the time after it has been assessed.
    """
    state = changed(rig, state, made, options)
    found = answer_as_of(rig, state, f"{DONE[made.kind]} and no window has been assessed since")
    return state, replace(found, revolutions=_run(state))


def inspect(rig: Rig, state: State, inspection: Inspection) -> tuple[State, Assessment]:
    """A measured wear depth becomes part of the estimate; the assessment has no record of a window.

    Where the latest windows give no wear by a model, the inspection is kept and counts from the first that does.
    """
    inspections = with_inspection(state.inspections, inspection)
    latest = state.latest
    if isinstance(latest.wear, Wear) and isinstance(latest.life, (Life, Unavailable)):
        wear, life = with_inspections(
            rig, state.memory, latest.wear, latest.life, inspections, state.count.age(rig.gear_age).known
        )
        latest = replace(latest, wear=wear, life=dated(rig, life, state.running))
    state = replace(state, inspections=inspections, latest=latest)
    events = (LifeEvent(life=latest.life),) if isinstance(latest.life, Life) else ()
    return state, replace(answer_as_of(rig, state, _why_no_model(rig)), events=events, revolutions=_run(state))


def _run(state: State) -> float | None:
    """Revolutions of the pinion so far."""
    return state.running[-1].revolutions if state.running else None


def decide(rig: Rig, state: State, decision: Decision, options: Options = DEFAULT) -> tuple[State, Assessment]:
    """Follows an engineer's decision about an effect; the assessment has no record of a window.

    Raises NotAvailable where it cannot be followed: nothing is traced yet, or the effect is not in the twin.
    """
    history = state.tracing.history
    if not history:
        raise NotAvailable("no effect can be decided on before the first window has been taken and traced")
    latest = history[-1]
    _, outcomes = replay(rig, state.tracing, state.memory.effects, options.updating(rig))
    known = [(t, o) for t, o in zip(history, outcomes, strict=True) if o is not None]
    if not known:
        raise NotAvailable(f"the history up to window {latest.index} has no steady state")
    outcome = replace(known[-1][1], memory=state.memory)
    result = decided(rig, state.tracing, decision, outcome, options.updating(rig))
    recent = recent_residuals(rig, (), result.again or tuple(known))
    alone = band_of_wear_alone(rig, result.tracing)
    confidence = confidence_of(
        rig, result.outcome, result.tracing.error, state.history, alone=alone, again=True
    )  # fmt: skip
    assessment = answer_of(rig, state, result.tracing, recent, result.outcome, confidence)
    event = EffectEvent(action=decision.verb, name=decision.name, window=latest.index)
    assessment = replace(assessment, events=(*result.events, event), revolutions=_run(state))
    return state_after(state, result.tracing, recent, assessment), assessment
