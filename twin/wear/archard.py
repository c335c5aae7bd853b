"""Archard wear per passage of a tooth pair.

    dh = K·τ·F·v,        v = |s|·(ω1 + ω2)                     (both flanks lose dh)
    combined depth per pinion revolution = dh·(1 + z1/z2)

    τ = τ_ref·ω_ref/ω1                    K·τ = k/(W·v_r),    v_r = ω1·r1·sin α

K      wear coefficient of the paper's eq. 6, dh = K·F·v·dt            [1/N]
τ      dwell time of the contact on a flank point in one passage       [s]
F      normal force of the pair at s                                   [N]
v      sliding velocity                                                [m/s]
k      specific (dimensional Archard) wear rate, volume per work       [m²/N]
v_r    rolling velocity at the pitch point                             [m/s]

Eq. 6 alone depends on the time step of whoever integrates it; per passage it needs the dwell time, stated
with K. A contact of fixed width dwells the longer the slower the gears turn, so that a passage wears the same
depth at any speed. k depends neither on the dwell time nor on the speed.

The contact has a width, so what one passage wears off is F·|s| smoothed with the elliptic weight w of Hertz's
pressure, 2/(πa)·sqrt(1 − (u/a)²) over |u| ≤ a, twice: a force spreads over the contact, and the contact feels
the average of the profile under it. With the same weight both ways, as reciprocity asks, the loop from profile
to force to profile carries |w|² ≥ 0 at every wavelength. One pass alone has wavelengths of negative weight (the
Bessel function J1 changes sign), at which a corrugation feeds itself and grows.

Source   paper eq. 6; A. Flodin, S. Andersson, Wear 207 (1997) 16–23 (single-point observation of the flank);
         J. F. Archard, J. Appl. Phys. 24 (1953) 981–988
Holds    mild wear; forces that do not change from one passage to the next
Ignores  the change of the contact width with load
"""

from __future__ import annotations

from functools import lru_cache
from math import pi, sin

import numpy as np

from twin.compiled import averages
from twin.dynamics.mesh import ROWS, PairMesh
from twin.errors import ParameterError
from twin.geometry import GearPair
from twin.wear.profile import POINTS_PER_PITCH


def specific_wear_rate(pair: GearPair, K: float, dwell: float, pinion_speed_hz: float) -> float:
    """k [m²/N] of a wear coefficient K [1/N] stated with its dwell time [s] at a pinion speed [Hz].

    k = K·τ·W·v_r
    """
    rolling = 2 * pi * pinion_speed_hz * pair.pitch_radius[0] * sin(pair.pressure_angle)
    return K * dwell * pair.face_width * rolling


def pinion_share(pair: GearPair) -> float:
    """The pinion's part of the combined depth, 1/(1 + z1/z2)."""
    z1, z2 = pair.teeth
    return 1 / (1 + z1 / z2)


@lru_cache(maxsize=32)
def _elliptic_weights(half_width: float, spacing: float) -> np.ndarray:
    """Weights of the elliptic average on a grid, summing to 1 (2j + 1,).

    Each weight is the exact integral of the ellipse over its cell, so a width below the grid is the identity.
    """
    reach = int(np.ceil(half_width / spacing + 0.5))
    edges = np.clip((np.arange(-reach, reach + 2) - 0.5) * spacing / half_width, -1, 1)
    area = (edges * np.sqrt(1 - edges**2) + np.arcsin(edges)) / pi
    return np.diff(area)


def wear_per_revolution(mesh: PairMesh, contact_forces: np.ndarray, half_width: float, slices: int = 1) -> np.ndarray:
    """Combined depth lost per pinion revolution and unit K·τ·ω1, on the worn profile's grid; (m,) [N·m].

    With several slices across the face each wears by its own force per width: (slices, m).

        (1 + z1/z2)·(1 + z1/z2)·F·|s|     since v = |s|·ω1·(1 + z1/z2)

    contact_forces  of all contacts over one mesh period, drive flanks first, slice by slice (p, n); n a multiple
                    of the profile's points a pitch
    half_width      a of the elliptic contact [m]
    """
    if not half_width > 0:
        raise ParameterError(f"contact half-width = {half_width:g} m must be positive; micrometres?")
    n = mesh.samples
    stride, rest = divmod(n, POINTS_PER_PITCH)
    if rest:
        raise ParameterError(f"{n} samples a mesh period must be a multiple of {POINTS_PER_PITCH} profile points")
    half = n // 2  # samples from the pitch point on: the first half of the period, then the second of the one before
    force = contact_forces[: slices * len(ROWS)].reshape(slices, len(ROWS), n)
    along = np.concatenate((force[..., half:], force[..., :half]), axis=2).reshape(slices, -1)  # rows follow along s
    ratio = 1 + mesh.pair.teeth[0] / mesh.pair.teeth[1]
    weights = elliptic_twice(half_width, mesh.pair.base_pitch / n)
    worn = slices * ratio**2 * averages(along * mesh.sliding_arm, weights, stride)
    return worn[0] if slices == 1 else worn


@lru_cache(maxsize=32)
def elliptic_twice(half_width: float, spacing: float) -> np.ndarray:
    """Weights of the elliptic average of a contact [m], taken twice, on a grid of this spacing [m]; (4j + 1,)."""
    once = _elliptic_weights(half_width, spacing)
    return np.convolve(once, once)
