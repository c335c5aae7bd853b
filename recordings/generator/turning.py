"""Forces that are a function of the pinion's angle: a misaligned jaw coupling, a rub over part of a turn.

Each gives a table of forces over one turn, which the integrator reads at the angle it has reached.

Jaw coupling between torque meter and pinion shaft: n jaws with stiffness k_i at radius R, of hubs whose axes
are apart by e. With ψ_i the jaws' places, and the hubs' relative turn φ from

    Σ k_i·max(0, R·φ + e·cos(θ + ψ_i))·R = T

the jaws push along their tangents with F_i = k_i·max(0, …): the resultant presses on the shaft's overhung
end; the shaft turns clockwise. Unlike jaws turn T into a force at one cycle a turn and e into one at two; where a
light load lets jaws open, as many a turn as there are jaws come with it. Axes at an angle β act as a Hooke joint
does: it turns the hubs by −tan²(β/2)·sin 2θ against each other, and its secondary couple T·tan β·sin²θ bends the
shaft.

Source   M. Xu, R. D. Marangoni, J. Sound Vib. 176 (1994) 663-691 (orders 1, 2, … of a misaligned coupling, ∝ T);
         F. Schmelz, Seherr-Thoss, Aucktor, Universal Joints and Driveshafts (2006), ch. 1 (Hooke joint)
Ignores  inertia and damping of the jaws; the change of T within a turn
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi, tan

import numpy as np
from scipy.optimize import brentq

BINS = 512  # of a turn
OVERHANG = 0.3  # distance of the coupling's hub from its bearing, of the distance between the bearings


@dataclass(frozen=True, slots=True)
class Turning:
    """Forces on the pinion's shaft over one turn, by coordinate; (BINS + 1,) each [N] or [N·m]."""

    forces: Mapping[str, np.ndarray]
    twist: np.ndarray | None = None  # of the coupling between nodes 2 and 3, against its mean [rad]
    roughness: float = 0.0  # relative standard deviation of the forces' quick part


def angles() -> np.ndarray:
    """Pinion angles of the tables [rad], (BINS + 1,)."""
    return 2 * pi * np.arange(BINS + 1) / BINS


@dataclass(frozen=True, slots=True)
class Coupling:
    """A jaw coupling whose hubs do not run true to each other."""

    offset: float  # e [m]
    angle: float  # β [rad]
    stiffness: tuple[float, ...]  # of each jaw [N/m]
    radius: float  # R [m]

    def twist(self, torque: float, θ: np.ndarray) -> np.ndarray:
        """Relative turn φ of the hubs at angles (n,) under a torque [N·m] → (n,) [rad]."""
        k, R = np.array(self.stiffness), self.radius
        ψ = 2 * pi * np.arange(k.size) / k.size
        wide = torque / (k.min() * R**2) + abs(self.offset) / R

        def missing(φ, at):
            return R * float(k @ np.maximum(0.0, R * φ + self.offset * np.cos(at + ψ))) - torque

        return np.array([brentq(missing, -wide, wide, args=(at,), xtol=1e-14) for at in θ])

    def push(self, torque: float, θ: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force of the jaws on the driven hub, x and y [N]; (n,) angles → (n,) each."""
        k = np.array(self.stiffness)
        at = θ[:, None] + 2 * pi * np.arange(k.size) / k.size
        squeezed = np.maximum(0.0, self.radius * self.twist(torque, θ)[:, None] + self.offset * np.cos(at))
        return -(k * squeezed * np.sin(at)).sum(1), -(k * squeezed * np.cos(at)).sum(1)

    def turning(self, torque: float, span: float) -> Turning:
        """Its forces on the pinion shaft's bearings, `span` [m] apart, and its twist, under a torque [N·m]."""
        θ = angles()
        x, y = self.push(torque, θ)
        couple = torque * tan(self.angle) * np.sin(θ) ** 2 / span
        twist = self.twist(torque, θ) - tan(self.angle / 2) ** 2 * np.sin(2 * θ)
        near, far = 1 + OVERHANG, -OVERHANG
        return Turning(
            {"x4": near * x, "x6": far * x, "y4": near * y + couple, "y6": far * y - couple},
            twist - twist[:-1].mean(),
        )


@dataclass(frozen=True, slots=True)
class ShaftRub:
    """A high spot of the pinion's shaft that runs against a fixed part over some of every turn.

    The normal force rises as the spot is pressed in, N0·(cos(θ − θ0) − cos πa)/(1 − cos πa), over the share a of
    the turn; friction μN brakes the shaft and pushes it sideways. The part stands over the shaft, at +y.
    """

    force: float  # N0 [N]
    share: float  # a
    phase: float  # θ0 [rad]
    friction: float  # μ
    radius: float  # of the shaft [m]
    roughness: float

    def turning(self, torque: float, span: float) -> Turning:
        """Its forces on the pinion; they depend neither on the load [N·m] nor on the bearings' distance [m]."""
        end = np.cos(pi * self.share)
        normal = self.force * np.clip(np.cos(angles() - self.phase) - end, 0, None) / (1 - end)
        drag = self.friction * normal
        return Turning({"y5": -normal, "x5": -drag, "th5": -self.radius * drag}, roughness=self.roughness)


def jaws(count: int, stiffness: float, scatter: float, rng: np.random.Generator) -> tuple[float, ...]:
    """Stiffness of the jaws [N/m], each off by up to a relative scatter."""
    return tuple(float(stiffness * (1 + scatter * f)) for f in rng.uniform(-1, 1, count))
