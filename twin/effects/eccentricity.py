"""What the two eccentricities share: a gear whose teeth turn about a point beside their centre.

The gear's centre moves by δ against the pinion's: along the line of action (unit vector t, from the pinion's base
circle to the gear's) and across it (n). The internal tangent of both base circles lengthens and turns:

    δL = δ·t = −e_p        δψ = δ·n/L,   L = (r_b1 + r_b2)·tan α
    σ1 = r_b1·δψ           σ2 = σ1 − δL

e_p     added separation, the same at every contact                               [m]
L       length of the line of action between the base circles                     [m]
σ1, σ2  shift of the contact along the pinion's and the gear's flank, in s        [m]

From c·n = r_b1 + r_b2 and c·t = L for the centres' distance c. The shift moves wear, stiffness and corner contact
against the angle, which is what makes sidebands. And because the separation depends on the shaft's own angle, the
contacts do work on it: a moment −de_p/dθ·F (virtual work), the torque's line.
"""

from __future__ import annotations

from math import tan

import numpy as np

from twin.dynamics.structure import direction
from twin.effects.setup import Setup, Shift


def eccentric(setup: Setup, e: float, high_point: float, shaft: int) -> Setup:
    """A pinion (shaft 0) or gear (shaft 1) with its teeth's centre e [m] off the axis."""
    if e == 0:
        return setup
    passages = setup.passages
    rb1, rb2 = setup.pair.base_radius
    ratio = (1.0, setup.pair.teeth[0] / setup.pair.teeth[1])[shaft]  # dθ/dθ1
    angle = (passages.pinion_angle, passages.gear_angle)[shaft] + high_point
    along, across = e * np.cos(angle), e * np.sin(angle)
    L = (rb1 + rb2) * tan(setup.pair.pressure_angle)
    sign = (1.0, -1.0)[shaft]  # δ·n = ± e·sin: the shafts turn opposite ways
    turn = sign * rb1 / L
    shift = Shift(
        pinion=turn * across,
        gear=turn * across + along,
        pinion_slope=turn * ratio * along,
        gear_slope=turn * ratio * along - ratio * across,
    )
    return (
        setup.with_error(passages.side * along, -ratio * passages.side * across)
        .with_shift(shift)
        .with_action(direction({("th5", "th10")[shaft]: 1.0}), np.broadcast_to(-across, passages.position.shape))
    )
