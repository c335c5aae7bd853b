"""Whether the wear rate has changed by a large factor since some window.

    z(N) = a + r₁·N + (r₂ − r₁)·max(N − N_c, 0) + v

z       work of the depths that the windows gave     [rad/N]
N       revolutions of the pinion
r₁, r₂  wear rates before and after N_c              [rad/N per revolution]
N_c     revolutions of the change, at one of the windows
v       scatter from window to window, independent

Every window with enough others on either side is tried as N_c, by weighted least squares; the one that leaves least
counts. The factor r₂/r₁ lies beyond f where r₂ − f·r₁ exceeds its standard deviation by more than the limit.

Holds    a depth that is transformed to work: at a constant wear coefficient that is linear in revolutions
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.assessment import RateChange
from twin.thresholds import deciding
from twin.updating.wear_points import Points


@dataclass(frozen=True, slots=True, kw_only=True)
class RateChangeLimits:
    """When a wear rate has changed."""

    factor: float = deciding(
        3.0,
        of="the wear rate before",
        meaning="change of the wear rate, up or down, from which it is said",
        source="not derived: running-in halves the rate; a factor of three is a change of the wear itself",
    )
    certain: float = deciding(
        3.0,
        unit="standard deviations",
        meaning="by how much the change must exceed that factor",
        source="convention: three standard deviations, because every window is tried",
    )
    before: int = deciding(
        3, unit="windows", meaning="windows up to the change", source="derivation: two give a rate, the third tests it"
    )
    after: int = deciding(
        2, unit="windows", meaning="windows after the change", source="derivation: two give a rate with the change's"
    )


LIMITS = RateChangeLimits()


def rate_change(points: Points, limits: RateChangeLimits = LIMITS) -> RateChange | None:
    """The change of the wear rate that is surely larger than the limit; None where none is."""
    if len(points) < limits.before + limits.after:
        return None
    N, z, own = (np.array([getattr(p, name) for p in points]) for name in ("revolutions", "work", "own_std"))
    if not (own > 0).all() or not N[-1] > N[0]:
        return None
    fitted = _fit(N, z, own, N[limits.before - 1 : len(points) - limits.after])
    if fitted is None:
        return None
    misfit, at, rates, covariance = fitted
    covariance = covariance * max(1.0, misfit / max(len(points) - 4, 1))
    before, after = rates
    for weights in np.array([(-limits.factor, 1.0), (1.0, -limits.factor)]):  # risen, fallen
        excess = float(np.dot(weights, rates))
        if before > 0 and excess > limits.certain * float(np.sqrt(weights @ covariance @ weights)):
            factor = max(after, 0.0) / before
            return RateChange(factor=factor, revolutions=at, windows=int((at < N).sum()))
    return None


def _fit(
    N: np.ndarray, z: np.ndarray, own: np.ndarray, places: np.ndarray
) -> tuple[float, float, np.ndarray, np.ndarray] | None:
    """Misfit (chi-square), revolutions, both rates (2,) and their covariance (2, 2) of a change at the best place."""
    scale = N[-1] - N[0]
    bent = np.maximum(N - places[:, None], 0.0) / scale
    straight = np.broadcast_to(1 / own, bent.shape)
    design = np.stack([straight, ((N - N[0]) / scale - bent) / own, bent / own], axis=2)
    normal = design.transpose(0, 2, 1) @ design
    told = np.linalg.cond(normal) <= 1e12
    if not told.any():
        return None
    places, design, covariance = places[told], design[told], np.linalg.inv(normal[told])
    values = covariance @ (design.transpose(0, 2, 1) @ (z / own)[:, None])
    misfits = ((z / own - (design @ values)[:, :, 0]) ** 2).sum(axis=1)
    i = int(misfits.argmin())
    return float(misfits[i]), float(places[i]), values[i, 1:, 0] / scale, covariance[i, 1:, 1:] / scale**2
