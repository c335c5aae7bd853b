"""The effects that the mesh search tries: one trial an effect, its free numbers in units of their priors.

All of it follows from what each effect declares (twin/effects/facts.py): which effects the mesh search finds, which
numbers it fits, from where it starts, and how large an effect must be to be reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from twin.effects import EFFECTS
from twin.effects.facts import FittedNumber, numbers_from_priors
from twin.effects.response import Effect
from twin.effects.size_law import SizeLaw
from twin.errors import ParameterError
from twin.tracing.joint_problem import EffectTrial, Free


def mesh_trials() -> dict[str, EffectTrial]:
    """One trial for every effect that the mesh search finds, by name.

    Effects that change how the flanks wear come last: their fits are dear, and by then a hopeless one is seen early.
    """
    names = [name for name, kind in EFFECTS.items() if kind.facts.detector == "mesh"]
    return {name: trial_of(name) for name in sorted(names, key=lambda name: EFFECTS[name].facts.shapes_wear)}


def fitted_numbers(name: str) -> tuple[FittedNumber, ...]:
    """The free numbers of an effect in the mesh search: as it declares them, or all that give it its size."""
    kind: Any = EFFECTS[name]
    return kind.facts.fitted or numbers_from_priors(kind.parameters)


def trial_of(name: str) -> EffectTrial:
    """The trial of one effect; ParameterError where it cannot be fitted over one mesh period."""
    kind, numbers = EFFECTS[name], fitted_numbers(name)
    if kind.facts.periods != ("mesh",) or not numbers:
        raise ParameterError(f"{name} has no number that could be fitted to the lines of one mesh period")

    def make(values: np.ndarray) -> Effect:
        """The effect for free numbers (n,)."""
        return kind(**{n.parameter.name: n.value(u) for n, u in zip(numbers, values, strict=True)})

    free = tuple(Free(name=n.parameter.name, start=n.start, low=n.low, high=n.high) for n in numbers)
    return EffectTrial(name=name, free=free, make=make)


def big_enough(name: str, values: np.ndarray) -> bool:
    """Whether fitted numbers (n,) reach the least size that the effect is reported from."""
    numbers = fitted_numbers(name)
    stages = np.reshape(values, (-1, len(numbers)))
    sizes = [abs(float(u)) for stage in stages for number, u in zip(numbers, stage, strict=True) if number.sizes]
    return max(sizes) >= EFFECTS[name].facts.detection.least_size


def sized(name: str, count: int) -> np.ndarray:
    """Which of so many fitted numbers, those of all stages of an effect, give it its size (n,)."""
    return np.resize([number.sizes for number in fitted_numbers(name)], count)


def with_law(trial: EffectTrial, law: SizeLaw, onset: float, stages: Sequence[np.ndarray]) -> EffectTrial:
    """The trial with another law, starting from the free numbers of each stage of it."""
    one = trial.free[: len(trial.free) // trial.stages]
    free = tuple(replace(f, start=float(v)) for values in stages for f, v in zip(one, values, strict=True))
    return replace(trial, free=free, onset=onset, law=law)


def started(trial: EffectTrial, values: np.ndarray, onset: float) -> EffectTrial:
    """The trial starting elsewhere and setting in after so many revolutions."""
    free = tuple(replace(f, start=float(v)) for f, v in zip(trial.free, values, strict=True))
    return replace(trial, free=free, onset=onset)


def plain(effect: Effect) -> Effect:
    """The effect with plain numbers."""
    values = {p.name: getattr(effect, p.name) for p in effect.parameters}
    plain = {k: float(v) if isinstance(v, (float, np.floating)) else v for k, v in values.items()}
    return type(effect)(**plain)
