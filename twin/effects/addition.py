"""An effect that was added to the twin of one machine, and since when it is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from twin.effects import EFFECTS
from twin.effects.response import Effect
from twin.errors import ParameterError


@dataclass(frozen=True, slots=True, kw_only=True)
class Addition:
    """One effect in the twin."""

    effect: Effect
    onset_revolutions: float = 0.0  # of the pinion; 0 where it was there from the start

    @property
    def name(self) -> str:
        """As results report it."""
        return name_of(self.effect)

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        values = {f.name: getattr(self.effect, f.name) for f in fields(self.effect)}  # type: ignore[arg-type]
        return {
            "name": self.name,
            "values": {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()},
            "onset_revolutions": self.onset_revolutions,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Addition:
        values = {k: tuple(v) if isinstance(v, list) else v for k, v in data["values"].items()}
        return cls(effect=EFFECTS[data["name"]](**values), onset_revolutions=data["onset_revolutions"])


def name_of(effect: Effect) -> str:
    """The effect's key in the table; ParameterError where it is in none."""
    for name, kind in EFFECTS.items():
        if type(effect) is kind:
            return name
    raise ParameterError(f"{type(effect).__name__} is not in the table of effects")
