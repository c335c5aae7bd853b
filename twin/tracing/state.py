"""What the tracing remembers of one machine: plain data with its two-way translation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from twin.effects.addition import Addition
from twin.tracing.attribution import AttributedEffect
from twin.updating.history import WindowInput
from twin.updating.memory import Memory

LEAST_WINDOWS = 3  # measurement windows before the first search


@dataclass(frozen=True, slots=True, kw_only=True)
class TwinStage:
    """The twin with the first few effects, or with none."""

    memory: Memory
    depth: float = 0.0  # at the latest measurement window [m]
    depths: Mapping[int, float] = field(default_factory=dict)  # by window [m]
    life: float | None = None  # left at the latest measurement window [revolutions of the pinion]

    def to_dict(self) -> dict[str, Any]:
        return {
            "memory": self.memory.to_dict(),
            "depth": self.depth,
            "depths": [[i, d] for i, d in self.depths.items()],
            "life": self.life,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> TwinStage:
        return cls(
            memory=Memory.from_dict(data["memory"]),
            depth=data["depth"],
            depths={int(i): d for i, d in data["depths"]},
            life=data["life"],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracing:
    """What the tracing remembers of one machine; plain serialisable data."""

    history: tuple[WindowInput, ...] = ()
    measured: int = 0  # measurement windows so far
    next_search: int = LEAST_WINDOWS
    next_trace: int = LEAST_WINDOWS
    phase: float | None = None  # of the mesh against the encoder's zero, on the first mounting of the discs [rad]
    turns: tuple[tuple[int, float], ...] = ()  # of the pinion's disc that are believed: since [Unix ns], by [rad]
    signs: Mapping[str, float] = field(default_factory=dict)  # the largest that have been traced (watch.py)
    found: tuple[AttributedEffect, ...] = ()  # what is in the twin, in the order found
    stages: tuple[
        TwinStage, ...
    ] = ()  # with 0, 1, … of the effects that change the mesh or the path; the last is in use
    decisions: Mapping[str, str] = field(default_factory=dict)  # name → accepted, rejected or pinned
    errors: tuple[Mapping[str, Any], ...] = ()  # on held-out windows, with 0, 1, … of `found`
    residual: Mapping[str, Any] | None = None  # of one held-out window, by band and order
    strange: tuple[Mapping[str, Any], ...] = ()  # lines that no gear makes
    unknown: str = ""  # what has no name, in words
    standing: Mapping[str, Any] = field(default_factory=dict)  # of the latest trace
    log: tuple[Mapping[str, Any], ...] = ()

    @property
    def rejected(self) -> tuple[str, ...]:
        return tuple(name for name, verdict in self.decisions.items() if verdict == "rejected")

    @property
    def fixed(self) -> tuple[str, ...]:
        """Effects that an engineer has accepted or pinned: they stay, whatever they add."""
        return tuple(name for name, verdict in self.decisions.items() if verdict in ("accepted", "pinned"))

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        return {
            "history": [t.to_dict() for t in self.history],
            "measured": self.measured,
            "next_search": self.next_search,
            "next_trace": self.next_trace,
            "phase": self.phase,
            "turns": [list(turn) for turn in self.turns],
            "signs": dict(self.signs),
            "found": [f.to_dict() for f in self.found],
            "stages": [s.to_dict() for s in self.stages],
            "decisions": dict(self.decisions),
            "errors": [dict(e) for e in self.errors],
            "residual": self.residual,
            "strange": [dict(s) for s in self.strange],
            "unknown": self.unknown,
            "standing": dict(self.standing),
            "log": [dict(entry) for entry in self.log],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Tracing:
        if not data:
            return cls()
        return cls(
            history=tuple(WindowInput.from_dict(t) for t in data["history"]),
            measured=data["measured"],
            next_search=data["next_search"],
            next_trace=data["next_trace"],
            phase=data["phase"],
            turns=tuple((since, angle) for since, angle in data["turns"]),
            signs=data["signs"],
            found=tuple(AttributedEffect.from_dict(f) for f in data["found"]),
            stages=tuple(TwinStage.from_dict(s) for s in data["stages"]),
            decisions=dict(data["decisions"]),
            errors=tuple(data["errors"]),
            residual=data["residual"],
            strange=tuple(data["strange"]),
            unknown=data["unknown"],
            standing=data["standing"],
            log=tuple(data["log"]),
        )


def relevant(found: Iterable[AttributedEffect]) -> tuple[Addition, ...]:
    """The effects that change the mesh orders or the path: no others change a depth."""
    return tuple(f.addition for f in found if f.addition.effect.facts.changes_mesh_lines)


def parameters_of(item: AttributedEffect) -> dict[str, dict[str, Any]]:
    """As the contract reports them."""
    return {name: {"value": value, "unit": unit, "std": std} for name, (value, unit, std) in item.parameters.items()}
