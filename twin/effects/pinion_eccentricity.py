"""Eccentric pinion: its teeth turn about a point other than their centre.

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
from typing import ClassVar

from twin.effects.eccentricity import Eccentricity, facts_of
from twin.effects.facts import Facts
from twin.effects.signature import Signature


@dataclass(frozen=True, slots=True, kw_only=True)
class PinionEccentricity(Eccentricity):
    """The pinion's teeth off its axis."""

    shaft: ClassVar[int] = 0
    period: ClassVar[str] = "pinion"
    signature: ClassVar[Signature] = Signature(shape="run_out", shafts=("pinion",))
    facts: ClassVar[Facts] = facts_of("pinion")
