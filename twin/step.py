"""One measurement window in, one estimate out.

    state, estimate = step(rig, state, window)

No hidden memory: the same three things give the same answer. `State.to_dict()` is a checkpoint.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from twin.errors import ParameterError
from twin.rig import Rig
from twin.windows import Window

UPDATES = ("fused", "paper")


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How the twin is updated."""

    update: str = "fused"  # what sets the wear depth: transmission error ("fused") or the RMS ("paper")
    error_threshold: float = 0.05  # relative RMS error above which a window updates the twin (paper 4.2)

    def __post_init__(self) -> None:
        if self.update not in UPDATES:
            raise ParameterError(f"update = {self.update!r} must be one of {', '.join(UPDATES)}")
        if not 0 < self.error_threshold < 1:
            raise ParameterError(f"error_threshold = {self.error_threshold} is outside (0, 1); percent?")


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """What the twin remembers of a machine; plain serialisable data."""

    windows_seen: int = 0
    memory: Mapping[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The state as JSON-safe data."""
        return {"windows_seen": self.windows_seen, "memory": dict(self.memory)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> State:
        return cls(windows_seen=int(data["windows_seen"]), memory=dict(data["memory"]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What one window told.

    record   the window's record, names of the contract's `windows[]` (JSON-safe)
    report   the twin's present answer: `wear`, `rul`, `residual`, `effects`, `unexplained`, … (JSON-safe)
    events   what happened: (kind, data) with kind `window`, `update`, `effect`, `rul` or `data_fault`
    """

    record: Mapping[str, Any]
    report: Mapping[str, Any]
    events: tuple[tuple[str, Mapping[str, Any]], ...] = ()


def step(rig: Rig, state: State, window: Window, options: Options = Options()) -> tuple[State, Estimate]:
    """Takes one window into the twin; raises WindowError where the window cannot be used at all."""
    raise NotImplementedError
