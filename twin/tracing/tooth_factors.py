"""What differences between the teeth make of the mesh lines, as factors on the lines of teeth that are all alike.

    m_w = m′_w(effects)·f_w(effects, teeth)

m′  lines that the effects of the mesh's period make of teeth that are all alike
f   what pitch errors or a crack make of them: unworn lines double, and how much depends on all else that is there

f of pinion and gear one after the other, whose departures add up within some per cent, is cheap; f of both together
needs the hunting-tooth period.

Source   twin/effects/pitch_error.py, tooth_crack.py; checked in tests/claims/test_tracing_teeth.py
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin.effects.addition import Addition
from twin.effects.extended import WindowLines, extend, window_lines
from twin.effects.pitch_error import PitchError
from twin.effects.response import Effect
from twin.errors import TwinError
from twin.model import Model
from twin.tracing.observed import HARMONICS, Observed
from twin.wear.profile import WornProfile

Factors = list[dict[str, np.ndarray]]  # of each window, by channel (n,)


def factors_of(
    model: Model,
    windows: Sequence[Observed],
    profiles: Mapping[int, WornProfile],
    teeth: Sequence[Addition],
    mesh_effects: Sequence[Addition] = (),
    together: bool = True,
) -> Factors | None:
    """What effects of longer periods make of each window's mesh lines; None where there are none.

    profiles      of each window, by index
    teeth         effects that differ from tooth to tooth
    mesh_effects  effects of the mesh's own period
    together      whether pinion and gear are solved over the period of both
    """
    if not teeth:
        return None
    out: Factors = []
    for o in windows:
        there = _present(teeth, o.revolutions)
        mesh = _present(mesh_effects, o.revolutions)
        if not there:
            out.append({})
            continue
        try:
            part = _channels(o, window_lines(extend(model, mesh), profiles[o.index], o.condition))
            groups = [there] if together else _one_by_one(there)
            wholes = [
                _channels(o, window_lines(extend(model, (*group, *mesh)), profiles[o.index], o.condition))
                for group in groups
            ]
        except TwinError:
            out.append({})
            continue
        out.append({c: 1 + sum(whole[c] / part[c] - 1 for whole in wholes) for c in part})
    return out


def _present(additions: Sequence[Addition], revolutions: float) -> tuple[Effect, ...]:
    """The effects as large as they are after so many revolutions."""
    return tuple(effect for a in additions if (effect := a.at(revolutions)) is not None)


def _one_by_one(effects: Sequence[Effect]) -> list[tuple[Effect, ...]]:
    """Pitch errors of pinion and gear apart, and all else as it is."""
    out: list[tuple[Effect, ...]] = []
    for effect in effects:
        if isinstance(effect, PitchError) and effect.pinion and effect.gear:
            out += [(PitchError(pinion=effect.pinion),), (PitchError(gear=effect.gear),)]
        else:
            out.append((effect,))
    return out


def _channels(window: Observed, found: WindowLines) -> dict[str, np.ndarray]:
    error = found.lines.pinion_motion if window.pinion_only else found.lines.transmission_error
    return {
        "encoder": error[: HARMONICS["encoder"]],
        "torque": error[: HARMONICS["torque"]],
        "acceleration": found.lines.acceleration[: HARMONICS["acceleration"]],
    }
