"""The structure of the machine: its linear part as modes, perturbed as machines are.

    M q'' + C q' + K q = f,    q = Φ u,    u_r'' + 2 ζ_r ω_r u_r' + ω_r² u_r = φ_rᵀ f

21 coordinates: nine rotations, x and y of bearing, gear, bearing on either shaft. The mesh is not in K:
it acts from outside, as forces along

    g  the line of action, d = gᵀq > 0 presses the drive flanks together
    t  the tangent of the drive contact, from gear to pinion (friction)
    b  the line of action of the back flanks

x points from the pinion's centre to the gear's; y along the mesh force's transverse part on the pinion.

Source   Feng et al., Wear 426-427 (2019) 1410-1415, eqs 2-5; numbers from the rig file
Ignores  gyroscopic terms, bending of the overhung shaft ends, the casing
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np
from scipy.linalg import eigh

COORDINATES = (
    "th1", "th2", "th3", "th5", "th7", "th8", "th10", "th12", "th13",
    "y4", "y5", "y6", "y9", "y10", "y11", "x4", "x5", "x6", "x9", "x10", "x11",
)  # fmt: skip
INDEX = {name: i for i, name in enumerate(COORDINATES)}
CHAIN = ((1, 2), (2, 3), (3, 5), (5, 7), (8, 10), (10, 12), (12, 13))


@dataclass(frozen=True, slots=True)
class Structure:
    """The linear machine in modes, mass-normalised; n = 21."""

    mass: np.ndarray  # M (n, n)
    stiffness: np.ndarray  # K without the mesh (n, n)
    modes: np.ndarray  # Φ (n, n), columns
    frequency: np.ndarray  # ω (n,) [rad/s]; the first two are the rigid rotations, 0
    damping_ratio: np.ndarray  # ζ (n,)
    mesh_direction: np.ndarray  # g (n,)
    tangent: np.ndarray  # translations of t (n,); the moments depend on where the teeth touch
    back_direction: np.ndarray  # b (n,)
    torque_meter: np.ndarray  # (n,) row giving the sensed torque [N·m]
    bearings: Mapping[str, float]  # stiffness of each bearing to the ground, by coordinate [N/m]

    def row(self, name: str) -> np.ndarray:
        """Φ's row of one coordinate: from modes to that coordinate, and from a force on it to modes."""
        return self.modes[INDEX[name]].copy()


def build(
    rig: Mapping, rng: np.random.Generator, stiffness_spread=0.0, mass_spread=0.0, damping_spread=0.0
) -> Structure:
    """The machine of a rig file; every stiffness, mass and damping ratio off by up to its relative spread."""

    def off(value: float, spread: float) -> float:
        return value * (1 + spread * rng.uniform(-1, 1))

    M = np.diag([off(_inertia(rig, name), mass_spread) for name in COORDINATES])
    K, k_23, bearings = _stiffness(rig, lambda value: off(value, stiffness_spread))
    ζ0 = float(rig["damping"]["modal_ratio"])
    α = radians(rig["gears"]["pressure_angle_deg"])
    rb1, rb2 = (float(rig["gears"][w]["base_radius"]) for w in ("pinion", "gear"))
    squared, Φ = eigh(K, M)
    ω = np.sqrt(np.maximum(squared, 0.0))
    ω[:2] = 0.0
    ζ = np.array([0.0, 0.0] + [off(ζ0, damping_spread) for _ in ω[2:]])
    Φ = _separate_rigid(Φ, M)
    meter = np.zeros(len(COORDINATES))
    meter[INDEX["th2"]], meter[INDEX["th3"]] = k_23, -k_23
    return Structure(
        mass=M,
        stiffness=K,
        modes=Φ,
        frequency=ω,
        damping_ratio=ζ,
        mesh_direction=_vector(th5=rb1, th10=-rb2, y5=-cos(α), y10=cos(α), x5=sin(α), x10=-sin(α)),
        tangent=_vector(x5=cos(α), y5=sin(α), x10=-cos(α), y10=-sin(α)),
        back_direction=_vector(th5=-rb1, th10=rb2, y5=cos(α), y10=-cos(α), x5=sin(α), x10=-sin(α)),
        torque_meter=meter,
        bearings=bearings,
    )


def natural_frequencies(structure: Structure, mesh_stiffness: float) -> np.ndarray:
    """Undamped natural frequencies [Hz] with the mesh closed by a constant stiffness [N/m]; (21,)."""
    g = structure.mesh_direction
    squared = eigh(structure.stiffness + mesh_stiffness * np.outer(g, g), structure.mass, eigvals_only=True)
    return np.sqrt(np.maximum(squared, 0.0)) / (2 * np.pi)


def _vector(**entries: float) -> np.ndarray:
    out = np.zeros(len(COORDINATES))
    for name, value in entries.items():
        out[INDEX[name]] = value
    return out


def _inertia(rig: Mapping, name: str) -> float:
    node = name.lstrip("thxy")
    return float(rig["inertias"][f"J{node}"] if name.startswith("th") else rig["masses"][f"m{node}"])


def _stiffness(rig: Mapping, off) -> tuple[np.ndarray, float, dict[str, float]]:
    """K without the mesh, the torque meter's own stiffness, and that of the bearings by coordinate."""
    n = len(COORDINATES)
    K = np.zeros((n, n))
    torsion = {pair: off(float(rig["torsional_stiffness"][f"k_{pair[0]}_{pair[1]}"])) for pair in CHAIN}
    for (a, b), k in torsion.items():
        v = _vector(**{f"th{a}": 1.0, f"th{b}": -1.0})
        K += k * np.outer(v, v)
    f, bearings = float(rig["shafts"]["gear_position_fraction"]), {}
    for shaft, (near, gear, far), share in (("input", (4, 5, 6), f), ("output", (9, 10, 11), 1 - f)):
        bend = off(float(rig["shafts"][f"bending_stiffness_{shaft}"]))
        for axis in "xy":
            v = _vector(**{f"{axis}{gear}": 1.0, f"{axis}{near}": share - 1, f"{axis}{far}": -share})
            K += bend * np.outer(v, v)
            for node in (near, far):
                i = INDEX[f"{axis}{node}"]
                bearings[f"{axis}{node}"] = off(float(rig["bearings"][f"k{axis}_{shaft}"]))
                K[i, i] += bearings[f"{axis}{node}"]
    return K, torsion[2, 3], bearings


def _separate_rigid(Φ: np.ndarray, M: np.ndarray) -> np.ndarray:
    """The two rigid rotations, which share the frequency 0, as one mode a shaft."""
    out = Φ.copy()
    for column, nodes in enumerate(((1, 2, 3, 5, 7), (8, 10, 12, 13))):
        v = _vector(**{f"th{i}": 1.0 for i in nodes})
        out[:, column] = v / np.sqrt(v @ M @ v)
    return out
