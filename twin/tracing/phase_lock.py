"""Whether impacts at a fraction of a turn, or of the mesh order, are the shaft's own: phase, not nearness, decides.

    R = |Σ_w exp(i·m·φ_w)|/n,     P(R) = exp(−n·R²)

φ  phase of the envelope's line at the order k/m of a turn or of the mesh, at absolute angle, in window w
m  so that it does not matter with which of m teeth, or turns, a window begins

What is geared to the shafts comes back to the same phase after thousands of turns. Rolling elements slip: their phase
in one window says nothing of that in the next, whatever their order.

Source   test of Rayleigh: K. V. Mardia, P. E. Jupp, Directional Statistics (2000), ch. 6; slip: R. B. Randall,
         J. Antoni, Mech. Syst. Signal Process. 25 (2011) 485–520
Holds    windows with some hundred turns between them
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.features.non_gear import NonGearFeatures
from twin.features.shaft_orders import fractions
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseLockThresholds:
    """When a line of the envelope is locked to the angle."""

    chance: float = deciding(
        0.05,
        meaning="probability that phases of windows agree as well by chance, below which impacts are the shaft's own",
        source="convention; of bearing defects near such an order 1 in 20 is then taken for the shaft's",
    )
    near: float = deciding(
        2.0, of="standard deviation of the order", meaning="distance of a fraction that is tried", source="convention"
    )
    at_least: float = deciding(
        0.02,
        unit="order",
        meaning="distance within which a fraction is tried in any case",
        source="resolution: 50 turns",
    )
    fewest: int = deciding(
        3,
        unit="windows",
        meaning="windows with a phase",
        source="derivation: two agree to 5 % of chance at no R below 1",
    )


THRESHOLDS = PhaseLockThresholds()


def locked_to(
    order: float,
    std: float,
    windows: Sequence[NonGearFeatures],
    teeth: tuple[int, int],
    limits: PhaseLockThresholds = THRESHOLDS,
) -> float | None:
    """The fraction of a turn or of the mesh that impacts at an order are locked to; None where they are to none.

    A fraction of which too few windows have a phase is not excluded.

    std  of the order
    """
    reach = max(limits.near * std, limits.at_least)
    near = [(o, m) for o, m in fractions(teeth, 0.0, 2 * order).items() if abs(o - order) < reach]
    best = None
    for o, m in near:
        phases = np.array([np.arctan2(im, re) for w in windows for at, re, im in w.locks if at == o])
        if phases.size < limits.fewest:
            return o
        chance = float(np.exp(-(abs(np.exp(1j * m * phases).sum()) ** 2) / phases.size))
        if chance < limits.chance and (best is None or chance < best[0]):
            best = (chance, o)
    return None if best is None else best[1]
