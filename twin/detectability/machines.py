"""Healthy machines of one rig file, drawn within its tolerances.

What is drawn: every stiffness, mass and damping ratio of the structure, the calibrated values of the mesh, the wear
coefficient, the contact's width, the graduation errors of the encoder discs, the spacing of the teeth, and the mesh
phase. The spreads are those that the tracing allows a healthy machine (rig_tolerances.py, joint_problem.py).

Limits   machines of the rig file's own structure; one accelerometer
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.dynamics.structure import Structure
from twin.effects.pitch_error import PitchError
from twin.model import Calibration, Model, mesh_of
from twin.rig import Rig
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.joint_problem import JointFitThresholds
from twin.tracing.tooth_patterns import PATTERNS
from twin.tracing.transfer_path import within_tolerances


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthySpread:
    """What healthy machines differ by beyond the rig file's tolerances."""

    contact_half_width: float = deciding(
        0.2,
        of="contact half-width",
        meaning="standard deviation of its logarithm",
        source="an estimate, not derived: fits of the reference campaigns lie within it",
    )
    wear_coefficient: float = deciding(
        0.3,
        of="wear coefficient",
        meaning="standard deviation of its logarithm",
        source="an estimate, not derived: pairs of one kind under one lubricant",
    )


SPREAD = HealthySpread()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Disc:
    """The graduation error of one encoder disc."""

    lines: np.ndarray  # at orders 1, 2, … of its own turn, complex (n,) [rad]

    def error(self, angle: np.ndarray) -> np.ndarray:
        """What is added to an angle [rad] (n,) → (n,) [rad]."""
        return sum(
            (abs(a) * np.cos(k * angle + np.angle(a)) for k, a in enumerate(self.lines, start=1)),
            np.zeros(angle.size),
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HealthyMachine:
    """One machine of the rig file."""

    model: Model
    wear_coefficient: float  # K [1/N]
    teeth: PitchError  # what the spacing of sound teeth is off
    discs: tuple[Disc, Disc]  # of pinion and gear
    phase: float  # of the mesh against the zero of the pinion's encoder [rad]


def drawn(rig: Rig, rng: np.random.Generator, spread: HealthySpread = SPREAD) -> HealthyMachine:
    """One machine; NotAvailable where the rig file has no model."""
    prior, scales = Calibration.prior(rig), Scales.of(rig)
    s_k, _, s_τ = JointFitThresholds().calibration_spread
    half_width = prior.contact_half_width * np.exp(spread.contact_half_width * rng.standard_normal())
    calibration = replace(
        prior,
        stiffness_scale=prior.stiffness_scale * float(np.exp(s_k * rng.standard_normal())),
        damping_time=prior.damping_time * float(np.exp(s_τ * rng.standard_normal())),
        contact_half_width=float(half_width),
    )
    values, ζ = within_tolerances(rig, prior.modal_damping, rng)
    model = Model(
        rig=rig,
        calibration=replace(calibration, modal_damping=ζ),
        structure=Structure.from_rig(values, modal_damping=ζ),
        mesh=mesh_of(rig),
    )
    radii = model.mesh.pair.base_radius
    healthy = PATTERNS.healthy_pattern
    pinion, gear = (share * g for share, g in zip(healthy, scales.graduation, strict=True))
    (K,) = rig.require("the wear coefficient", "wear.K")
    return HealthyMachine(
        model=model,
        wear_coefficient=K * float(np.exp(spread.wear_coefficient * rng.standard_normal())),
        teeth=PitchError.drawn(rig.teeth, pinion, gear, int(rng.integers(2**31))),
        discs=(_disc(scales, 0, radii[0], rng), _disc(scales, 1, radii[1], rng)),
        phase=float(rng.uniform(0, 2 * np.pi)),
    )


def _disc(scales: Scales, shaft: int, radius: float, rng: np.random.Generator) -> Disc:
    """A disc with the rig file's errors, given at the base radius [m]."""
    first, others = scales.once_per_turn[shaft], scales.graduation[shaft]
    more = PATTERNS.lowest_order[shaft] - 2  # orders beyond the first that are not taken for the teeth's
    std = np.array([first, *[others / np.sqrt(more)] * more]) / radius
    lines = std * (rng.standard_normal(std.size) + 1j * rng.standard_normal(std.size)) / np.sqrt(2)
    return Disc(lines=lines)
