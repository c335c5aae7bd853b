"""The twin's step and decision in the names and units of the contract.

    state, estimate = step(rig, state, window, options)

The functions of `twin.step`, with what they compute as JSON data: nothing behind this module sees a quantity in SI.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import twin.step
from service.contract.answer import report_of
from service.contract.parts import json_of
from service.contract.status import Status, status_after
from twin import assessment
from twin.assessment.key import MICROMETRE
from twin.held_level import HeldLevel
from twin.machine_change import MachineChange
from twin.options import Options
from twin.rig import Rig
from twin.state import State
from twin.tracing.decisions import Decision
from twin.updating.inspections import Inspection
from twin.windows import Window

UPDATE_FIELDS = ("index", "revolutions", "error_percent", "rms_after", "k_wear_per_n", "wear_depth_um")


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What one window led to, as strict JSON data.

    record   the window's record, keys of the contract's `windows[]`
    report   the twin's present answer: `status`, `wear`, `rul`, `residual`, `effects`, `unexplained`, …
    events   what happened: (kind, data) with kind `window`, `update`, `effect` or `rul`
    """

    record: Mapping[str, Any]
    report: Mapping[str, Any]
    events: tuple[tuple[str, Mapping[str, Any]], ...] = ()


def step(rig: Rig, state: State, window: Window, options: Options = twin.step.DEFAULT) -> tuple[State, Estimate]:
    """`twin.step.step` with its assessment as an estimate."""
    state, found = twin.step.step(rig, state, window, options)
    status, held = status_after(found, state.held, options.status_limits.of_rig(rig))
    return replace(state, held=held), estimate_of(found, status)


def decide(rig: Rig, state: State, decision: Decision, options: Options = twin.step.DEFAULT) -> tuple[State, Estimate]:
    """`twin.step.decide` with its assessment as an estimate."""
    return _by_people(rig, *twin.step.decide(rig, state, decision, options), options)


def inspect(
    rig: Rig, state: State, inspection: Mapping[str, Any], options: Options = twin.step.DEFAULT
) -> tuple[State, Estimate]:
    """`twin.step.inspect` with a depth as it was posted: `revolutions`, `max_depth_um`, `flank`, `std_um`."""
    measured = Inspection(
        revolutions=inspection["revolutions"],
        depth=inspection["max_depth_um"] * MICROMETRE,
        flank=inspection["flank"],
        std=inspection["std_um"] * MICROMETRE,
    )
    return _by_people(rig, *twin.step.inspect(rig, state, measured), options)


def change(rig: Rig, state: State, made: MachineChange, options: Options = twin.step.DEFAULT) -> tuple[State, Estimate]:
    """`twin.step.change` with its assessment as an estimate."""
    return _by_people(rig, *twin.step.change(rig, state, made, options), options)


def _by_people(rig: Rig, state: State, found: assessment.Assessment, options: Options) -> tuple[State, Estimate]:
    """What people have decided, measured or changed: a level that was held is over."""
    status, held = status_after(found, HeldLevel(), options.status_limits.of_rig(rig))
    return replace(state, held=held), estimate_of(found, status)


def estimate_of(found: assessment.Assessment, status: Status) -> Estimate:
    """An assessment with its status as strict JSON data."""
    return Estimate(
        record={} if found.window is None else json_of(found.window),
        report=report_of(found, status),
        events=tuple(_event(event) for event in found.events),
    )


def _event(event: assessment.Event) -> tuple[str, Mapping[str, Any]]:
    if isinstance(event, assessment.EffectEvent):
        return "effect", json_of(event)
    if isinstance(event, assessment.LifeEvent):
        return "rul", json_of(event.life)
    if isinstance(event, assessment.CountEvent):
        effect = {"revolutions": event.revolutions, "from_window": event.window}
        given = {"by": None, "note": event.reason, "revolutions": event.seen}
        return "change", {"kind": "counter_reset", **given, "effect": effect}
    record = json_of(event.window)
    if isinstance(event, assessment.UpdateEvent):
        return "update", {name: record[name] for name in UPDATE_FIELDS}
    return "window", record
