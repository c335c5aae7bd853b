"""Loaded mesh without inertia: how the pairs in contact share the force through their gaps.

    Σ_i F_i = F,   F_i = k_i·max(0, d + e_i),   e_i = −gap_i

d      deflection along the line of action, positive when the teeth press together: the static
       transmission error, by which the pinion runs ahead                                          [m]
gap_i  separation of pair i before the load: wear of both flanks + corner gap + other errors [m]
k_i    stiffness of pair i                                                                      [N/m]

The left side rises with d and is straight between the gaps: with the gaps in rising order, the first
j pairs touch and d = (F + Σ k·gap)/Σ k over them. No iteration.

Source   R. G. Munro, Ph.D. thesis, Cambridge (1962); used in every loaded tooth contact analysis since
Holds    forces that follow the deflection at once
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.errors import ParameterError
from twin.geometry.gear_pair import GearPair
from twin.mesh.stiffness import PairStiffness


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StaticMesh:
    """The loaded mesh at n positions with p pairs."""

    deflection: np.ndarray  # d (n,) [m], the static transmission error
    pair_forces: np.ndarray  # F_i (p, n) [N]
    mesh_stiffness: np.ndarray  # dF/dd, the pairs in contact together (n,) [N/m]

    @property
    def load_sharing(self) -> np.ndarray:
        """Each pair's part of the force, (p, n); the parts of a loaded mesh sum to 1."""
        total = self.pair_forces.sum(axis=0)
        return self.pair_forces / np.where(total > 0, total, 1.0)


def mesh_period(pair: GearPair, n: int) -> np.ndarray:
    """n path positions [m] of the entering pair, evenly over one base pitch from the path's start; (n,)."""
    return pair.path_start + pair.base_pitch * np.arange(n) / n


def pair_positions(pair: GearPair, s) -> np.ndarray:
    """Positions of all pairs that can touch when one is at s [m]; (n,) → (p, n).

    Row i is s + (i − 1)·p_b: the pair that comes next, the one at s, and those ahead of it. For s in
    `mesh_period` they cover the path of contact and the corner contact on either side of it.
    """
    rows = np.arange(-1, int(np.ceil(pair.contact_ratio)) + 1)
    return np.asarray(s, float) + pair.base_pitch * rows[:, None]


def nominal_mesh_stiffness(stiffness: PairStiffness, n: int) -> np.ndarray:
    """Stiffness of all pairs inside the nominal path over one mesh period, without wear and load; (n,) [N/m].

    It steps where a pair enters or leaves; corner contact makes these steps gradual under load.
    """
    pair = stiffness.pair
    s = pair_positions(pair, mesh_period(pair, n))
    inside = (s >= pair.path_start) & (s <= pair.path_end)
    return np.sum(np.where(inside, stiffness(s), 0.0), axis=0)


def static_deflection(k_pairs, gaps, force) -> np.ndarray:
    """d [m] that balances a force ≥ 0, one or (n,) [N]; stiffnesses (p, n) [N/m], gaps (p, n) [m] → (n,)."""
    k, gap = np.atleast_2d(k_pairs).astype(float), np.atleast_2d(gaps).astype(float)
    F = np.broadcast_to(np.asarray(force, float), k.shape[1:])
    if not np.all(F >= 0):
        raise ParameterError(
            f"force = {F.min():g} N must not be negative: the drive flank only pushes; a torque of the "
            "other sign acts on the back flank"
        )
    if not np.all(k > 0):
        raise ParameterError(f"pair stiffness = {k.min():g} N/m must be positive")
    order = np.argsort(gap, axis=0)
    k, gap = np.take_along_axis(k, order, 0), np.take_along_axis(gap, order, 0)
    nearest = gap[:1]
    lag = gap - nearest  # measured from the nearest pair: no cancellation when all are far apart
    k_sum, moment = np.cumsum(k, axis=0), np.cumsum(k * lag, axis=0)
    force_to_reach = k_sum * lag - moment  # the force that just closes each gap
    touching = np.maximum(np.sum(force_to_reach < F, axis=0), 1)[None, :] - 1
    k_j, moment_j = (np.take_along_axis(v, touching, 0)[0] for v in (k_sum, moment))
    return nearest[0] + (F + moment_j) / k_j


def static_mesh(k_pairs, gaps, force) -> StaticMesh:
    """The loaded mesh; stiffnesses (p, n) [N/m], gaps (p, n) [m], force ≥ 0 or (n,) [N]."""
    k, gap = np.atleast_2d(k_pairs).astype(float), np.atleast_2d(gaps).astype(float)
    d = static_deflection(k, gap, force)
    pressed = d - gap
    return StaticMesh(
        deflection=d,
        pair_forces=k * np.maximum(pressed, 0.0),
        mesh_stiffness=np.sum(np.where(pressed > 0, k, 0.0), axis=0),
    )
