"""Closing the loop: watch the residual window by window, trace it, add the effect, re-run the history.

    tracing, outcome, events = follow(rig, tracing, memory, taken, outcome, taking)

Beside the twin in use there are twins with fewer effects, wear alone first: one for every effect that changes the mesh
or the path, so that depth and life stand before and after each of them. All of them see every window.

The search from scratch is made at LEAST_WINDOWS measurement windows and again each time there are half as many more.
Between, a trace fits what was found anew beside everything else, and searches on where the misfit has grown: at every
window of a short campaign, at ever fewer of a long one, and at once where a window shows a sign of something new
(watch.py). What changes by less than its own uncertainty leaves the twin as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twin.errors import NotAvailable, NotConverged, TwinError
from twin.report import rul_report
from twin.rig import Rig
from twin.tracing.attribution import AttributedEffect
from twin.tracing.change_detection import change_indicators, is_new, widened
from twin.tracing.decisions import Decision
from twin.tracing.detectors import non_gear
from twin.tracing.findings import NonGearContent
from twin.tracing.held_out_error import HeldOutComparison, LearnedFactors, by_band_and_order, compare, figures
from twin.tracing.mesh_windows import OnsetThresholds
from twin.tracing.state import LEAST_WINDOWS, Tracing, TwinStage, parameters_of, relevant
from twin.tracing.trace import Traced, held_out, trace
from twin.updating.conditions import kind_of
from twin.updating.history import UpdateOptions, WindowInput, replay_history, update_window
from twin.updating.memory import Memory
from twin.updating.update import UpdateOutcome

MOST_HISTORY = 40  # windows that are kept, to be run again
MOST_LOG = 200
MOST_UNSEEN = 3  # held-out windows that errors are computed on, the newest
EVERY = 12  # measurement windows up to which each is traced; beyond, one in so many of those so far:
SELDOM = 4
EXPLAINED = 0.6  # misfit of wear alone that leaves nothing to be sought
MORE = 1.3  # times the misfit of before, from which a search starts at once
SAME_ONSET = 1.0  # revolutions
CHANGED_STD, CHANGED_SHARE = 1.0, 0.1  # change of a parameter that is worth another run: of its std, of its value
WORSE = 1.02  # times the error on held-out windows, from which an effect is not believed
MOST_STRANGE = 12

Event = tuple[str, Mapping[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopResult:
    """The tracing after a window, and the twin with what it has found."""

    tracing: Tracing
    outcome: UpdateOutcome
    again: tuple[
        tuple[WindowInput, UpdateOutcome], ...
    ] = ()  # the latest windows as the changed twin took them, oldest first
    events: tuple[Event, ...] = ()


def attribute_window(
    rig: Rig, tracing: Tracing, taken: WindowInput, outcome: UpdateOutcome, taking: UpdateOptions
) -> LoopResult:
    """One window more, already taken into the twin in use."""
    measurement = outcome.kind == "measurement"
    before = [_advanced(rig, stage, taken, taking) for stage in tracing.stages[:-1]]
    latest = tracing.stages[-1] if tracing.stages else TwinStage(memory=outcome.memory)
    stages = (*before, _staged(rig, latest, taken, outcome))
    tracing = replace(
        tracing,
        history=_thinned(rig, (*tracing.history, taken)),
        stages=stages,
        measured=tracing.measured + measurement,
    )
    if not measurement or tracing.measured < LEAST_WINDOWS:
        return LoopResult(tracing=tracing, outcome=outcome)
    shown = change_indicators(rig, taken, outcome)
    search = tracing.measured >= tracing.next_search
    if not search and tracing.measured < tracing.next_trace and not is_new(shown, tracing.signs):
        return LoopResult(tracing=tracing, outcome=outcome)
    pause = 1 if tracing.measured < EVERY else tracing.measured // SELDOM
    tracing = replace(tracing, next_trace=tracing.measured + pause, signs=widened(tracing.signs, shown))
    kept = [f for f in tracing.found if not search or tracing.decisions.get(f.name) in ("accepted", "pinned")]
    tolerated = 0.0 if search else MORE * (tracing.standing.get("misfit_after") or 0.0)
    try:
        tracing, traced = _traced(rig, tracing, outcome.memory, kept, tolerated)
    except (NotAvailable, NotConverged) as reason:
        return LoopResult(tracing=replace(tracing, standing={"reason": str(reason)}), outcome=outcome)
    if traced.waiting:
        tracing = replace(tracing, next_search=tracing.measured + 1, next_trace=tracing.measured + 1)
    elif search:
        tracing = replace(tracing, next_search=tracing.measured + max(2, tracing.measured // 2))
    return _joined(rig, tracing, traced, outcome, taking)


def _traced(
    rig: Rig, tracing: Tracing, memory: Memory, kept: Sequence[AttributedEffect], tolerated: float
) -> tuple[Tracing, Traced]:
    """A trace of all windows, as on one mounting of the discs.

    What looks like a disc that was turned may be an effect that sets in. It is believed where wear alone explains all
    windows once the disc is turned back; only where nothing explains them together are the earlier ones given up.
    """
    depths = dict(tracing.stages[-1].depths)
    phase = memory.phase if tracing.phase is None else tracing.phase
    tracing = replace(tracing, phase=phase)

    def attempt(turns: Sequence[tuple[int, float]], since_ns: int = 0, at: float | None = phase) -> Traced:
        return trace(
            rig, [_turned_back(rig, t, turns) for t in tracing.history], depths, at, rejected=tracing.rejected,
            kept=kept, fixed=tracing.fixed, tolerated=tolerated, since_ns=since_ns,
        )  # fmt: skip

    known = tracing.turns[-1][0] if tracing.turns else 0
    if memory.discs_since_ns > known and memory.phase is not None and phase is not None:
        back = sum(turn for _, turn in tracing.turns)
        turn = float(np.angle(np.exp(1j * (memory.phase - phase - back))))
        turns = (*tracing.turns, (memory.discs_since_ns, turn))
        turned = attempt(turns)
        if (turned.misfit_before or 0.0) <= EXPLAINED:  # wear alone explains all windows, the disc turned back
            return replace(tracing, turns=turns), turned
    whole = attempt(tracing.turns)
    if (
        memory.discs_since_ns > known
        and memory.phase is not None
        and (whole.misfit_after or 0.0) > OnsetThresholds().explained
    ):
        try:
            part = attempt((), memory.discs_since_ns, memory.phase)
        except (NotAvailable, NotConverged):
            return tracing, whole
        if (part.misfit_after or 0.0) < 0.5 * (whole.misfit_after or 0.0):
            return tracing, part
    return tracing, whole


def _turned_back(rig: Rig, taken: WindowInput, turns: Sequence[tuple[int, float]]) -> WindowInput:
    """The window as the pinion's disc would have shown it before it was turned."""
    turn = sum(angle for since, angle in turns if taken.features.start_time_ns >= since)
    if turn == 0:
        return taken
    features = taken.features
    changes = {}
    for name in ("acceleration", "transmission_error", "pinion_motion", "torque"):
        lines = getattr(features, name)
        if lines is not None:
            back = np.exp(-1j * np.array(lines.orders) * turn / rig.teeth[0])
            amplitudes = tuple((np.array(lines.amplitudes) * back).tolist())
            changes[name] = replace(lines, amplitudes=amplitudes)
    return replace(taken, features=replace(features, **changes))


