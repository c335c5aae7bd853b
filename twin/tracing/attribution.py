"""An effect that was found, with what speaks for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twin.effects.addition import Addition
from twin.effects.response import Effect
from twin.effects.size_law import CONSTANT, SizeLaw
from twin.tracing.joint_problem import EffectTrial
from twin.tracing.mesh_trials import trial_of, with_law

MOST_EARLIER = 3  # refits whose earlier numbers are kept: each can test the windows that came until the next


@dataclass(frozen=True, slots=True, kw_only=True)
class Numbers:
    """An effect as one fit gave it."""

    addition: Addition
    fitted: tuple[int, ...]  # indices of the windows that took part in the fit


@dataclass(frozen=True, slots=True, kw_only=True)
class AttributedEffect:
    """An effect with what speaks for it."""

    addition: Addition
    parameters: dict[str, tuple[float, str, float]]  # value, unit, std
    log_evidence: float
    runner_up: str | None = None
    over_runner_up: float | None = None
    alike: tuple[str, ...] = ()  # what the channels there are cannot tell it from
    detail: str = ""
    numbers: tuple[float, ...] = ()  # of an effect on the mesh: as fitted, in units of the priors
    onset_std: float | None = None  # [revolutions]; None where it was there from the start
    chance: float | None = None  # of so large a size without the effect; None: as its standard deviations say
    fitted: tuple[int, ...] = ()  # indices of the windows that its numbers were fitted to
    change_std: tuple[float, float] | None = None  # of the second change: its revolutions, and its factor
    earlier: tuple[Numbers, ...] = ()  # before refits, the latest first

    @classmethod
    def of(cls, effect: Effect, *, onset: float = 0.0, law: SizeLaw = CONSTANT, **figures: Any) -> AttributedEffect:
        """An effect since so many revolutions, 0 where it was there from the start."""
        return cls(addition=Addition(effect=effect, onset_revolutions=onset, law=law), **figures)

    @property
    def name(self) -> str:
        return self.addition.name

    @property
    def by_fit(self) -> tuple[Numbers, ...]:
        """Its numbers in use, and those before every refit, the latest first."""
        return (Numbers(addition=self.addition, fitted=self.fitted), *self.earlier)

    def refit_of(self, known: AttributedEffect | None) -> AttributedEffect:
        """The effect with the numbers that it had before; as it is where it sets in later or no longer does."""
        if known is None or (known.addition.onset_revolutions > 0) != (self.addition.onset_revolutions > 0):
            return self
        return replace(self, earlier=known.by_fit[:MOST_EARLIER])

    @property
    def kept(self) -> EffectTrial | None:
        """The trial that starts from here; None of effects that are not fitted to the mesh lines."""
        if not self.numbers:
            return None
        trial, addition = trial_of(self.name), self.addition
        stages = np.reshape(self.numbers, (-1, len(trial.free)))
        return with_law(trial, addition.law, addition.onset_revolutions, list(stages))
