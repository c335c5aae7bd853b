"""What may change the mesh lines of all channels: one trial an effect, numbers in units of their priors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from twin.effects import EFFECTS, Parameter
from twin.effects.response import Effect
from twin.tracing.joint_fit import EffectTrial, Free

FRICTION, LEAD, RELIEF, SLOPE, LENGTH, LOSS = 0.1, 30e-6, 10e-6, 5e-6, 2e-3, 0.15


def _friction(v: np.ndarray) -> Effect:
    return EFFECTS["tooth_friction"](coefficient=FRICTION * v[0])


def _misalignment(v: np.ndarray) -> Effect:
    return EFFECTS["misalignment"](lead_gap=LEAD * v[0])


def _profile(v: np.ndarray) -> Effect:
    return EFFECTS["profile_error"](
        pinion_relief=RELIEF * v[0],
        gear_relief=RELIEF * v[1],
        slope=SLOPE * v[2],
        relief_length=LENGTH * float(np.exp(0.5 * v[3])),
    )


def _stiffness(v: np.ndarray) -> Effect:
    return EFFECTS["mesh_stiffness_loss"](loss=LOSS * v[0])


def _damping(v: np.ndarray) -> Effect:
    return EFFECTS["mesh_damping"](factor=float(np.exp(0.8 * v[0])))


TRIALS: dict[str, EffectTrial] = {
    trial.name: trial
    for trial in (
        EffectTrial(
            name="tooth_friction", free=(Free(name="coefficient", start=0.5, low=0.0, high=3.0),), make=_friction
        ),
        EffectTrial(
            name="mesh_stiffness_loss", free=(Free(name="loss", start=1.0, low=0.0, high=5.0),), make=_stiffness
        ),
        EffectTrial(name="mesh_damping", free=(Free(name="factor", start=0.5, low=-4.0, high=4.0),), make=_damping),
        EffectTrial(
            name="misalignment", free=(Free(name="lead_gap", start=0.7, low=0.0, high=6.0),), make=_misalignment
        ),
        EffectTrial(
            name="profile_error",
            free=(
                Free(name="pinion_relief", start=0.3, low=0.0, high=15.0),
                Free(name="gear_relief", start=0.3, low=0.0, high=15.0),
                Free(name="slope", start=0.0, low=-15.0, high=15.0),
                Free(name="relief_length", start=0.0, low=-2.0, high=2.0),
            ),
            make=_profile,
        ),
    )
}

BESIDE = ("none", "sensor_gain", "sensor_resonance")  # act over a mesh period, but not on the mesh


def trial_of(name: str) -> EffectTrial | None:
    """The trial of an effect of the table that has none of its own: its numbers in units of their priors.

    None where it does not act over one mesh period, or has a number a tooth.
    """
    kind: Any = EFFECTS[name]
    numbers = [p for p in kind.parameters if not p.shape]
    if name in BESIDE or getattr(kind, "period", None) != "mesh" or any(p.teeth is not None for p in numbers):
        return None

    def make(v: np.ndarray) -> Effect:
        return kind(**{p.name: p.neutral + p.prior * float(u) for p, u in zip(numbers, v, strict=True)})

    free = tuple(
        Free(name=p.name, start=0.5, low=(p.low - p.neutral) / p.prior, high=(p.high - p.neutral) / p.prior)
        for p in numbers
    )
    return EffectTrial(name=name, free=free, make=make) if free else None


# units and scales in which fitted numbers are reported: value = scale(number), std = scale'(number)·std
REPORTED: dict[str, tuple[tuple[str, str, Callable[[float], float]], ...]] = {
    "tooth_friction": (("coefficient", "", lambda u: FRICTION * u),),
    "misalignment": (("lead_gap", "m", lambda u: LEAD * u),),
    "profile_error": (
        ("pinion_relief", "m", lambda u: RELIEF * u),
        ("gear_relief", "m", lambda u: RELIEF * u),
        ("slope", "m", lambda u: SLOPE * u),
        ("relief_length", "m", lambda u: LENGTH * float(np.exp(0.5 * u))),
    ),
    "mesh_stiffness_loss": (("loss", "", lambda u: LOSS * u),),
    "mesh_damping": (("factor", "", lambda u: float(np.exp(0.8 * u))),),
}

LEAST = {  # numbers below which an effect is not told from what real teeth do anyway, in units of their priors
    "tooth_friction": 0.15,
    "misalignment": 0.27,  # 8 µm: helix slope of an accurate gear of this size, ISO 1328-1, class 6
    "profile_error": 0.3,
    "mesh_stiffness_loss": 0.7,
    "mesh_damping": 0.7,
}

DEFAULT_LEAST = 0.3


def _in_si(parameter: Parameter) -> tuple[str, str, Callable[[float], float]]:
    return parameter.name, parameter.unit, lambda u: parameter.neutral + parameter.prior * u


for _name, _kind in EFFECTS.items():  # an effect of the mesh that is new in the table is tried like the rest
    _trial = None if _name in TRIALS else trial_of(_name)
    if _trial is not None:
        TRIALS[_name] = _trial
        REPORTED[_name] = tuple(_in_si(p) for p in _kind.parameters if not p.shape)  # type: ignore[attr-defined]
        LEAST[_name] = DEFAULT_LEAST


def started(trial: EffectTrial, values: np.ndarray, onset: float) -> EffectTrial:
    """The trial starting elsewhere and setting in after so many revolutions."""
    free = tuple(replace(f, start=float(v)) for f, v in zip(trial.free, values, strict=True))
    return replace(trial, free=free, onset=onset)


def plain(effect: Effect) -> Effect:
    """The effect with plain numbers."""
    values = {p.name: getattr(effect, p.name) for p in effect.parameters}
    plain = {k: float(v) if isinstance(v, (float, np.floating)) else v for k, v in values.items()}
    return type(effect)(**plain)
