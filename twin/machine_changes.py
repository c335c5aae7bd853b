"""What people change on a machine, and what of the twin's memory each change ends.

    state = changed(rig, state, MachineChange(kind="gears_replaced"))

| remembered of the machine | gears_replaced | sensor_moved | oil_changed | counter_reset | reassembled |
| --- | --- | --- | --- | --- | --- |
| wear depth and profile | unworn | kept | kept | kept | kept |
| wear coefficient | prior: learned value, wider | kept | kept, wider | kept | kept |
| revolutions | since replaced | kept | kept | go on by an offset | kept |
| mesh stiffness, contact half-width | kept | kept | kept | kept | kept |
| damping, compliance outside the mesh | kept | kept | kept | kept | rig file's again |
| transfer path to the accelerometer | kept | learned anew | kept | kept | learned anew |
| phase of the mesh, offset of the discs | anew | kept | kept | anew | anew |
| effects | ended where they say so (`Facts.ended_by`) | same | same | same | same |
| windows that the search for effects compares | those since | those since | all | those since | those since |
| levels by operating condition | anew | anew, of that sensor | kept | kept | anew |
| vibration levels of the first windows | anew | anew, of that sensor | kept | kept | anew |
| records of NA4 | anew | anew, of that sensor | kept | kept | anew |
| healthy baseline | not comparable | that sensor is not | kept | kept | not comparable |
| windows with an established depth | anew | kept | kept | kept | anew |

An effect that does not end keeps its place and its numbers; it is searched for again as soon as enough windows have
come since the change, and leaves only where they speak against it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from twin.baseline.learned import Baseline
from twin.baseline.validity import WHOLE, identity_of
from twin.effects.addition import Addition
from twin.established import History
from twin.machine_change import MachineChange
from twin.model import Calibration
from twin.options import Options
from twin.rig import Rig
from twin.state import LatestParts, State
from twin.tracing.state import LEAST_WINDOWS, TraceSummary, Tracing, TwinStage, relevant
from twin.updating.calibration import PRIOR, Fit
from twin.updating.carried_over import for_next_pair, with_wider_rate
from twin.updating.memory import Memory
from twin.updating.segments import segment_begun


def changed(rig: Rig, state: State, change: MachineChange, options: Options | None = None) -> State:
    """The state after a change of the machine: a pure function, for machines with a model and without."""
    options = options or Options()
    if change.kind == "gears_replaced":
        state = _without_wear(state)
    elif change.kind == "sensor_moved":
        state = _without_path(rig, state, change.sensor or "")
    elif change.kind == "oil_changed":
        state = replace(state, tracing=_each_stage(state.tracing, with_wider_rate, widened=state.windows_seen))
    elif change.kind == "counter_reset":
        tracing = _since_now(state.tracing, lambda m: _without_discs(segment_begun(rig, m)))
        state = replace(state, tracing=replace(_without(tracing, change.kind), phase=None, turns=()))
    else:
        state = _reassembled(rig, state)
    if change.kind in ("gears_replaced", "counter_reset"):
        count = state.count.awaiting(change.kind, state.counted, change.at, change.began, rig.gear_age)
        state = replace(state, count=count, counted=0.0 if change.kind == "gears_replaced" else state.counted)
        state = replace(state, fallen=None)
    if change.kind in ("gears_replaced", "reassembled"):
        state = replace(state, history=History(), rhythm=state.rhythm.begun_anew(), learned_levels=())
    return replace(state, outdated={**state.outdated, **_outdated(change, options.baseline)})


def _outdated(change: MachineChange, baseline: Baseline | None) -> dict[str, str]:
    """The baseline that no longer holds, by what of it does not."""
    if baseline is None or change.kind not in ("gears_replaced", "reassembled", "sensor_moved"):
        return {}
    return {change.sensor or WHOLE: identity_of(baseline)}


# -- the kinds -------------------------------------------------------------------------------------------


def _without_wear(state: State) -> State:
    """New flanks on the same machine: what was learned of the structure and the path is kept, wear begins again."""
    tracing = state.tracing
    found = tuple(f for f in tracing.found if not _ends(f.addition, "gears_replaced"))
    memory = for_next_pair(tracing.memory)
    additions = relevant(found)
    stages = [TwinStage(memory=replace(memory, effects=additions[:n])) for n in range(len(additions) + 1)]
    kept = {f.name for f in found}
    tracing = Tracing(
        start=memory,
        found=found,
        stages=tuple(stages) if tracing.stages else (),
        decisions={name: verdict for name, verdict in tracing.decisions.items() if name in kept},
        errors=(),
        log=tracing.log,
    )
    calibration = state.latest.calibration
    return replace(
        state,
        recent=(),
        running=(),
        inspections=(),
        latest=LatestParts(calibration=calibration),
        levels={},
        residual_records=(),
        tracing=tracing,
    )


def _without_path(rig: Rig, state: State, sensor: str) -> State:
    """The machine with an accelerometer elsewhere: its level and the path to it are unknown, wear is not."""
    records = tuple(r for r in state.residual_records if r.sensor != sensor)
    state = replace(state, residual_records=records)
    if sensor != rig.accelerometer:
        return state
    tracing = _since_now(state.tracing, lambda m: _at_new_place(segment_begun(rig, m)))
    return replace(state, recent=(), levels={}, learned_levels=(), tracing=_without(tracing, "sensor_moved"))


def _at_new_place(memory: Memory) -> Memory:
    """The memory without what the accelerometer taught: the path, and levels that the calibration rests on."""
    deaf = tuple(replace(w, acceleration=None) for w in memory.unworn)
    return replace(memory, path=(), unworn=deaf)


def _reassembled(rig: Rig, state: State) -> State:
    """The same gears put together again: their wear and their stiffness are known, the rest of the machine is not."""
    tracing = _since_now(state.tracing, lambda m: _put_together(rig, segment_begun(rig, m)))
    tracing = replace(_without(tracing, "reassembled"), phase=None, turns=())
    return replace(state, recent=(), levels={}, residual_records=(), tracing=tracing)


def _put_together(rig: Rig, memory: Memory) -> Memory:
    """The memory with the rig file's damping, and without path, phase and discs."""
    memory = replace(_without_discs(memory), path=(), mesh=(), compliance_scale=1.0)
    if memory.fit is None:
        return memory
    prior, fit = Calibration.prior(rig), memory.fit
    calibration = replace(fit.calibration, modal_damping=prior.modal_damping, damping_time=prior.damping_time)
    std = {**fit.std, "modal_damping": PRIOR.modal_damping, "damping_time": PRIOR.damping_time}
    return replace(memory, fit=Fit(calibration=calibration, std=std, windows=fit.windows, misfit=fit.misfit))


