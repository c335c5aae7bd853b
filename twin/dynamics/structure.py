"""The linear part of the 21-degree-of-freedom model: M, C, K, modes, frequency response.

    M q'' + C q' + K q = f_ext − g·F,        d = gᵀq

    d = r_b1·θ5 − r_b2·θ10 − (y5 − y10)·cos α + (x5 − x10)·sin α

q   coordinates in the order of the paper's eq. 2                              [rad, m]
F   mesh force, positive when the teeth press together                         [N]
d   deflection of the mesh along the line of action, positive in compression   [m]
C   modal damping M Φ diag(2ζω) Φᵀ M with the mass-normalised modes of the system without the mesh,
    rigid rotations undamped

Source   K. Feng et al., Wear 426–427 (2019) 1410–1415, eqs 1–5 and Fig. 3; the signs, which are partly
         lost in print, are those with which the mesh force does equal and opposite work on both gears
Holds    small motions about a steady rotation
Ignores  the overhung shaft ends: a coupling's lateral stiffness acts at the bearing next to it
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import cos, pi, sin

import numpy as np
from scipy.linalg import eigh

from twin.errors import ParameterError
from twin.rig import Rig
from twin.rig_schema import DEGREES_OF_FREEDOM, TORSION_LINKS

INDEX = {name: i for i, name in enumerate(DEGREES_OF_FREEDOM)}
TORSION_NODES = (1, 2, 3, 5, 7, 8, 10, 12, 13)
LATERAL_NODES = (4, 5, 6, 9, 10, 11)

COUPLED_NODES = (4, 11)  # bearings next to the couplings to motor and brake, which are fixed to the ground

UNDAMPED = ("modes", "_vibrating", "_static_modes", "error_beyond_mesh")  # what no damping changes
FEW = 16  # frequencies up to which a receptance is kept
PIECE = 1024  # frequencies side by side: what every mode adds stays in the processor's cache
RIGID_HZ = 1.0  # a mode below this is a rotation of the whole, not a vibration


def _link(stiffness: np.ndarray, k: float, combination: Mapping[str, float]) -> None:
    """Adds a spring k that acts on a linear combination of coordinates."""
    for a, wa in combination.items():
        for b, wb in combination.items():
            stiffness[INDEX[a], INDEX[b]] += k * (wa * wb)


def mass_matrix(rig: Rig) -> np.ndarray:
    """M of the rig (21, 21) [kg, kg·m²]."""
    inertia = [f"inertias.J{n}" for n in TORSION_NODES]
    mass = [f"masses.m{n}" for n in LATERAL_NODES]
    values = rig.require("the mass matrix", *inertia, *mass)
    diagonal = dict(zip([f"th{n}" for n in TORSION_NODES], values, strict=False))
    for n, m in zip(LATERAL_NODES, values[len(inertia) :], strict=True):
        diagonal[f"x{n}"] = diagonal[f"y{n}"] = m
    return np.diag([diagonal[name] for name in DEGREES_OF_FREEDOM])


def stiffness_matrix(rig: Rig) -> np.ndarray:
    """K of the rig without the mesh (21, 21) [N/m, N·m/rad]."""
    K = np.zeros((21, 21))
    names = [f"torsional_stiffness.k_{a}_{b}" for a, b in TORSION_LINKS]
    for (a, b), k in zip(TORSION_LINKS, rig.require("the torsion chains", *names), strict=True):
        _link(K, k, {f"th{a}": 1.0, f"th{b}": -1.0})
    f, k_in, k_out = rig.require(
        "the lateral stiffness",
        "shafts.gear_position_fraction",
        "shafts.bending_stiffness_input",
        "shafts.bending_stiffness_output",
    )
    for axis in "xy":
        _link(K, k_in, {f"{axis}5": 1.0, f"{axis}4": -(1 - f), f"{axis}6": -f})
        _link(K, k_out, {f"{axis}10": 1.0, f"{axis}9": -f, f"{axis}11": -(1 - f)})
        bearings = rig.require("the bearings", f"bearings.k{axis}_input", f"bearings.k{axis}_output")
        for nodes, k in zip(((4, 6), (9, 11)), bearings, strict=True):
            for n in nodes:
                _link(K, k, {f"{axis}{n}": 1.0})
    for n in COUPLED_NODES:
        for axis in "xy":
            _link(K, rig.get("couplings.lateral_stiffness", 0.0), {f"{axis}{n}": 1.0})
    return K


def torque_meter(rig: Rig) -> np.ndarray:
    """From coordinates to the torque meter's reading, k_a_b·(θa − θb) (21,) [N·m]."""
    a, b = rig.torque_meter
    (k,) = rig.require("the torque meter", f"torsional_stiffness.k_{a}_{b}")
    return direction({f"th{a}": k, f"th{b}": -k})


