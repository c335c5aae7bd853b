"""Unbalance of pinion or gear: the centre of mass runs round the axis.

    f_x = U·ω²·cos(θ + φ),   f_y = ∓U·ω²·sin(θ + φ)     at the gear's node; − pinion, + gear, which turns the other way

U  unbalance, mass times eccentricity          [kg·m]
φ  angle of the heavy point at θ = 0, from x   [rad]

Order    1 of the pinion's rotation, z1/z2 for the gear
Source   ISO 21940-11:2016; Newton's second law on a circle
Holds    rigid rotors
Ignores  weight's moment about the axis, U·9.81 m/s²
"""

from __future__ import annotations

from cmath import exp
from dataclasses import dataclass
from math import pi
from typing import ClassVar

from twin.dynamics.structure import direction
from twin.effects.facts import DetectionThresholds, Facts, ShaftLine
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup, common_period
from twin.effects.signature import Signature
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class MassUnbalanceDetection(DetectionThresholds):
    """An unbalance that a rotor may have."""

    largest_size: float = deciding(
        0.352,
        of="rated mesh force over squared speed",
        meaning="largest unbalance that is possible; the model is given no more",
        source="0.05 kg·m on the reference rig: a centrifugal force of a third of the mesh force; not derived",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MassUnbalance:
    """Unbalance of both gears."""

    pinion: float = 0.0  # U1 [kg·m]
    gear: float = 0.0  # U2 [kg·m]
    pinion_heavy_point: float = 0.0  # φ1 [rad]
    gear_heavy_point: float = 0.0  # φ2 [rad]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="pinion", unit="kg·m", low=0.0, high=5.0, prior=1e-4, phase="pinion_heavy_point"),
        Parameter(name="gear", unit="kg·m", low=0.0, high=5.0, prior=1e-4, phase="gear_heavy_point"),
        Parameter(name="pinion_heavy_point", unit="rad", low=-4 * pi, high=4 * pi, prior=2 * pi, shape=True),
        Parameter(name="gear_heavy_point", unit="rad", low=-4 * pi, high=4 * pi, prior=2 * pi, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="run_out", shafts=("pinion", "gear"))
    facts: ClassVar[Facts] = Facts(
        label="mass unbalance",
        action="Check the balance of the shaft at the next stop.",
        acts_on="shaft",
        periods=("mesh", "pinion", "gear", "hunting"),
        detector="shaft_forces",
        shaft_line=ShaftLine(channel="acceleration", size="pinion", phase="pinion_heavy_point", unit=1e-3),
        detection=MassUnbalanceDetection(),
        changes_mesh_lines=False,
    )

    def __post_init__(self) -> None:
        check(self)

    @property
    def period(self) -> str:
        return common_period(name for name, present in (("pinion", self.pinion), ("gear", self.gear)) if present)

    def apply(self, setup: Setup) -> Setup:
        z1, z2 = setup.pair.teeth
        rotors = (
            (5, self.pinion, self.pinion_heavy_point, 1.0, 1j),
            (10, self.gear, self.gear_heavy_point, z1 / z2, -1j),
        )
        for (node, U, φ, order, quadrature), ω in zip(rotors, setup.omega, strict=True):
            if U:
                force = U * ω**2 * exp(1j * φ)
                setup = setup.with_load(direction({f"x{node}": 1.0}), {order: force})
                setup = setup.with_load(direction({f"y{node}": 1.0}), {order: quadrature * force})
        return setup
