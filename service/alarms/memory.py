"""What the engine remembers of an asset from window to window: kept by the store as JSON (`twin/serial.py`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

AlarmLevel = Literal["watch", "alarm"]
LEVELS: tuple[AlarmLevel, ...] = ("watch", "alarm")


@dataclass(slots=True, kw_only=True)
class LevelMemory:
    """One level of one watched quantity."""

    on: bool = False
    up: int = 0  # windows in a row beyond the limit
    up_ns: int | None = None  # when the first of them was
    down: int = 0  # windows in a row on the good side, by the hysteresis
    down_ns: int | None = None


@dataclass(slots=True, kw_only=True)
class LearnedPoint:
    """Healthy values under one operating condition, until there are enough."""

    speed: float | None
    torque: float | None
    values: list[float] = field(default_factory=list)


@dataclass(slots=True, kw_only=True)
class KeyMemory:
    """One rule at one place."""

    rule: str
    quantity: str
    place: str
    levels: dict[AlarmLevel, LevelMemory] = field(default_factory=lambda: {name: LevelMemory() for name in LEVELS})
    learned: list[LearnedPoint] = field(default_factory=list)

    @property
    def level(self) -> AlarmLevel | None:
        """The level that holds; None where none does."""
        return next((name for name in reversed(LEVELS) if self.levels[name].on), None)


@dataclass(slots=True, kw_only=True)
class Memory:
    """All of an asset."""

    window: int | None = None  # index of the newest window that was evaluated
    keys: dict[str, KeyMemory] = field(default_factory=dict)

    def of(self, rule: str, quantity: str, place: str) -> KeyMemory:
        """The memory of one rule at one place, made where there is none."""
        return self.keys.setdefault(key_of(rule, place), KeyMemory(rule=rule, quantity=quantity, place=place))

    def forget_level(self, key: str) -> None:
        """Lets the quantity be judged afresh, as after a person has cleared its alarm; what was learned stays."""
        if key in self.keys:
            self.keys[key].levels = {name: LevelMemory() for name in LEVELS}


def key_of(rule: str, place: str) -> str:
    """What names an alarm: the rule, and the place where there is one."""
    return f"{rule}/{place}" if place else rule
