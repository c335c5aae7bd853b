"""Friction between the flanks, turning round at the pitch point.

    Φ = Σ μ(v)·F_i·sgn(s_i),      v = |s|·(ω1 + ω2)
    u = (x5 − x10)·cos α + (y5 − y10)·sin α − ρ1·θ5 + ρ2·θ10,     generalised force = Φ·∂u/∂q
    μ(v) = μ_∞ + (μ_0 − μ_∞)·exp(−v/v_s)

Φ        friction force on the pinion, along the flank                   [N]
u        tangential displacement of the pinion's flank on the gear's     [m]
ρ1, ρ2   radii of curvature r_b1·tan α + s, r_b2·tan α − s               [m]
μ_∞      coefficient of friction at speed; Coulomb's where the ratio μ_0/μ_∞ is 1
v_s      speed over which the static coefficient falls off (Stribeck)    [m/s]

Force and moment come from one displacement, so Φ takes the power Σ μ·F·v ≥ 0 from the rotation.

Order    mesh orders only
Source   reversal at the pitch point: M. Vaishya, R. Singh, J. Sound Vib. 243 (2001) 671–694;
         the falling curve: R. Stribeck, VDI-Z. 46 (1902), in the exponential form of B. Armstrong-Hélouvry et al.,
         Automatica 30 (1994) 1083–1138
Holds    sliding speeds of the nominal rotation
Ignores  reversal by vibration; friction on the back flanks; μ with load and oil
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, tan
from typing import ClassVar

import numpy as np

from twin.dynamics.structure import direction
from twin.effects.facts import DetectionThresholds, Facts, FittedNumber
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class ToothFrictionDetection(DetectionThresholds):
    """Friction that sound, lubricated teeth do not have."""

    least_size: float = deciding(
        0.15,
        of="0.1, the coefficient of friction of lubricated steel",
        meaning="coefficient of friction from which friction is reported",
        source="tuned on T01–T58; not derived",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ToothFriction:
    """Coulomb friction, or Stribeck's where `static_ratio` is not 1."""

    coefficient: float  # μ_∞
    static_ratio: float = 1.0  # μ_0/μ_∞
    stribeck_speed: float = 0.01  # v_s [m/s]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="coefficient", unit="", low=0.0, high=0.3, prior=0.1),
        Parameter(name="static_ratio", unit="", low=0.5, high=3.0, prior=0.5, neutral=1.0, shape=True),
        Parameter(name="stribeck_speed", unit="m/s", low=1e-4, high=1.0, prior=0.1, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="alike")
    facts: ClassVar[Facts] = Facts(
        label="tooth friction",
        action="Check the lubrication of the gears.",
        acts_on="mesh",
        periods=("mesh",),
        detector="mesh",
        fitted=(FittedNumber(parameter=parameters[0], scale=0.1, low=0.0, high=3.0),),
        detection=ToothFrictionDetection(),
    )
    period: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        check(self)

    def coefficient_at(self, sliding_velocity: np.ndarray) -> np.ndarray:
        """μ at each sliding velocity ≥ 0 [m/s]; (n,) → (n,)."""
        μ, v = self.coefficient, sliding_velocity
        return μ * (1 + (self.static_ratio - 1) * np.exp(-v / self.stribeck_speed))

    def apply(self, setup: Setup) -> Setup:
        if self.coefficient == 0:
            return setup
        s, α = setup.passages.position, setup.pair.pressure_angle
        rb1, rb2 = setup.pair.base_radius
        weight = setup.drive * self.coefficient_at(np.abs(s) * sum(setup.omega)) * np.sign(s)
        at_pitch_point = direction(
            {"x5": cos(α), "y5": sin(α), "th5": -rb1 * tan(α), "x10": -cos(α), "y10": -sin(α), "th10": rb2 * tan(α)}
        )
        beyond = direction({"th5": -1.0, "th10": -1.0})  # ρ1 grows by s and ρ2 falls by it
        return setup.with_action(-at_pitch_point, weight).with_action(-beyond, weight * s)
