"""The history of a machine taken again from its first window, with other effects in the twin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from twin.effects.addition import Addition
from twin.errors import NotAvailable, NotConverged
from twin.features.beside import Beside
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.updating.memory import Memory
from twin.updating.update import Outcome, take


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """One window of the history as it was taken."""

    index: int
    features: WindowFeatures
    level_fault: str | None = None
    beside: Beside | None = None  # what the acceleration holds beside the gears

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        return {
            "index": self.index,
            "features": self.features.to_dict(),
            "level_fault": self.level_fault,
            "beside": None if self.beside is None else self.beside.to_dict(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Taken:
        return cls(
            index=data["index"],
            features=WindowFeatures.from_dict(data["features"]),
            level_fault=data["level_fault"],
            beside=None if data["beside"] is None else Beside.from_dict(data["beside"]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Taking:
    """How windows are taken: as `twin.step.Options` has it."""

    threshold: float
    update: str
    update_until: float


def taken_in(rig: Rig, memory: Memory, window: Taken, taking: Taking) -> Outcome:
    """One window more; raises NotAvailable, NotConverged."""
    return take(
        rig,
        memory,
        window.features,
        window.index,
        threshold=taking.threshold,
        update=taking.update,
        update_until=taking.update_until,
        level_fault=window.level_fault,
    )


def retake(
    rig: Rig, effects: Iterable[Addition], history: Sequence[Taken], taking: Taking
) -> tuple[Memory, tuple[Outcome | None, ...]]:
    """What the twin would remember and have said had it had these effects from the start; pure.

    An outcome is None where the window could not be taken, as it would have been then.
    """
    memory = Memory(effects=tuple(effects))
    outcomes: list[Outcome | None] = []
    for window in history:
        try:
            outcome = taken_in(rig, memory, window, taking)
        except (NotAvailable, NotConverged):
            outcomes.append(None)
            continue
        memory = outcome.memory
        outcomes.append(outcome)
    return memory, tuple(outcomes)
