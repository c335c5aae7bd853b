"""An effect that was added to the twin of one machine, since when it is there, and how its size went on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from twin.effects import EFFECTS
from twin.effects.response import Effect
from twin.effects.size_law import CONSTANT, SizeLaw, scaled
from twin.errors import ParameterError
from twin.serial import Named


@dataclass(frozen=True, slots=True, kw_only=True)
class Addition:
    """One effect in the twin."""

    effect: Annotated[Effect, Named(EFFECTS)]  # with the size that the law multiplies
    onset_revolutions: float = 0.0  # of the pinion; 0 where it was there from the start
    law: SizeLaw = CONSTANT

    @property
    def name(self) -> str:
        """As results report it."""
        return name_of(self.effect)

    def at(self, revolutions: float) -> Effect | None:
        """The effect as large as it is after so many revolutions of the pinion; None while it is not there."""
        factor = self.law.factor(revolutions, self.onset_revolutions)
        return None if factor == 0 else scaled(self.effect, factor)

    def wearing(self, revolutions: float) -> Effect | None:
        """The effect under which the flanks wear, one for each stage of its law; None while it is not there.

        A size that grows evenly counts with half of its size at the knot, its mean until then: a new wear curve for
        each window would be dear. Beyond the knot that is too little, until a refit moves the knot.
        """
        if revolutions < self.onset_revolutions:
            return None
        factor = 0.5 if self.law.kind == "linear" else self.law.stage_factor(revolutions)
        return None if factor == 0 else scaled(self.effect, factor)

    @property
    def changes(self) -> tuple[float, ...]:
        """Revolutions of the onset and of every later abrupt change of size, rising."""
        return (self.onset_revolutions, *self.law.changes)


def name_of(effect: Effect) -> str:
    """The effect's key in the table; ParameterError where it is in none."""
    for name, kind in EFFECTS.items():
        if type(effect) is kind:
            return name
    raise ParameterError(f"{type(effect).__name__} is not in the table of effects")