def listen(rig: Rig, tracing: Tracing, taken: WindowInput) -> tuple[Tracing, tuple[Event, ...]]:
    """One window more of a machine that no twin can be built of: what no gear makes is heard all the same."""
    history = _thinned(rig, (*tracing.history, taken))
    beside = [(t.features.revolutions or float(t.index), t.non_gear) for t in history if t.non_gear is not None]
    tracing = replace(tracing, history=history, measured=tracing.measured + 1)
    if len(beside) < LEAST_WINDOWS or tracing.stages:
        return tracing, ()
    heard = non_gear.find_non_gear_content(beside, False, noise_floor=rig.tolerances.acceleration_floor)
    found: tuple[AttributedEffect, ...] = ()
    if heard.defect is not None and "bearing_defect" not in tracing.rejected:
        found = (non_gear.attributed(heard.defect),)
    old = {f.name: f for f in tracing.found}
    found = tuple(old[f.name] if f.name in old and _same(old[f.name], f) else f for f in found)
    now = {f.name for f in found}
    events = [("effect", {**_entry(tracing, "found"), **_described(f)}) for f in found if f.name not in old]
    gone = [f for f in tracing.found if f.name not in now]
    events += [("effect", {**_entry(tracing, "dropped"), **_described(f)}) for f in gone]
    tracing = replace(
        tracing,
        found=found,
        strange=_strange(tracing, heard),
        unknown=heard.sentence(),
        standing={"reason": "only what no gear makes is sought: the twin of this machine cannot be built"},
        log=(*tracing.log, *(dict(data) for _, data in events))[-MOST_LOG:],
    )
    return tracing, tuple(events)


