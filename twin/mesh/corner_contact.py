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

Where undercut ends the path, the foot of the flank is the corner that leaves last: the same equations
with its radius for r_aB and the gears exchanged, as far as the mate's flank reaches.

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
    for flank, σ, outside in ((0, s, s < pair.path_start), (1, -s, s > pair.path_end)):
        foot_radius = _foot_radius(pair, flank)
        if foot_radius is None:
            gap[outside] = _separation(pair, flank, pair.tip_radius[1 - flank], σ[outside])
        else:
            gap[outside] = _undercut_separation(pair, flank, foot_radius, σ[outside])
    return np.maximum(gap, 0.0)


def _foot_radius(pair: GearPair, flank: int) -> float | None:
    """Radius [m] of the flank's foot where undercut ends the path there, None where the mating tip does."""
    ρ = pair.curvature_radius((pair.path_start, pair.path_end)[flank])
    mate_radius = np.hypot(pair.base_radius[1 - flank], ρ[1 - flank])
    if mate_radius > pair.tip_radius[1 - flank] * (1 - 1e-12):
        return None
    return float(np.hypot(pair.base_radius[flank], ρ[flank]))


def _undercut_separation(pair: GearPair, flank: int, foot_radius: float, σ: np.ndarray) -> np.ndarray:
    """Distance [m] from the mate of the foot of gear `flank`, further out of the mate's tip; (n,) → (n,)."""
    α, a, mate_tip = pair.pressure_angle, pair.centre_distance, pair.tip_radius[1 - flank]
    r_b = pair.base_radius[flank]
    ψ_last = np.arccos((a**2 + foot_radius**2 - mate_tip**2) / (2 * a * foot_radius))
    last = r_b * (np.tan(α) + ψ_last - α - involute(pressure_angle_at(foot_radius, r_b)))
    foot = _separation(pair, 1 - flank, foot_radius, np.minimum(-σ, last))
    tip = _separation(pair, flank, mate_tip, σ)
    return np.where(-σ <= last, foot, np.maximum(foot, tip))


def _separation(pair: GearPair, flank: int, corner_radius: float, σ: np.ndarray) -> np.ndarray:
    """Distance [m] of the mating gear's corner from the flank of gear `flank` (0 or 1); (n,) → (n,)."""
    α, a, r_aB = pair.pressure_angle, pair.centre_distance, corner_radius
    r_bA, r_bB = pair.base_radius[flank], pair.base_radius[1 - flank]
    ψ = α + involute(pressure_angle_at(r_aB, r_bB)) - (np.tan(α) - σ / r_bB)
    x, y = a - r_aB * np.cos(ψ), -r_aB * np.sin(ψ)
    R, φ_T = np.hypot(x, y), np.arctan2(y, x)
    φ_A = α - (np.tan(α) + σ / r_bA) + involute(pressure_angle_at(R, r_bA))
    return r_bA * (φ_A - φ_T)
