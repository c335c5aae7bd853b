"""The history of a machine taken again from its first window, with other effects in the twin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from twin.effects.addition import Addition
from twin.errors import NotAvailable, NotConverged
from twin.features.non_gear import NonGearFeatures
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.updating.memory import Memory
from twin.updating.update import UpdateOutcome, update_twin


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowInput:
    """One window of the history as it was taken."""

    index: int
    features: WindowFeatures
    level_fault: str | None = None
    non_gear: NonGearFeatures | None = None  # what the acceleration holds that no gear makes

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        return {
            "index": self.index,
            "features": self.features.to_dict(),
            "level_fault": self.level_fault,
            "beside": None if self.non_gear is None else self.non_gear.to_dict(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> WindowInput:
        return cls(
            index=data["index"],
            features=WindowFeatures.from_dict(data["features"]),
            level_fault=data["level_fault"],
            non_gear=None if data["beside"] is None else NonGearFeatures.from_dict(data["beside"]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateOptions:
    """How windows are taken: as `twin.step.Options` has it."""

    threshold: float
    update: str
    update_until: float


def update_window(rig: Rig, memory: Memory, window: WindowInput, taking: UpdateOptions) -> UpdateOutcome:
    """One window more; raises NotAvailable, NotConverged."""
    return update_twin(
        rig,
        memory,
        window.features,
        window.index,
        threshold=taking.threshold,
        update=taking.update,
        update_until=taking.update_until,
        level_fault=window.level_fault,
    )


def replay_history(
    rig: Rig, effects: Iterable[Addition], history: Sequence[WindowInput], taking: UpdateOptions
) -> tuple[Memory, tuple[UpdateOutcome | None, ...]]:
    """What the twin would remember and have said had it had these effects from the start; pure.

    An outcome is None where the window could not be taken, as it would have been then.
    """
    memory = Memory(effects=tuple(effects))
    outcomes: list[UpdateOutcome | None] = []
    for window in history:
        try:
            outcome = update_window(rig, memory, window, taking)
        except (NotAvailable, NotConverged):
            outcomes.append(None)
            continue
        memory = outcome.memory
        outcomes.append(outcome)
    return memory, tuple(outcomes)
