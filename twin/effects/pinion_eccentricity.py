"""Eccentric pinion: its teeth turn about a point beside their centre.

    e_p(θ1) = e·cos(θ1 + φ)        and the shift of the contact along the flanks (eccentricity.py)

e   eccentricity                                                             [m]
θ1  angle of the pinion, zero when pair 0 passes the pitch point                [rad]
φ   angle of the high point, at θ1 = 0, from where the teeth press together most [rad]

Order    1 of the pinion's rotation, and sidebands at that distance about the mesh orders
Source   displacement: Feng et al., Wear 426–427 (2019), e_t of eqs 3–5; the shift: the internal tangent of two base
         circles whose distance varies, derived in eccentricity.py
Holds    e much smaller than the module
Ignores  the pressure angle in the directions of the forces, e/L of a radian; unbalance of the eccentric mass
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

from twin.effects.eccentricity import eccentric
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature


@dataclass(frozen=True, slots=True, kw_only=True)
class PinionEccentricity:
    """The pinion's teeth beside its axis."""

    eccentricity: float  # e [m]
    high_point: float = 0.0  # φ [rad]
    shift_share: float = 1.0  # of the contact's shift: run-in ends of the path feel less of it

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="eccentricity", unit="m", low=0.0, high=500e-6, prior=50e-6),
        Parameter(name="high_point", unit="rad", low=-4 * pi, high=4 * pi, prior=2 * pi, shape=True),
        Parameter(name="shift_share", unit="", low=0.0, high=1.5, prior=0.5, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="run_out", shafts=("pinion",))
    period: ClassVar[str] = "pinion"

    def __post_init__(self) -> None:
        check(self)

    def apply(self, setup: Setup) -> Setup:
        return eccentric(setup, self.eccentricity, self.high_point, self.shift_share, shaft=0)