def decide(rig: Rig, tracing: Tracing, decision: Decision, outcome: UpdateOutcome, taking: UpdateOptions) -> LoopResult:
    """The tracing after an engineer's decision; `outcome` of the latest window."""
    decisions = dict(tracing.decisions)
    decisions.pop(decision.name, None)
    if decision.verb != "release":
        decisions[decision.name] = {"accept": "accepted", "reject": "rejected", "pin": "pinned"}[decision.verb]
    present = any(f.name == decision.name for f in tracing.found)
    if decision.verb in ("accept", "pin") and not present:
        raise NotAvailable(f"{decision.name} is not in the twin: only an effect that was found can stay")
    entry = _entry(
        tracing, {"accept": "accepted", "reject": "rejected", "pin": "pinned"}.get(decision.verb, "released")
    )
    tracing = replace(
        tracing,
        decisions=decisions,
        log=(*tracing.log, {**entry, "name": decision.name})[-MOST_LOG:],
        next_search=tracing.measured + 1 if decision.verb in ("reject", "release") else tracing.next_search,
        next_trace=tracing.measured + 1,
    )
    rest = tuple(f for f in tracing.found if f.name not in tracing.rejected)
    if len(rest) == len(tracing.found):
        return LoopResult(tracing=tracing, outcome=outcome)
    return _changed(rig, tracing, rest, outcome, taking)


def _joined(rig: Rig, tracing: Tracing, traced: Traced, outcome: UpdateOutcome, taking: UpdateOptions) -> LoopResult:
    """The twin with what a trace has found."""
    old = {f.name: f for f in tracing.found}
    new: list[AttributedEffect] = []
    for item in traced.found:
        known = old.get(item.name)
        if known is not None and (tracing.decisions.get(item.name) == "pinned" or _same(known, item)):
            item = replace(known, log_evidence=item.log_evidence, alike=item.alike, detail=item.detail)
        new.append(item)
    names = {f.name for f in new}
    new += [f for f in tracing.found if f.name not in names and tracing.decisions.get(f.name) in ("accepted", "pinned")]
    rank = {name: i for i, name in enumerate(old)}
    new.sort(key=lambda f: rank.get(f.name, len(rank)))
    unbelieved = tracing.standing.get("unbelieved", {})
    new = [f for f in new if not _unbelieved(f, unbelieved)]
    tracing = replace(
        tracing,
        strange=_strange(tracing, traced.non_gear),
        unknown=traced.non_gear.sentence(),
        standing={
            "candidates": [list(row) for row in traced.table] or tracing.standing.get("candidates", []),
            "other_structure": traced.other_structure,
            "misfit_before": traced.misfit_before,
            "misfit_after": traced.misfit_after,
            "held_out": list(traced.held_out),
            "fitted": list(traced.fitted),
            "unbelieved": unbelieved,
        },
    )
    if [f.addition for f in new] == [f.addition for f in tracing.found]:
        tracing = replace(tracing, found=tuple(new))
        return LoopResult(tracing=_with_errors(rig, tracing), outcome=outcome)
    followed = _changed(rig, tracing, tuple(new), outcome, taking)
    doubted = _not_confirmed(followed.tracing, old)
    if not doubted:
        return followed
    unbelieved = {**unbelieved, **{f.name: list(f.numbers) for f in doubted}}
    tracing = replace(tracing, standing={**tracing.standing, "unbelieved": unbelieved})
    rest = tuple(f for f in new if f not in doubted)
    if [f.addition for f in rest] == [f.addition for f in tracing.found]:
        return LoopResult(tracing=_with_errors(rig, replace(tracing, found=rest)), outcome=outcome)
    return _changed(rig, tracing, rest, outcome, taking)


def _same(old: AttributedEffect, new: AttributedEffect) -> bool:
    """Whether a refit says what the twin has already."""
    if abs(old.addition.onset_revolutions - new.addition.onset_revolutions) > SAME_ONSET:
        return False
    if type(old.addition.effect) is not type(new.addition.effect) or set(old.parameters) != set(new.parameters):
        return False
    for name, (value, _, std) in new.parameters.items():
        before = old.parameters[name][0]
        if abs(value - before) > max(CHANGED_STD * std, CHANGED_SHARE * abs(before)):
            return False
    return True


