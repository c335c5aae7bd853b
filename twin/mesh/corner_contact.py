"""Contact beyond the ends of the path: the tip corner of one gear against the flank of the other.

A loaded mesh is deflected, so the next tooth meets its mate early and leaves it late, outside the
nominal path. There the profiles are apart by

    gap = r_bA·(φ_A(R) − φ_T)            (zero inside the path)
    φ_A(R) = α − tan α_A + inv α_R,  tan α_A = tan α + σ/r_bA,  cos α_R = r_bA/R
    tip of B:  R·(cos φ_T, sin φ_T) = (a − r_aB·cos ψ, −r_aB·sin ψ),  ψ = α + inv α_aB − (tan α − σ/r_bB)

A    the gear whose flank is touched: the pinion before the path's start, the gear after its end
σ    path position counted in A's own recess: s for the pinion, −s for the gear   [m]
R    distance of B's tip corner from A's centre                                   [m]
φ    angles about A's centre, ψ about B's, from the line of centres               [rad]
a    centre distance                                                              [m]

Turning an involute by dφ moves it by r_b·dφ along all its normals, so this gap is at once the
distance between corner and flank and the part of d (the deflection along the line of action) that
is used up before they touch. It grows from zero with zero slope.

With undercut teeth the flank's foot, where the fillet cuts it off, is the corner; the same equations
hold with its radius for r_aB and the gears exchanged.

Source   ISO 21771-1:2024, clause 4 (involute); the kinematics follow from it without approximation
Holds    tip corners without rounding or relief
"""

from __future__ import annotations

import numpy as np

from twin.geometry.gear_pair import GearPair
from twin.geometry.involute import involute, pressure_angle_at


def corner_gap(pair: GearPair, s):
    """Separation of the profiles [m] at path positions s [m], 0 inside the path; any shape → the same."""
    s = np.asarray(s, float)
    gap = np.zeros(s.shape)
    for side, outside in ((0, s < pair.path_start), (1, s > pair.path_end)):
        flank, corner_radius = _corner(pair, side)
        σ = s[outside] if flank == 0 else -s[outside]
        gap[outside] = np.maximum(_separation(pair, flank, corner_radius, σ), 0.0)
    return gap


def _corner(pair: GearPair, side: int) -> tuple[int, float]:
    """The gear whose flank is touched beyond the path's start (0) or end (1), and the corner's radius [m]."""
    s = (pair.path_start, pair.path_end)[side]
    radius = [
        float(np.hypot(r_b, ρ)) for r_b, ρ in zip(pair.base_radius, pair.curvature_radius(s), strict=True)
    ]
    if radius[1 - side] > pair.tip_radius[1 - side] * (1 - 1e-12):
        return side, pair.tip_radius[1 - side]
    return 1 - side, radius[side]  # undercut: the foot of the flank is the corner that leaves last


def _separation(pair: GearPair, flank: int, corner_radius: float, σ: np.ndarray) -> np.ndarray:
    """Distance [m] of the mating gear's corner from the flank of gear `flank` (0 or 1); (n,) → (n,)."""
    α, a, r_aB = pair.pressure_angle, pair.centre_distance, corner_radius
    r_bA, r_bB = pair.base_radius[flank], pair.base_radius[1 - flank]
    ψ = α + involute(pressure_angle_at(r_aB, r_bB)) - (np.tan(α) - σ / r_bB)
    x, y = a - r_aB * np.cos(ψ), -r_aB * np.sin(ψ)
    R, φ_T = np.hypot(x, y), np.arctan2(y, x)
    φ_A = α - (np.tan(α) + σ / r_bA) + involute(pressure_angle_at(R, r_bA))
    return r_bA * (φ_A - φ_T)
