"""What the two eccentricities share: a gear whose teeth turn about a point other than their centre.

The gear's centre moves by δ against the pinion's: along the line of action (unit vector t, from the pinion's base
circle to the gear's) and across it (n). The flanks part by the displacement along their common normal, and the
internal tangent of both base circles turns:

    gap = δ·t = −e_p        L·δL = c·δ = (r_b1 + r_b2)·δ·n + L·δ·t        δψ = δ·n/L
    σ1 = r_b1·δψ            σ2 = −r_b2·δψ

e_p     added separation, the same at every contact                               [m]
c       from the pinion's centre to the gear's, c·n = r_b1 + r_b2, c·t = L        [m]
L       length of the line of action between the base circles, (r_b1 + r_b2)·tan α [m]
σ1, σ2  shift of the contact along the pinion's and the gear's flank, in s        [m]

The lengths unwound from the two base circles grow by r_b1·δψ and r_b2·δψ, which is what δL exceeds δ·t by; on the
path they run from opposite ends, hence the signs. Contact so wanders outward on both flanks when the centres draw
apart. It begins and ends elsewhere, which is what makes sidebands; worn flanks hardly add to them, for the wear
that moves with the pinion's flank and that which moves with the gear's, shared as z2 to z1, move against each other by
r_b1 to r_b2 and cancel to first order. And because the separation depends on the shaft's own angle, the contacts do
work on it: a moment −de_p/dθ·F (virtual work), the torque's line.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, tan
from typing import ClassVar

import numpy as np

from twin.dynamics.structure import direction
from twin.effects.facts import DetectionThresholds, Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup, Shift
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class EccentricityDetection(DetectionThresholds):
    """A run-out that the backlash allows."""

    largest_size: float = deciding(
        1.0,
        of="run-out that takes up the backlash",
        meaning="largest eccentricity that is possible; the model is given no more",
        source="derivation: j = 2·e·sin α, the change of j with the centre distance; beyond it the teeth jam",
    )


def facts_of(gear: str) -> Facts:
    """What is said of the eccentricity of one of the two gears."""
    return Facts(
        label=f"{gear} eccentricity",
        action=f"Check the run-out of the {gear} on its shaft at the next stop.",
        acts_on="shaft",
        periods=(gear,),
        detector="eccentricity",
        detection=EccentricityDetection(),
        ended_by=("gears_replaced", "reassembled"),
        changes_mesh_lines=False,  # by less than 0.1 % of worn teeth's lines: extended.py
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Eccentricity:
    """Teeth whose centre is off the shaft's axis; each shaft has its own class, and with it its own period."""

    eccentricity: float  # e [m]
    high_point: float = 0.0  # φ [rad]
    shift_share: float = 1.0  # of the contact's shift: run-in ends of the path feel less of it

    shaft: ClassVar[int]  # 0 pinion, 1 gear
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="eccentricity", unit="m", low=0.0, high=500e-6, prior=50e-6, phase="high_point"),
        Parameter(name="high_point", unit="rad", low=-4 * pi, high=4 * pi, prior=2 * pi, shape=True),
        Parameter(name="shift_share", unit="", low=0.0, high=1.5, prior=0.5, shape=True),
    )

    def __post_init__(self) -> None:
        check(self)

    def apply(self, setup: Setup) -> Setup:
        return eccentric(setup, self.eccentricity, self.high_point, self.shift_share, self.shaft)


def eccentric(setup: Setup, e: float, high_point: float, shift_share: float, shaft: int) -> Setup:
    """A pinion (shaft 0) or gear (shaft 1) with its teeth's centre e [m] off the axis.

    shift_share  1 for flanks whose wear ends at the nominal ends of the path; less where contact has worn beyond
    """
    if e == 0:
        return setup
    passages = setup.passages
    rb1, rb2 = setup.pair.base_radius
    ratio = (1.0, setup.pair.teeth[0] / setup.pair.teeth[1])[shaft]  # dθ/dθ1
    angle = (passages.pinion_angle, passages.gear_angle)[shaft] + high_point
    along, across = e * np.cos(angle), e * np.sin(angle)
    L = (rb1 + rb2) * tan(setup.pair.pressure_angle)
    sign = (1.0, -1.0)[shaft]  # δ·n = ± e·sin: the shafts turn opposite ways
    σ1, σ2 = shift_share * sign * rb1 / L, -shift_share * sign * rb2 / L
    shift = Shift(
        pinion=σ1 * across,
        gear=σ2 * across,
        pinion_slope=σ1 * ratio * along,
        gear_slope=σ2 * ratio * along,
    )
    return (
        setup.with_error(passages.side * along, -ratio * passages.side * across)
        .with_shift(shift)
        .with_action(direction({("th5", "th10")[shaft]: 1.0}), np.broadcast_to(-across, passages.position.shape))
    )
