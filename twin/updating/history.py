"""The history of a machine replayed from its first window, with other effects in the twin."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from twin.effects.addition import Addition
from twin.errors import NotAvailable, NotConverged
from twin.features.non_gear import NonGearFeatures
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.updating.carried_over import with_wider_rate
from twin.updating.memory import Memory
from twin.updating.update import UpdateOptions, UpdateOutcome, update_twin

__all__ = ["UpdateOptions", "WindowInput", "replay_history", "update_window"]


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowInput:
    """The features of one window, as they are kept for a replay of the history."""

    index: int
    features: WindowFeatures
    level_fault: str | None = None  # why the level may not be compared
    torque_fault: str | None = None  # why the torque is doubtful
    torque_unknown: str | None = None  # why it is not known at all
    non_gear: NonGearFeatures | None = None  # content of the acceleration that no gear makes


def update_window(rig: Rig, memory: Memory, window: WindowInput, options: UpdateOptions) -> UpdateOutcome:
    """Updates the twin by one window; raises NotAvailable, NotConverged."""
    return update_twin(
        rig, memory, window.features, window.index, options,
        level_fault=window.level_fault, torque_fault=window.torque_fault,
    )  # fmt: skip


def replay_history(
    rig: Rig,
    effects: Iterable[Addition],
    history: Sequence[WindowInput],
    options: UpdateOptions,
    start: Memory | None = None,
    widened: Iterable[int] = (),
) -> tuple[Memory, tuple[UpdateOutcome | None, ...]]:
    """Memory and outcomes that the twin would have had with these effects from the start; a pure function.

    An outcome is None where a window cannot update the twin.

    start    what was known of the machine before the first window; None: its rig file alone
    widened  indices of windows from which on the wear rate may be another (other oil)
    """
    memory = replace(start or Memory(), effects=tuple(effects))
    pending = sorted(widened)
    outcomes: list[UpdateOutcome | None] = []
    for window in history:
        while pending and pending[0] <= window.index:
            memory = with_wider_rate(memory)
            pending.pop(0)
        try:
            outcome = update_window(rig, memory, window, options)
        except (NotAvailable, NotConverged):
            outcomes.append(None)
            continue
        memory = outcome.memory
        outcomes.append(outcome)
    return memory, tuple(outcomes)
