"""Heavy spot: the pinion's centre of mass runs round its axis.

    f_x = U·ω²·cos(θ1 + φ),   f_y = −U·ω²·sin(θ1 + φ)

U  mass times distance from the axis             [kg·m]
φ  angle of the spot at θ1 = 0, from x           [rad]

Order    1 of the pinion's rotation
Source   ISO 21940-11:2016
Holds    rigid rotors
"""

from __future__ import annotations

from cmath import exp
from dataclasses import dataclass
from math import pi
from typing import ClassVar

from twin.dynamics.structure import direction
from twin.effects.facts import Facts, ShaftLine
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature


@dataclass(frozen=True, slots=True, kw_only=True)
class HeavySpot:
    """A pinion with a heavy spot."""

    unbalance: float  # U [kg·m]
    spot: float = 0.0  # φ [rad]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="unbalance", unit="kg·m", low=0.0, high=1.0, prior=1e-4),
        Parameter(name="spot", unit="rad", low=-4 * pi, high=4 * pi, prior=2 * pi, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="run_out", shafts=("pinion",))
    facts: ClassVar[Facts] = Facts(
        label="a heavy spot on the pinion",
        action="Check the balance of the shaft.",
        acts_on="shaft",
        periods=("pinion",),
        detector="shaft_forces",
        changes_mesh_lines=False,
        shaft_line=ShaftLine(channel="acceleration", size="unbalance", phase="spot", unit=1e-3),
    )
    period: ClassVar[str] = "pinion"

    def __post_init__(self) -> None:
        check(self)

    def apply(self, setup: Setup) -> Setup:
        if self.unbalance == 0:
            return setup
        force = self.unbalance * setup.omega[0] ** 2 * exp(1j * self.spot)
        return setup.with_load(direction({"x5": 1.0}), {1.0: force}).with_load(
            direction({"y5": 1.0}), {1.0: 1j * force}
        )
