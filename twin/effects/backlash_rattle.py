"""Backlash rattle: a load that pulsates while the backlash is wider than it was made.

    T2(θ1) = T2 + (z2/z1)·T̃·cos(o·θ1 + φ) at the brake,      back flanks closer than j + j₊ no longer touch

j₊  added backlash, along the line of action                 [m]
T̃   amplitude of the load's ripple, referred to the pinion   [N·m]
o   order of the pinion's rotation

Where the ripple outweighs the mean torque the teeth part and may strike the back flanks; below that the backlash
does not show at all.

Order    o and its multiples; with contact loss the mesh orders and sidebands too
Source   R. Singh, H. Xie, R. J. Comparin, J. Sound Vib. 131 (1989) 177–196 (rattle criterion)
Holds    responses that repeat with the hunting-tooth period; others do not converge and say so
"""

from __future__ import annotations

from cmath import exp
from dataclasses import dataclass
from math import pi
from typing import ClassVar

from twin.dynamics.structure import direction
from twin.effects.facts import Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature


@dataclass(frozen=True, slots=True, kw_only=True)
class BacklashRattle:
    """Wide backlash under a pulsating load."""

    extra_backlash: float  # j₊ [m]
    load_ripple: float  # T̃ [N·m]
    order: float = 1.0  # o
    phase: float = 0.0  # φ [rad]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="extra_backlash", unit="m", low=0.0, high=2e-3, prior=200e-6),
        Parameter(name="load_ripple", unit="N·m", low=0.0, high=1e5, prior=5.0),
        Parameter(name="order", unit="", low=0.02, high=100.0, prior=5.0, shape=True),
        Parameter(name="phase", unit="rad", low=-4 * pi, high=4 * pi, prior=2 * pi, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="parting")
    facts: ClassVar[Facts] = Facts(
        label="rattle in the backlash",
        action="Raise the load or smooth the torque until the teeth stay in contact, and inspect the flanks.",
        stated=("order",),
        acts_on="shaft",
        periods=("pinion", "hunting"),
        detector="rattle",
        alarm_class="alarm",
        changes_mesh_lines=False,
        synchronous=False,
        claims="swing",
        separates_teeth=True,
    )

    def __post_init__(self) -> None:
        check(self)

    @property
    def period(self) -> str:
        return "pinion" if float(self.order).is_integer() else "hunting"

    def apply(self, setup: Setup) -> Setup:
        setup = setup.with_error(-self.extra_backlash * (1 - setup.drive), 0.0)
        if self.load_ripple == 0:
            return setup
        z1, z2 = setup.pair.teeth
        at_brake = -z2 / z1 * self.load_ripple * exp(1j * self.phase)  # the load acts against the rotation
        return setup.with_load(direction({"th13": 1.0}), {self.order: at_brake})
