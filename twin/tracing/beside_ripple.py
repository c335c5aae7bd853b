"""What a torque ripple leaves of the line that teeth which differ make at its order.

    X′_p = X_p − H_p·a

X_p  line of the transmission error at the ripple's order p of the pinion            [m]
a    the ripple, by the torque meter                                                 [N·m]
H_p  what a unit of it makes of the transmission error, by the harmonic balance      [m/(N·m)]

The line alone proves no pitch errors, for the ripple makes it as well; where other lines prove them, they are fitted to
what is left of it.

Source   twin/effects/torque_ripple.py
Holds    ripples whose response is linear
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.features.window_features import WindowFeatures
from twin.tracing.context import TracingContext
from twin.tracing.shaft_lines import unit_responses, without_line


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BesideRipple:
    """The first windows without what a torque ripple makes of one of their lines."""

    windows: tuple[WindowFeatures, ...]
    order: int  # of the pinion
    std: float  # of what the ripple makes of the line [m]


def beside_ripple(context: TracingContext, count: int, scatter: float, same_speed: float) -> BesideRipple | None:
    """The first windows, `count` many; None without a suspected ripple, or without a steady state with it.

    scatter     what the line that the ripple makes may be off, of itself
    same_speed  as in `unit_responses`
    """
    ripple = context.findings.force("torque")
    if ripple is None:
        return None
    first = context.fitting[:count]
    made = unit_responses(
        context.model,
        [w.condition for w in first],
        ripple.effect,
        "transmission_error",
        ripple.order,
        context.mesh_phase,
        same_speed,
    )
    if made is None:
        return None
    order = round(ripple.order)
    windows = without_line([w.features for w in first], (0, order, 0), made)
    return BesideRipple(windows=tuple(windows), order=order, std=scatter * float(np.abs(made).max()))
