"""Load sharing of the pair, tooth by tooth along the path: what wears the flanks.

At every position the approach d is sought at which the slices carry the load:

    Σ F(d) − Σ ρ2·Φ(d)/rb2 = T/rb1·r(phase of the mesh)

r = 1, or the ratio of the turning machine's mesh force to its mean, with the present surfaces, the effects'
geometry and friction. Each position lies one flank point further, so that every pair deposits once on every
point it passes over.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from recordings.generator.contact import forces

STEP = 1e-9  # for the derivative of the load with the approach [m]
ITERATIONS = 150


@nb.njit(cache=True)
def _load(mesh, angle, d, away, out, slices):
    forces(mesh, angle, d, 0.0, away, out, slices)
    return out[0] - out[3] / mesh.base_radius[1]


@nb.njit(cache=True)
def balance(mesh, angle, guess, away, force, out, slices):
    """The approach [m] at which the drive flanks carry a force [N] at rest; NaN if none was found.

    Newton steps: the load is convex in the approach, so they come in from above.
    """
    d = guess
    for _ in range(ITERATIONS):
        load = _load(mesh, angle, d, away, out, slices)
        error = load - force
        if abs(error) <= 1e-6 * force:
            return d
        slope = (_load(mesh, angle, d + STEP, away, out, slices) - load) / STEP
        d -= max(-20e-6, min(20e-6, error / slope)) if slope > 1.0 else -20e-6
    return np.nan


@nb.njit(cache=True)
def sweep(mesh, start, positions, force, ratio, eccentricity, slices, worn1, worn2, passed1, passed2):
    """Adds slice force × distance from the pitch point [N·m] to worn1 (z1, points, slices) and worn2 (z2, …).

    passed1 (z1, points) and passed2 count how often each point was passed over. From pinion angle `start`
    [rad], one flank point a position. The load is force [N] times ratio (bins,), even steps of a mesh period.
    Returns at how many positions no balance was found.
    """
    out = np.zeros(4)
    points, n = mesh.κ.size, mesh.lead.size
    d, missed = 0.0, 0
    for position in range(positions):
        angle = start + position * mesh.spacing / mesh.base_radius[0]
        away = eccentricity[2] * np.cos(angle * mesh.base_radius[0] / mesh.base_radius[1] + eccentricity[3])
        away -= eccentricity[0] * np.cos(angle + eccentricity[1])
        base = mesh.base_radius[0] * angle + mesh.phase
        u = base / mesh.base_pitch
        load = force * ratio[int((u - np.floor(u)) * ratio.size) % ratio.size]
        found = balance(mesh, angle, d, away, load, out, slices)
        if np.isnan(found):
            missed += 1
            continue
        d = found
        newest = int(np.floor((base - mesh.first) / mesh.base_pitch))
        for p in range(slices.shape[0]):
            s1 = base - (newest - p) * mesh.base_pitch
            s2 = s1 - d - away * mesh.centre
            u1, u2 = (s1 - mesh.first) / mesh.spacing, (s2 - mesh.first) / mesh.spacing
            i1, i2 = int(u1), int(u2)
            if u1 < 0.0 or u2 < 0.0 or i1 >= points - 1 or i2 >= points - 1:
                continue
            w1, w2 = u1 - i1, u2 - i2
            j1, j2 = (newest - p) % worn1.shape[0], (newest - p) % worn2.shape[0]
            passed1[j1, i1] += 1.0 - w1
            passed1[j1, i1 + 1] += w1
            passed2[j2, i2] += 1.0 - w2
            passed2[j2, i2 + 1] += w2
            for m in range(n):
                touch = s1 - mesh.pinion[j1, i1, m]  # where on the line of action the worn flanks meet
                share = slices[p, m] * abs(touch)
                worn1[j1, i1, m] += (1.0 - w1) * share
                worn1[j1, i1 + 1, m] += w1 * share
                worn2[j2, i2, m] += (1.0 - w2) * share
                worn2[j2, i2 + 1, m] += w2 * share
    return missed
