"""Compliance of one tooth under a normal force on its flank: bending, shear, axial compression.

The tooth is a short cantilever of changing section, rooted where its fillet meets the root circle. A
force F along the flank's normal stores the energy of a bending moment, a shear force and a thrust:

    1/k_b = ∫ (cos β·(y_c − y) − x_c·sin β)² / (E·I) dy        I = 2/3·x³·W
    1/k_s = ∫ 1.2·cos²β / (G·A) dy                              A = 2·x·W,  G = E/(2·(1 + ν))
    1/k_a = ∫ sin²β / (E·A) dy

β         angle of the force from the tooth's cross direction, tan α_c − θ_b   [rad]
x_c, y_c  the point of contact on the tooth's axes (see geometry/tooth_form)   [m]
W         face width                                                           [m]

Source   D. C. H. Yang, J. Y. Lin, J. Mech. Trans. Autom. 109 (1987) 189-196 (bending, axial);
         X. Tian, University of Alberta (2004) (shear); H. Ma et al., Eng. Fail. Anal. 44 (2014) 179-194
         (the same energies with the true fillet as the tooth's root)
Holds    spur teeth, plane stress, loads that leave the profile's shape as it is
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from twin.geometry.tooth_form import ToothForm

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(40)
_SHEAR_FACTOR = 1.2  # rectangular section


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToothCompliance:
    """Compliances of one tooth in the direction of the force; each (n,) [m/N]."""

    bending: np.ndarray
    shear: np.ndarray
    axial: np.ndarray

    @property
    def total(self) -> np.ndarray:
        return self.bending + self.shear + self.axial


def _sections(tooth: ToothForm, τ: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half-thickness x, height y and weight dy of the sections between root and contact, each (n, 80) [m]."""
    τ_form, γ_form = tooth.form_point
    down = (γ_form - pi / 2) / 2
    γ = pi / 2 + down * (_NODES + 1)
    x_fillet, y_fillet = tooth.fillet_point(γ)
    dy_fillet = down * _WEIGHTS * tooth.fillet_slope(γ)

    half = (τ - τ_form)[:, None] / 2
    along = τ_form + half * (_NODES + 1)
    x_flank, y_flank = tooth.flank_point(along)
    dy_flank = half * _WEIGHTS * tooth.flank_slope(along)

    both = ((x_fillet, x_flank), (y_fillet, y_flank), (dy_fillet, dy_flank))
    x, y, dy = (np.hstack([np.broadcast_to(f, i.shape), i]) for f, i in both)
    return x, y, dy


def tooth_compliance(tooth: ToothForm, contact_roll_angle, *, youngs_modulus, poisson_ratio, face_width):
    """ToothCompliance for contact at each roll angle ξ = ρ/r_b [rad] of the flank; (n,) → (n,) each."""
    ξ = np.atleast_1d(np.asarray(contact_roll_angle, float))
    E, W = youngs_modulus, face_width
    G = E / (2 * (1 + poisson_ratio))
    β = ξ - tooth.base_half_angle
    x_c, y_c = (v[:, None] for v in tooth.flank_point(β))
    x, y, dy = _sections(tooth, β)
    A, inertia = 2 * x * W, 2 / 3 * x**3 * W
    c, s = np.cos(β)[:, None], np.sin(β)[:, None]
    return ToothCompliance(
        bending=np.sum((c * (y_c - y) - x_c * s) ** 2 / (E * inertia) * dy, axis=1),
        shear=np.sum(_SHEAR_FACTOR * c**2 / (G * A) * dy, axis=1),
        axial=np.sum(s**2 / (E * A) * dy, axis=1),
    )
