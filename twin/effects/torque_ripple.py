"""Torque ripple: the motor's torque pulsates with its own rotation.

    T(θ1) = T + T̃·cos(o·θ1 + φ)

T̃  amplitude at the motor                         [N·m]
o  order of the motor's rotation
φ  phase at θ1 = 0                                [rad]

Order    o alone while the contact holds; its sidebands about the mesh orders are weak
Source   cogging and commutation at multiples of poles and slots: T. M. Jahns, W. L. Soong, IEEE Trans. Ind.
         Electron. 43 (1996) 321–330
Holds    ripples that turn with the shaft
Ignores  the mains' frequency, which is no order; orders nearer than 1/turns of the record are one
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
class TorqueRipple:
    """A pulsating drive."""

    amplitude: float  # T̃ [N·m]
    order: float = 1.0  # o
    phase: float = 0.0  # φ [rad]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="amplitude", unit="N·m", low=0.0, high=1e5, prior=1.0, phase="phase"),
        Parameter(name="order", unit="", low=0.02, high=100.0, prior=10.0, shape=True),
        Parameter(name="phase", unit="rad", low=-4 * pi, high=4 * pi, prior=2 * pi, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="one_order", shafts=("pinion",))
    facts: ClassVar[Facts] = Facts(
        label="torque ripple",
        action="Check the drive and its supply for a periodic torque.",
        stated=("order",),
        acts_on="shaft",
        periods=("pinion", "hunting"),
        detector="shaft_forces",
        ended_by=(),
        shaft_line=ShaftLine(
            channel="torque", size="amplitude", phase="phase", order="order", unit=0.01, unit_of="rated torque"
        ),
        changes_mesh_lines=False,
    )

    def __post_init__(self) -> None:
        check(self)

    @property
    def period(self) -> str:
        return "pinion" if float(self.order).is_integer() else "hunting"

    def apply(self, setup: Setup) -> Setup:
        if self.amplitude == 0:
            return setup
        return setup.with_load(direction({"th1": 1.0}), {self.order: self.amplitude * exp(1j * self.phase)})
