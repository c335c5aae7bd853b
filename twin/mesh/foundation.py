"""Compliance of the gear's body under a tooth (fillet foundation): an elastic ring on a rigid bore.

    1/k_f = cos²β/(E·W)·(L·(u/S)² + M·(u/S) + P·(1 + Q·tan²β))
    L, M, P, Q = A/θ² + B·h² + C·h/θ + D/θ + E·h + F,  with one row of A … F each

β  angle of the force from the tooth's cross direction                                  [rad]
u  height above the root circle at which the force's line cuts the tooth's centre line  [m]
S  tooth thickness at its root, 2·r_f·θ                                                 [m]
θ  half the angle of the tooth at its root                                              [rad]
h  root radius over bore radius

What is the tooth's root? Two readings are in use, and the body's give depends on it strongly:

    "flank"   the flank continued to the root as a radial line: θ at the base circle, or at the root
              circle where that is larger. Keeps small pinions inside the formula's range.
    "fillet"  where the fillet runs into the root circle: the widest section.

For 19 teeth that is θ = 0.098 against 0.159 rad. The formula was fitted for θ up to 0.12: "flank" is
the reading inside it, and the one used by default.

Source   P. Sainsot, P. Velex, O. Duverger, J. Mech. Des. 126 (2004) 748-752, eq. (16) and Table 1
Holds    0.01 ≤ θ ≤ 0.12, 1.4 ≤ h ≤ 7; solid bodies
Ignores  that two teeth in contact at once lean on the same body
"""

from __future__ import annotations

import numpy as np

from twin.errors import ParameterError
from twin.geometry.involute import involute, pressure_angle_at
from twin.geometry.tooth_form import ToothForm

_COEFFICIENTS = np.array(
    [
        [-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045],  # L
        [60.111e-5, 28.100e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086],  # M
        [-50.952e-5, 185.50e-3, 0.0538e-4, 53.300e-3, 0.2895, 0.9236],  # P
        [-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904],  # Q
    ]
)
ROOT_SECTIONS = ("flank", "fillet")
DEFAULT_ROOT_SECTION = "flank"


def root_half_angle(tooth: ToothForm, root_section: str = DEFAULT_ROOT_SECTION) -> float:
    """θ [rad] by either reading of the tooth's root."""
    if root_section not in ROOT_SECTIONS:
        raise ParameterError(f"root_section = {root_section!r} must be one of {', '.join(ROOT_SECTIONS)}")
    if root_section == "fillet":
        return tooth.root_half_angle
    return tooth.base_half_angle - float(involute(pressure_angle_at(tooth.root_radius, tooth.base_radius)))


def foundation_compliance(
    tooth: ToothForm,
    contact_roll_angle,
    *,
    bore_radius: float,
    youngs_modulus: float,
    face_width: float,
    root_section: str = DEFAULT_ROOT_SECTION,
) -> np.ndarray:
    """1/k_f [m/N] for contact at each roll angle ξ = ρ/r_b [rad] of the flank; (n,) → (n,)."""
    if not 0 < bore_radius < tooth.root_radius:
        raise ParameterError(f"bore_radius = {bore_radius:g} m is outside (0, {tooth.root_radius:g}) m; a diameter?")
    β = np.atleast_1d(np.asarray(contact_roll_angle, float)) - tooth.base_half_angle
    x, y = tooth.flank_point(β)
    body = body_factor(
        β,
        y - x * np.tan(β) - tooth.root_radius,
        half_angle=root_half_angle(tooth, root_section),
        root_radius=tooth.root_radius,
        bore_radius=bore_radius,
    )
    return body / (youngs_modulus * face_width)


def body_factor(β, u, *, half_angle: float, root_radius: float, bore_radius: float) -> np.ndarray:
    """E·W/k_f, without dimension, of a force at angles β [rad] and heights u [m]; (n,), (n,) → (n,)."""
    θ, h, S = half_angle, root_radius / bore_radius, 2 * root_radius * half_angle
    L, M, P, Q = _COEFFICIENTS @ np.array([1 / θ**2, h**2, h / θ, 1 / θ, h, 1.0])
    return np.cos(β) ** 2 * (L * (u / S) ** 2 + M * (u / S) + P * (1 + Q * np.tan(β) ** 2))
