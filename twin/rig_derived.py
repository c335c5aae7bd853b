"""Values of a rig file that follow from others of it: what is missing is derived, what is given is compared.

    bending stiffness     k_b = 3·E·I·L/(a²·b²),   I = π·d⁴/64,   a = f·L,   b = (1 − f)·L
    torsional stiffness   1/k_t = Σ l_i/(G·J_i),   J_i = π·d_i⁴/32,   G = E/(2·(1 + ν))
    inertia of a wheel    J = ρ·π·(W·r⁴ + l·(d/2)⁴)/2      (disc of the pitch radius and the shaft on both its sides)
    mass of a wheel       m = ρ·π·(W·r² + 0.486·L·(d_b/2)²)   (disc and what of the shaft moves with its middle)
    damping time          τ = c_m/k_m

L       span between the bearings                      [m]
f       distance of the gear from the drive-side bearing over the span
d, d_b  diameter of the shaft next to the gear, effective diameter in bending   [m]
l       length of the shaft of diameter d, both sides  [m]
c_m     damping of the mesh [N·s/m],  k_m its mean stiffness [N/m]

Source   statics of a simply supported beam and of a bar in torsion; 0.486 = 17/35 by Rayleigh's method, with the
         deflection of a beam loaded at its middle, φ = 3ξ − 4ξ³ over 0 ≤ ξ ≤ 1/2: 2·∫φ² dξ
Holds    one material; solid shafts; a gear near the middle of its span (0.486)
Ignores  joints, keyways, shear: a real shaft is softer
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import pi
from typing import Any

Get = Callable[[str], Any]

BEAM_SHARE = 17 / 35
SHAFT_HALVES = ("k_3_5", "k_5_7", "k_8_10", "k_10_12")  # the torsional springs between a shaft's end and its gear


def _values(get: Get, *paths: str) -> tuple[Any, ...] | None:
    values = tuple(get(path) for path in paths)
    return None if any(value is None for value in values) else values


def bending_stiffness(get: Get, shaft: str) -> float | None:
    """k_b [N/m] of the shaft `input` or `output`."""
    given = _values(
        get,
        "gears.youngs_modulus",
        "shafts.bearing_span",
        "shafts.gear_position_fraction",
        f"shafts.bending_diameter_{shaft}",
    )
    if given is None:
        return None
    E, L, f, d = given
    return 3 * E * pi * d**4 / 64 * L / ((f * L) ** 2 * ((1 - f) * L) ** 2)


def half_stiffness_of_segments(get: Get) -> float | None:
    """k_t [N·m/rad] of the half of a shaft, from its segments."""
    given = _values(get, "gears.youngs_modulus", "gears.poisson_ratio", "shafts.torsion_segments")
    if given is None:
        return None
    E, ν, segments = given
    G = E / (2 * (1 + ν))
    return 1 / sum(length / (G * pi * d**4 / 32) for length, d in segments)


def torsional_half(get: Get) -> float | None:
    """k_t [N·m/rad] of the half of a shaft: as stated, else of its segments."""
    stated = get("shafts.torsional_stiffness_half")
    return half_stiffness_of_segments(get) if stated is None else stated


def wheel_inertia(get: Get, wheel: str) -> float | None:
    """J [kg·m²] of `pinion` or `gear` with the thick part of its shaft."""
    given = _values(
        get, "gears.density", "gears.face_width", "gears.module", f"gears.{wheel}.teeth", "shafts.torsion_segments"
    )
    if given is None:
        return None
    ρ, W, m, z, segments = given
    thick = max(d for _, d in segments)
    length = 2 * sum(part for part, d in segments if d == thick)
    return ρ * pi / 2 * (W * (m * z / 2) ** 4 + length * (thick / 2) ** 4)


def wheel_mass(get: Get, wheel: str) -> float | None:
    """m [kg] of `pinion` or `gear` with its part of the shaft's mass."""
    shaft = {"pinion": "input", "gear": "output"}[wheel]
    given = _values(
        get,
        "gears.density",
        "gears.face_width",
        "gears.module",
        f"gears.{wheel}.teeth",
        "shafts.bearing_span",
        f"shafts.bending_diameter_{shaft}",
    )
    if given is None:
        return None
    ρ, W, m, z, L, d = given
    return ρ * pi * (W * (m * z / 2) ** 2 + BEAM_SHARE * L * (d / 2) ** 2)


def damping_time(get: Get) -> float | None:
    """τ [s] of the contacts, from the damping of the mesh."""
    given = _values(get, "mesh.damping", "mesh.mean_stiffness")
    return None if given is None else given[0] / given[1]


DERIVED: Mapping[str, Callable[[Get], float | None]] = {
    "shafts.bending_stiffness_input": lambda get: bending_stiffness(get, "input"),
    "shafts.bending_stiffness_output": lambda get: bending_stiffness(get, "output"),
    **{f"torsional_stiffness.{name}": torsional_half for name in SHAFT_HALVES},
    "inertias.J5": lambda get: wheel_inertia(get, "pinion"),
    "inertias.J10": lambda get: wheel_inertia(get, "gear"),
    "masses.m5": lambda get: wheel_mass(get, "pinion"),
    "masses.m10": lambda get: wheel_mass(get, "gear"),
    "mesh.relative_damping_time": damping_time,
    "mesh.stiffness_scale": lambda get: 1.0,  # the stiffness as the gears' dimensions or pair_stiffness give it
}
