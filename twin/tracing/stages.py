"""The twin with 0, 1, … of its effects: one stage for each that changes a depth, all of them updated by every window.

So depth and life are known before and after each effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from twin.assessment import Unavailable
from twin.effects.addition import Addition
from twin.errors import NotAvailable, NotConverged
from twin.rig import Rig
from twin.tracing.schedule import MOST_HISTORY
from twin.tracing.state import Tracing, TwinStage
from twin.updating.history import UpdateOptions, WindowInput, replay_history, update_window
from twin.updating.life import bound, life_after
from twin.updating.memory import Memory
from twin.updating.update import UpdateOutcome

Replayed = tuple[tuple[WindowInput, UpdateOutcome], ...]


def staged(rig: Rig, stage: TwinStage, window: WindowInput, outcome: UpdateOutcome) -> TwinStage:
    """A stage after the outcome of one window more."""
    if outcome.kind != "measurement":
        return replace(stage, memory=outcome.memory)
    return _after(rig, {**stage.depths, window.index: outcome.depth}, outcome, outcome.memory)


def _after(rig: Rig, depths: Mapping[int, float], latest: UpdateOutcome, memory: Memory) -> TwinStage:
    """A stage with the depths of its measurement windows [m], by index in order, the latest of them with this outcome.

    memory  after the latest window of any kind
    """
    life = life_after(rig, latest)
    return TwinStage(
        memory=memory,
        depth=latest.depth,
        depths=dict(list(depths.items())[-MOST_HISTORY:]),
        life=None if isinstance(life, Unavailable) else bound(life.median),
    )


def advanced(rig: Rig, stage: TwinStage, window: WindowInput, options: UpdateOptions) -> TwinStage:
    """A stage after one window more, unchanged where the window cannot update it."""
    try:
        outcome = update_window(rig, stage.memory, window, options)
    except (NotAvailable, NotConverged):
        return stage
    return staged(rig, stage, window, outcome)


def with_effects(
    rig: Rig,
    tracing: Tracing,
    old: Sequence[Addition],
    new: Sequence[Addition],
    options: UpdateOptions,
) -> tuple[tuple[TwinStage, ...], Replayed]:
    """The stages with other effects: those they have in common are kept, the history is replayed for the others.

    The second value holds the windows as the last stage updated by them; empty where nothing was replayed.
    """
    history, stages, common = tracing.history, tracing.stages, 0
    while common < min(len(old), len(new)) and old[common] == new[common]:
        common += 1
    out = list(stages[: common + 1])
    again: Replayed = ()
    for count in range(common + 1, len(new) + 1):
        memory, outcomes = replay(rig, tracing, new[:count], options)
        measured = [(w.index, o) for w, o in _taken(history, outcomes) if o.kind == "measurement"]
        depths = {index: outcome.depth for index, outcome in measured}
        out.append(_after(rig, depths, measured[-1][1], memory) if measured else TwinStage(memory=memory))
        again = _taken(history, outcomes)
    if len(new) == common and common < len(old):  # effects have gone: the twin in use is an earlier stage
        _, outcomes = replay(rig, tracing, new, options)
        again = _taken(history, outcomes)
    return tuple(out), again


def replay(
    rig: Rig, tracing: Tracing, effects: Sequence[Addition], options: UpdateOptions
) -> tuple[Memory, tuple[UpdateOutcome | None, ...]]:
    """The history since the machine was last changed, as it would have been with these effects."""
    return replay_history(rig, effects, tracing.history, options, tracing.start, tracing.widened)


def _taken(history: Sequence[WindowInput], outcomes: Sequence[UpdateOutcome | None]) -> Replayed:
    return tuple((w, o) for w, o in zip(history, outcomes, strict=True) if o is not None)