def _without_discs(memory: Memory) -> Memory:
    """The memory without what depends on the zeros of the encoders' counts."""
    blank = Memory()
    return replace(
        memory, phase=blank.phase, phase_std=blank.phase_std, offset=None, unworn_before=len(memory.unworn)
    )  # fmt: skip


# -- the search for effects ------------------------------------------------------------------------------


def _ends(addition: Addition, kind: str) -> bool:
    return kind in addition.effect.facts.ended_by


def _since_now(tracing: Tracing, after: Callable[[Memory], Memory]) -> Tracing:
    """The attribution's memory with every stage changed, and with the windows from now on alone to compare."""
    tracing = _each_stage(tracing, after)
    return replace(
        tracing,
        history=(),
        start=tracing.stages[-1].memory if tracing.stages else tracing.start,
        started=tracing.measured,
        widened=(),
        next_search=tracing.measured + LEAST_WINDOWS,
        next_trace=tracing.measured + LEAST_WINDOWS,
        signs={},
        error=None,
        residual=None,
        latest=TraceSummary(),
    )


def _each_stage(tracing: Tracing, after: Callable[[Memory], Memory], widened: int | None = None) -> Tracing:
    stages = tuple(replace(s, memory=after(s.memory)) for s in tracing.stages)
    indices = tracing.widened if widened is None else (*tracing.widened, widened)
    return replace(tracing, stages=stages, widened=indices)


def _without(tracing: Tracing, kind: str) -> Tracing:
    """The attribution's memory without the effects that a change ends; the depths of those that stay are kept."""
    keep = [i for i, f in enumerate(tracing.found) if not _ends(f.addition, kind)]
    found = tuple(tracing.found[i] for i in keep)
    if len(found) == len(tracing.found):
        return tracing
    before, now = relevant(tracing.found), relevant(found)
    errors = tuple(tracing.errors[i] for i in keep) if len(tracing.errors) == len(tracing.found) else ()
    names = {f.name for f in found}
    return replace(
        tracing,
        found=found,
        stages=tuple(_stages_with(tracing.stages, before, now)),
        errors=errors,
        start=None if tracing.start is None else replace(tracing.start, effects=now),
        decisions={n: v for n, v in tracing.decisions.items() if n in names or v == "rejected"},
    )


def _stages_with(
    stages: tuple[TwinStage, ...], before: tuple[Addition, ...], now: tuple[Addition, ...]
) -> Iterable[TwinStage]:
    """For every number of the effects that stay, the stage that had the last of them; the last stage stays last."""
    for n in range(len(now) + 1) if stages else ():
        at = len(stages) - 1 if n == len(now) else (0 if n == 0 else before.index(now[n - 1]) + 1)
        stage = stages[min(at, len(stages) - 1)]
        yield replace(stage, memory=replace(stage.memory, effects=now[:n]))