def _unbelieved(item: AttributedEffect, known: Mapping[str, Sequence[float]]) -> bool:
    """Whether held-out windows have spoken against much the same numbers before."""
    before = known.get(item.name)
    if before is None or len(before) != len(item.numbers):
        return False
    return bool(np.allclose(before, item.numbers, rtol=0.3, atol=0.1))


def _not_confirmed(tracing: Tracing, old: Mapping[str, AttributedEffect]) -> list[AttributedEffect]:
    """New effects on the mesh that make neither the vibration nor the transmission error of held-out windows better."""
    out = []
    for i, item in enumerate(tracing.found):
        if item.addition.effect.facts.detector != "mesh" or item.name in old or i + 1 >= len(tracing.errors):
            continue
        before, after = tracing.errors[i], tracing.errors[i + 1]
        turns = {t.index: t.features.revolutions or 0.0 for t in tracing.history}
        if not any(turns[j] >= _surely_since(tracing, item) for j in after["windows"]):
            continue  # none was recorded since it is there
        worse = [
            after[key] > WORSE * before[key]
            for key in ("waveform_percent", "transmission_error_percent")
            if before.get(key) is not None and after.get(key) is not None
        ]
        if worse and all(worse):
            out.append(item)
    return out


def _surely_since(tracing: Tracing, item: AttributedEffect) -> float:
    """Revolutions from which an effect is there for certain: of the first fitted window after its onset."""
    onset, fitted = item.addition.onset_revolutions, tracing.standing.get("fitted", [])
    later = [t.features.revolutions or 0.0 for t in tracing.history if t.index in fitted]
    return min((n for n in later if n >= onset), default=onset) if onset > 0 else 0.0


def _changed(
    rig: Rig, tracing: Tracing, found: tuple[AttributedEffect, ...], outcome: UpdateOutcome, taking: UpdateOptions
) -> LoopResult:
    """The history run again with other effects; every stage that they change."""
    old, additions = relevant(tracing.found), relevant(found)
    stages = list(tracing.stages)
    common = 0
    while common < min(len(old), len(additions)) and old[common] == additions[common]:
        common += 1
    stages = stages[: common + 1]
    again: tuple[tuple[WindowInput, UpdateOutcome], ...] = ()
    for count in range(common + 1, len(additions) + 1):
        memory, outcomes = replay_history(rig, additions[:count], tracing.history, taking)
        stage = TwinStage(memory=memory)
        for taken, result in zip(tracing.history, outcomes, strict=True):
            if result is not None:
                stage = _staged(rig, stage, taken, result)
        stages.append(stage)
        again = tuple((t, o) for t, o in zip(tracing.history, outcomes, strict=True) if o is not None)
    if len(additions) == common and common < len(old):  # effects have gone: the twin in use is an earlier stage
        _, outcomes = replay_history(rig, additions, tracing.history, taking)
        again = tuple((t, o) for t, o in zip(tracing.history, outcomes, strict=True) if o is not None)
    if again and again[-1][0] is tracing.history[-1]:
        outcome = replace(again[-1][1], memory=stages[-1].memory)
    else:
        outcome = replace(outcome, memory=stages[-1].memory)
    before = {f.name: f for f in tracing.found}
    now = {f.name: f for f in found}
    events: list[Event] = []
    for name, item in now.items():
        if name not in before or before[name].addition != item.addition:
            action = "changed" if name in before else "found"
            events.append(("effect", {**_entry(tracing, action), **_described(item)}))
    for name, item in before.items():
        if name not in now:
            events.append(("effect", {**_entry(tracing, "dropped"), **_described(item)}))
    tracing = replace(
        tracing,
        found=found,
        stages=tuple(stages),
        errors=(),
        log=(*tracing.log, *(dict(data) for _, data in events))[-MOST_LOG:],
    )
    return LoopResult(tracing=_with_errors(rig, tracing), outcome=outcome, again=again, events=tuple(events))