def mesh_direction(rig: Rig) -> np.ndarray:
    """g = ∂d/∂q (21,) [m/rad, 1]."""
    pair = rig.gear_pair()
    α, (rb1, rb2) = pair.pressure_angle, pair.base_radius
    return direction({"th5": rb1, "th10": -rb2, "y5": -cos(α), "y10": cos(α), "x5": sin(α), "x10": -sin(α)})


def direction(weights: Mapping[str, float]) -> np.ndarray:
    """A vector over the coordinates from weights by name; (21,)."""
    unknown = set(weights) - set(INDEX)
    if unknown:
        raise ParameterError(f"{', '.join(sorted(unknown))} is no coordinate of the model; {DEGREES_OF_FREEDOM}")
    v = np.zeros(21)
    for name, w in weights.items():
        v[INDEX[name]] = w
    return v


@dataclass(frozen=True, eq=False, kw_only=True)
class Structure:
    """The gearbox without its mesh, in modal form."""

    mass: np.ndarray  # M (21, 21)
    stiffness: np.ndarray  # K (21, 21)
    mesh: np.ndarray  # g (21,)
    modal_damping: float  # ζ of every vibrating mode
    transmission_error: np.ndarray  # direction r_b1·θ7 − r_b2·θ8 of the encoders (21,) [m/rad]
    pinion_motion: np.ndarray  # direction r_b1·θ7 of the pinion's encoder alone (21,) [m/rad]
    torque_meter: np.ndarray  # direction of the torque meter (21,) [N·m/rad]

    @classmethod
    def from_rig(cls, rig: Rig, *, modal_damping: float | None = None) -> Structure:
        """The structure of a rig file; NotAvailable where tables are missing."""
        ζ = modal_damping
        if ζ is None:
            (ζ,) = rig.require("modal damping", "damping.modal_ratio")
        if not 0 <= ζ < 1:
            raise ParameterError(f"modal_damping = {ζ} is outside [0, 1); percent?")
        rb1, rb2 = rig.gear_pair().base_radius
        pinion, gear = rig.encoders
        return cls(
            mass=mass_matrix(rig),
            stiffness=stiffness_matrix(rig),
            mesh=mesh_direction(rig),
            modal_damping=ζ,
            transmission_error=direction({pinion: rb1, gear: -rb2}),
            pinion_motion=direction({pinion: rb1}),
            torque_meter=torque_meter(rig),
        )

    def damped(self, modal_damping: float) -> Structure:
        """The same structure with another damping of its modes, which stay as they are."""
        return _damped(self, modal_damping)

    @cached_property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Angular frequencies (21,) [rad/s] and mass-normalised modes (21, 21), without the mesh."""
        λ, Φ = eigh(self.stiffness, self.mass)
        return np.sqrt(np.clip(λ, 0, None)), Φ

    @cached_property
    def _vibrating(self) -> np.ndarray:
        """Which modes are no rigid rotations (21,)."""
        return self.modes[0] > 2 * pi * RIGID_HZ

    @cached_property
    def modal_damping_terms(self) -> np.ndarray:
        """2ζω of every mode [rad/s], zero for rigid rotations; (21,)."""
        return np.where(self._vibrating, 2 * self.modal_damping * self.modes[0], 0.0)

    @cached_property
    def damping(self) -> np.ndarray:
        """C = M Φ diag(2ζω) Φᵀ M (21, 21)."""
        MΦ = self.mass @ self.modes[1]
        return (MΦ * self.modal_damping_terms) @ MΦ.T

    def natural_frequencies(self, mesh_stiffness: float = 0.0) -> np.ndarray:
        """All natural frequencies with a constant mesh stiffness [N/m]; (21,) [Hz], rigid modes as 0."""
        return self.coupled_modes(mesh_stiffness)[0]

    def coupled_modes(self, mesh_stiffness: float) -> tuple[np.ndarray, np.ndarray]:
        """Natural frequencies (21,) [Hz] and mass-normalised modes (21, 21) with the mesh closed."""
        K = self.stiffness + mesh_stiffness * np.outer(self.mesh, self.mesh)
        λ, Φ = eigh(K, self.mass)
        f = np.sqrt(np.clip(λ, 0, None)) / (2 * pi)
        return np.where(f > RIGID_HZ, f, 0.0), Φ

    def receptance(self, omega: np.ndarray, force: np.ndarray, response: np.ndarray) -> np.ndarray:
        """Response along one direction to a unit force along another, without the mesh.

        omega (n,) [rad/s], non-zero; force (21,), response (21,) → (n,) complex [m/N].
        H(ω) = Σ_r (responseᵀφ_r)(φ_rᵀforce) / (ω_r² − ω² + iω·2ζω_r)
        """
        ω = np.asarray(omega, dtype=float)
        if ω.size <= FEW:
            return _few_receptances(self, ω.tobytes(), force.tobytes(), response.tobytes())
        Φ = self.modes[1]
        strength, out = (response @ Φ) * (Φ.T @ force), np.empty(ω.size, dtype=complex)
        for first in range(0, ω.size, PIECE):
            some = slice(first, first + PIECE)
            real = self.modes[0][:, None] ** 2 - ω[some] ** 2
            imag = self.modal_damping_terms[:, None] * ω[some]
            square = real**2 + imag**2
            real /= square
            imag /= square
            out.real[some], out.imag[some] = strength @ real, -(strength @ imag)
        return out

    def receptances(self, omega: np.ndarray, force: np.ndarray, responses: Sequence[np.ndarray]) -> np.ndarray:
        """The same along several directions (m, n), at a few frequencies that are not asked for again."""
        ω, Φ = omega[:, None], self.modes[1]
        modal = 1 / (self.modes[0] ** 2 - ω**2 + 1j * ω * self.modal_damping_terms)
        return ((np.array(responses) @ Φ) * (Φ.T @ force)) @ modal.T

    def static_response(self, response: np.ndarray, force: np.ndarray) -> float:
        """Mean response [m/N] along one direction to a self-balanced set of constant forces.

        The force must do no work on the rigid rotations (torque in equals torque out).
        """
        vibrating, rigid, compliance = self._static_modes
        excited = force @ vibrating
        turning = float(np.abs(force @ rigid).max(initial=0.0))
        if turning > 1e-6 * max(float(np.abs(excited).max(initial=1e-300)), turning):
            raise ParameterError("the constant forces are not in balance: they would turn the shafts faster and faster")
        return float((response @ vibrating) @ (excited * compliance))

    @cached_property
    def error_beyond_mesh(self) -> np.ndarray:
        """Mean transmission error beyond the mesh's deflection per constant force along each coordinate (21,).

        For forces in balance alone: rigid rotations are left out.
        """
        vibrating, _, compliance = self._static_modes
        return vibrating @ (compliance * ((self.transmission_error - self.mesh) @ vibrating))

    @cached_property
    def _static_modes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Modes that vibrate (21, v), rigid rotations (21, 21 − v) and the compliance 1/ω² of the former (v,)."""
        ω_r, Φ = self.modes
        vibrating = self._vibrating
        return Φ[:, vibrating], Φ[:, ~vibrating], 1 / ω_r[vibrating] ** 2


@lru_cache(maxsize=1024)  # at most FEW frequencies: 1 MB together
def _few_receptances(structure: Structure, omega: bytes, force: bytes, response: bytes) -> np.ndarray:
    """`Structure.receptance` at the lines that are compared with measured ones, which fits ask for again and again."""
    (values,) = structure.receptances(np.frombuffer(omega), np.frombuffer(force), [np.frombuffer(response)])
    values.setflags(write=False)
    return values


@lru_cache(maxsize=64)
def _damped(structure: Structure, modal_damping: float) -> Structure:
    """One and the same structure for one and the same damping: what is kept of it is found again."""
    other = replace(structure, modal_damping=modal_damping)
    for name in UNDAMPED:
        other.__dict__[name] = getattr(structure, name)
    return other
