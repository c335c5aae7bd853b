"""Sliding friction: the flanks drag on one another, one way before the pitch point and the other way after it.

    Φ = μ·Σ F_i·sgn(s_i)

μ  coefficient of friction
F  force of a pair in contact                    [N]
s  path position, zero at the pitch point        [m]

Order    mesh orders only
Source   M. Vaishya, R. Singh, J. Sound Vib. 243 (2001) 671–694
Holds    sliding speeds of the nominal rotation
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, tan
from typing import ClassVar

import numpy as np

from twin.dynamics.structure import direction
from twin.effects.facts import Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature


@dataclass(frozen=True, slots=True, kw_only=True)
class SlidingFriction:
    """Dry flanks."""

    friction: float  # μ

    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter(name="friction", unit="", low=0.0, high=0.4, prior=0.1),)
    signature: ClassVar[Signature] = Signature(shape="alike")
    facts: ClassVar[Facts] = Facts(
        label="dry flanks", action="Check the lubrication.", acts_on="mesh", periods=("mesh",), detector="mesh"
    )
    period: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        check(self)

    def apply(self, setup: Setup) -> Setup:
        if self.friction == 0:
            return setup
        s, α = setup.passages.position, setup.pair.pressure_angle
        rb1, rb2 = setup.pair.base_radius
        weight = self.friction * setup.drive * np.sign(s)
        along = direction(
            {"x5": cos(α), "y5": sin(α), "th5": -rb1 * tan(α), "x10": -cos(α), "y10": -sin(α), "th10": rb2 * tan(α)}
        )
        lever = direction({"th5": -1.0, "th10": -1.0})  # radii of curvature change by ∓ s along the path
        return setup.with_action(-along, weight).with_action(-lever, weight * s)
