"""Tooth contact in thin slices across the face: forces of drive and back flanks at one instant.

Every pair of teeth near the path is cut into slices that know nothing of each other:

    δ   = d + eccentric centres − missing material (both flanks) − corner gap + lead·z
    f   = (κ(s)/n)·δ·(δ/δ₀)^(1/9),     δ > 0         Hertz-like hardening (Palmgren's 10/9)
    F   = max(0, f + (κ(s)/n)·τ·step(δ/δc)·δ')       impact law with a step in the damping

κ(s)  stiffness of one pair over the whole face at the deflection δ₀ of the rated load  [N/m]
step  3u² − 2u³ from 0 to 1

Back flanks mirror the pair, unworn and exact, behind the backlash.
Source   Dąbrowski et al. (impact law with step damping); Palmgren (exponent of line contact)
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

DAMPING_DEPTH = 0.3e-6  # δc, penetration at which the damping is whole [m]
SIGN_WIDTH = 20e-6  # roll distance over which friction turns round at the pitch point [m]
HARDENING = 1.0 / 9.0


class Mesh(NamedTuple):
    """All that the contact needs of the pair at one time; arrays are read, never written."""

    base_radius: tuple[float, float]
    base_pitch: float
    start: float
    end: float
    first: float  # s of the first flank point
    spacing: float
    phase: float  # s of tooth 0 at pinion angle 0
    centre: float  # 1/sin α: shift of the contact for a change of the centre distance
    κ: np.ndarray  # (points,) [N/m]
    δ0: float
    τ: float
    gap_start: np.ndarray
    gap_end: np.ndarray
    gap_spacing: float
    pinion: np.ndarray  # missing material (z1, points, slices) [m]
    gear: np.ndarray  # missing material (z2, points, slices) [m]
    lead: np.ndarray  # approach of each slice by misalignment (slices,) [m]
    tooth_stiffness: np.ndarray  # relative stiffness of the pinion's teeth (z1,)
    gear_tooth_stiffness: np.ndarray  # and the gear's (z2,)
    friction: float
    backlash: float
    ρ1: float  # curvature radius at the pitch point, pinion
    ρ2: float  # and gear


@nb.njit(cache=True, inline="always")
def _lookup(table, x, spacing):
    """Linear interpolation of a table that starts at 0; held at its end."""
    u = x / spacing
    i = int(u)
    if i >= table.size - 1:
        return table[-1]
    return table[i] + (u - i) * (table[i + 1] - table[i])


@nb.njit(cache=True, inline="always")
def _slice_force(δ, rate, κ, δ0, τ):
    """Force of one slice [N]."""
    if δ <= 0.0:
        return 0.0
    f = κ * δ * (δ / δ0) ** HARDENING
    u = min(1.0, δ / DAMPING_DEPTH)
    f += κ * τ * u * u * (3.0 - 2.0 * u) * rate
    return max(0.0, f)


@nb.njit(cache=True)
def forces(mesh, angle, d, rate, away, out, slice_force):
    """Sums over all pairs at pinion angle [rad], approach d [m], its rate [m/s] and centre change away [m].

    out (4,): drive force F [N], friction Φ = Σ μF·sgn(s) [N], Σ ρ1·Φ, Σ ρ2·Φ [N·m].
    slice_force (pairs, slices): force of every slice of pair k, tooth number `newest − k` [N].
    Returns the newest tooth's number.
    """
    n = mesh.lead.size
    out[:] = 0.0
    shift = away * mesh.centre
    base = mesh.base_radius[0] * angle + mesh.phase
    points = mesh.κ.size
    newest = int(np.floor((base - mesh.first) / mesh.base_pitch))
    for k in range(slice_force.shape[0]):
        slice_force[k, :] = 0.0
        s1 = base - (newest - k) * mesh.base_pitch
        s2 = s1 - d - shift
        u1 = (s1 - mesh.first) / mesh.spacing
        u2 = (s2 - mesh.first) / mesh.spacing
        i1, i2 = int(u1), int(u2)
        if u1 < 0.0 or u2 < 0.0 or i1 >= points - 1 or i2 >= points - 1:
            continue
        δ_pair = d
        if s2 < mesh.start:
            δ_pair -= _lookup(mesh.gap_start, mesh.start - s2, mesh.gap_spacing)
        if s1 > mesh.end:
            δ_pair -= _lookup(mesh.gap_end, s1 - mesh.end, mesh.gap_spacing)
        w1, w2 = u1 - i1, u2 - i2
        j1 = (newest - k) % mesh.pinion.shape[0]
        j2 = (newest - k) % mesh.gear.shape[0]
        κ = (mesh.κ[i1] + w1 * (mesh.κ[i1 + 1] - mesh.κ[i1])) * mesh.tooth_stiffness[j1] / n
        κ *= mesh.gear_tooth_stiffness[j2]
        total = 0.0
        for m in range(n):
            worn = (1.0 - w1) * mesh.pinion[j1, i1, m] + w1 * mesh.pinion[j1, i1 + 1, m]
            worn += (1.0 - w2) * mesh.gear[j2, i2, m] + w2 * mesh.gear[j2, i2 + 1, m]
            f = _slice_force(δ_pair + mesh.lead[m] - worn, rate, κ, mesh.δ0, mesh.τ)
            slice_force[k, m] = f
            total += f
        out[0] += total
        if mesh.friction != 0.0:
            φ = mesh.friction * total * s1 / np.sqrt(s1 * s1 + SIGN_WIDTH * SIGN_WIDTH)
            out[1] += φ
            out[2] += (mesh.ρ1 + s1) * φ
            out[3] += (mesh.ρ2 - s2) * φ
    return newest


@nb.njit(cache=True)
def back_force(mesh, angle, d, rate):
    """Force of the back flanks [N] at their approach d [m], which the backlash still has to be taken from."""
    δ = d - mesh.backlash
    if δ <= 0.0:
        return 0.0
    base = mesh.base_radius[0] * angle + mesh.phase - 0.5 * mesh.base_pitch
    total = 0.0
    newest = int(np.floor((base + mesh.end) / mesh.base_pitch)) + 1
    for k in range(5):
        s = (newest - k) * mesh.base_pitch - base
        i = int((s - mesh.first) / mesh.spacing)
        if s < mesh.first or i >= mesh.κ.size:
            continue
        δ_pair = δ
        if s < mesh.start:
            δ_pair -= _lookup(mesh.gap_start, mesh.start - s, mesh.gap_spacing)
        if s > mesh.end:
            δ_pair -= _lookup(mesh.gap_end, s - mesh.end, mesh.gap_spacing)
        total += _slice_force(δ_pair, rate, mesh.κ[i], mesh.δ0, mesh.τ)
    return total


def static_approach(mesh: Mesh, angle: float, force: float) -> float:
    """The approach d [m] at which the drive flanks carry a force [N] at rest."""
    out, slices = np.zeros(4), work_space(mesh)
    low, high = -1e-3, 5e-3
    for _ in range(80):
        d = (low + high) / 2
        forces(mesh, angle, d, 0.0, 0.0, out, slices)
        low, high = (d, high) if out[0] < force else (low, d)
    return (low + high) / 2


def work_space(mesh: Mesh) -> np.ndarray:
    """Room for the slice forces of all pairs that can be near the path at once; (pairs, slices)."""
    return np.zeros((int(np.ceil(mesh.κ.size * mesh.spacing / mesh.base_pitch)), mesh.lead.size))