def _with_errors(rig: Rig, tracing: Tracing) -> Tracing:
    """The errors on held-out windows with 0, 1, … of the effects; none without effects."""
    out = held_out([t.index for t in tracing.history if kind_of(t.features, rig) == "measurement"])
    unseen = [t for t in tracing.history if t.index in out]
    latest = max((_surely_since(tracing, f) for f in tracing.found), default=0.0)
    unseen = ([t for t in unseen if (t.features.revolutions or 0.0) >= latest] or unseen)[-MOST_UNSEEN:]
    if not tracing.found or not unseen:
        return replace(tracing, errors=(), residual=None)
    learned = LearnedFactors.of(tracing.stages[-1].memory, out)
    rows: list[list[HeldOutComparison]] = []
    for count in range(len(tracing.found) + 1):
        additions = [f.addition for f in tracing.found[:count]]
        stage = tracing.stages[len(relevant(tracing.found[:count]))]
        row = []
        for window in unseen:
            try:
                row.append(
                    compare(rig, stage.memory, additions, learned, window, stage.depths.get(window.index, stage.depth))
                )
            except TwinError:
                continue
        rows.append(row)
    errors = tuple({**figures(row), "windows": [c.index for c in row]} for row in rows)
    residual = None
    if rows[0] and rows[-1] and rows[0][-1].index == rows[-1][-1].index:
        residual = by_band_and_order(rows[0][-1], rows[-1][-1], rig.teeth[0])
    return replace(tracing, errors=errors, residual=residual)


def _advanced(rig: Rig, stage: TwinStage, taken: WindowInput, taking: UpdateOptions) -> TwinStage:
    """A stage after one window more."""
    try:
        outcome = update_window(rig, stage.memory, taken, taking)
    except (NotAvailable, NotConverged):
        return stage
    return _staged(rig, stage, taken, outcome)


def _staged(rig: Rig, stage: TwinStage, taken: WindowInput, outcome: UpdateOutcome) -> TwinStage:
    if outcome.kind != "measurement":
        return replace(stage, memory=outcome.memory)
    depths = {**stage.depths, taken.index: outcome.depth}
    for index in list(depths)[:-MOST_HISTORY]:
        del depths[index]
    life = rul_report(rig, outcome).get("revolutions")
    return TwinStage(
        memory=outcome.memory,
        depth=outcome.depth,
        depths=depths,
        life=None if life is None else life["median"],
    )


def _thinned(rig: Rig, history: tuple[WindowInput, ...]) -> tuple[WindowInput, ...]:
    """At most MOST_HISTORY windows: every second of the older measurement windows goes."""
    if len(history) <= MOST_HISTORY:
        return history
    measurement = [i for i, t in enumerate(history) if kind_of(t.features, rig) == "measurement"]
    old = measurement[: 2 * len(measurement) // 3]
    drop = set(old[1::2]) or {1}
    return tuple(t for i, t in enumerate(history) if i not in drop)


def _entry(tracing: Tracing, action: str) -> dict[str, Any]:
    last = tracing.history[-1] if tracing.history else None
    return {
        "action": action,
        "window": None if last is None else last.index,
        "revolutions": None if last is None else last.features.revolutions,
    }


def _described(item: AttributedEffect) -> dict[str, Any]:
    return {
        "name": item.name,
        "parameters": parameters_of(item),
        "onset_revolutions": item.addition.onset_revolutions,
        "log_evidence": item.log_evidence,
        "runner_up": item.runner_up,
        "over_runner_up": item.over_runner_up,
    }


def _strange(tracing: Tracing, heard: NonGearContent) -> tuple[Mapping[str, Any], ...]:
    """Lines that no gear makes, by frequency and order, the strongest first."""
    windows = [t for t in tracing.history if t.features.speed_hz and t.features.rms]
    if not heard.unknown or not windows:
        return ()
    speed = windows[-1].features.speed_hz or 1.0
    energy = float(np.mean([(t.features.rms or 0.0) ** 2 for t in windows[-MOST_UNSEEN:]]))
    rows: list[dict[str, Any]] = []
    for tone in heard.tones:
        amplitude = max((a or 0.0) for a in tone.amplitudes)
        rows.append(
            {
                "order": tone.frequency / speed,
                "frequency_hz": tone.frequency,
                "share_percent": 100 * 0.5 * amplitude**2 / energy,
                "kind": "steady in hertz",
            }
        )
    for order, amplitude in heard.orders:
        rows.append(
            {
                "order": order,
                "frequency_hz": order * speed,
                "share_percent": 100 * 0.5 * amplitude**2 / energy,
                "kind": "order of no shaft",
            }
        )
    return tuple(sorted(rows, key=lambda r: -r["share_percent"])[:MOST_STRANGE])
