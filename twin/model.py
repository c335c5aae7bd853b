"""The gearbox as the twin sees it: structure, mesh and wear with one set of calibrated values.

model = Model.of(rig, Calibration.prior(rig))
steady = model.steady(profile, condition)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import pi

import numpy as np

from twin.dynamics.contact_loss import solve_through_contact_loss
from twin.dynamics.harmonic_balance import EVERY, SteadyState
from twin.dynamics.mesh import PairMesh
from twin.dynamics.structure import Structure, direction
from twin.errors import ParameterError
from twin.geometry import GearPair
from twin.mesh.stiffness import PairStiffness
from twin.rig import Rig
from twin.wear.profile import WornProfile

SAMPLES = 1024  # a mesh period: 1e-4 of the acceleration at ten harmonics


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """An operating condition."""

    speed_hz: float  # pinion speed [Hz]
    torque: float  # on the pinion [N·m]

    def __post_init__(self) -> None:
        if not self.speed_hz > 0:
            raise ParameterError(f"speed_hz = {self.speed_hz:g} Hz must be positive")
        if not self.torque > 0:
            raise ParameterError(f"torque = {self.torque:g} N·m must be positive: the pinion drives forward")


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """What the paper's section 3.3 calibrates, and the contact half-width."""

    stiffness_scale: float  # on every pair's stiffness
    modal_damping: float  # ζ
    damping_time: float  # τ of a contact [s]
    contact_half_width: float  # a [m]

    @classmethod
    def prior(cls, rig: Rig) -> Calibration:
        """The values of the rig file, before any measurement."""
        scale, ζ, τ, a = rig.require(
            "the calibration's prior",
            "mesh.stiffness_scale",
            "damping.modal_ratio",
            "mesh.relative_damping_time",
            "wear.contact_half_width",
        )
        return cls(stiffness_scale=scale, modal_damping=ζ, damping_time=τ, contact_half_width=a)


Table = tuple[tuple[float, ...], tuple[float, ...]]


@lru_cache(maxsize=16)
def _mesh(pair: GearPair, samples: int, table: Table | None) -> PairMesh:
    return PairMesh.of(pair, samples, None if table is None else PairStiffness.given(pair, *table))


def mesh_of(rig: Rig, samples: int = SAMPLES) -> PairMesh:
    """The mesh of a rig's pair; its stiffness is the rig file's table where `mesh.stiffness_source` selects it."""
    return _mesh(rig.gear_pair(), samples, rig.given_pair_stiffness)


@dataclass(frozen=True, eq=False, kw_only=True)
class Model:
    """One calibrated gearbox."""

    rig: Rig
    calibration: Calibration
    structure: Structure
    mesh: PairMesh

    @classmethod
    def of(cls, rig: Rig, calibration: Calibration, samples: int = SAMPLES) -> Model:
        """Builds the model; NotAvailable where the rig file lacks what it needs."""
        structure = Structure.from_rig(rig, modal_damping=calibration.modal_damping)
        return cls(rig=rig, calibration=calibration, structure=structure, mesh=mesh_of(rig, samples))

    def calibrated(self, **changes: float) -> Model:
        """The same gearbox with other calibrated values."""
        calibration = replace(self.calibration, **changes)
        structure = self.structure
        if calibration.modal_damping != structure.modal_damping:
            structure = structure.damped(calibration.modal_damping)
        return replace(self, calibration=calibration, structure=structure)

    @property
    def slices(self) -> int:
        """Slices across the face that wear on their own: one, unless an effect loads the face unevenly."""
        return 1

    @cached_property
    def unworn(self) -> WornProfile:
        return WornProfile.unworn(self.mesh.pair)

    def mean_force(self, condition: Condition) -> float:
        """T/r_b1 [N]."""
        return condition.torque / self.mesh.pair.base_radius[0]

    def steady(self, profile: WornProfile, condition: Condition, start: SteadyState | None = None) -> SteadyState:
        """Steady state over one mesh period; see its `converged`."""
        contacts = self.mesh.contacts(
            profile,
            condition.speed_hz,
            stiffness_scale=self.calibration.stiffness_scale,
            damping_time=self.calibration.damping_time,
        )
        return solve_through_contact_loss(
            self.structure,
            contacts,
            self.mean_force(condition),
            start=start,
        )

    @cached_property
    def accelerometer(self) -> np.ndarray:
        """Direction of the reference accelerometer (21,)."""
        (name,) = self.rig.require("the accelerometer's place", "sensors.accelerometer")
        return direction({name: 1.0})

    def acceleration_lines(self, steady: SteadyState, at: slice = EVERY) -> np.ndarray:
        """Complex amplitude of the accelerometer at every mesh harmonic k ≥ 1, or at some [m/s²]."""
        return -(steady.omega[at] ** 2) * steady.lines(self.structure, self.accelerometer, at)

    def transmission_error_lines(self, steady: SteadyState, at: slice = EVERY) -> np.ndarray:
        """Complex amplitude of r_b1·θ7 − r_b2·θ8 at every mesh harmonic k ≥ 1, or at some [m]."""
        return steady.lines(self.structure, self.structure.transmission_error, at)

    def pinion_motion_lines(self, steady: SteadyState, at: slice = EVERY) -> np.ndarray:
        """Complex amplitude of r_b1·θ, what the pinion's encoder measures, at every mesh harmonic, or at some [m]."""
        return steady.lines(self.structure, self.structure.pinion_motion, at)

    def torque_lines(self, steady: SteadyState) -> np.ndarray:
        """Complex amplitude of the torque meter at every mesh harmonic k ≥ 1 [N·m]."""
        return steady.lines(self.structure, self.structure.torque_meter)

    @cached_property
    def compliance_outside_mesh(self) -> float:
        """Mean transmission error beyond that of the mesh, per torque on the pinion [m/(N·m)]."""
        return compliance_outside_mesh(self.structure, self.mesh.pair)

    def mean_transmission_error(self, steady: SteadyState, condition: Condition) -> float:
        """Mean of r_b1·θ7 − r_b2·θ8 [m], zero for rigid perfect gears without load."""
        return float(steady.deflection.mean()) + self.compliance_outside_mesh * condition.torque

    def acceleration_rms(self, steady: SteadyState, band: tuple[float, float] | None = None) -> float:
        """RMS of the accelerometer in a band [Hz], the rig's by default [m/s²]."""
        low, high = self.rig.band if band is None else band
        f = steady.omega[1:] / (2 * pi)
        inside = (f >= low) & (f <= high)
        return float(np.sqrt(0.5 * np.sum(np.abs(self.acceleration_lines(steady)[inside]) ** 2)))


def compliance_outside_mesh(structure: Structure, pair: GearPair) -> float:
    """Mean transmission error of a structure beyond that of its mesh, per torque on the pinion [m/(N·m)]."""
    z1, z2 = pair.teeth
    balanced = direction({"th1": 1.0, "th13": -z2 / z1}) - structure.mesh / pair.base_radius[0]
    return structure.static_response(structure.transmission_error - structure.mesh, balanced)
