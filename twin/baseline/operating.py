"""Operating points of a machine without a model: the axes that distinguish them, and interpolation between them.

    u = torque                   where it is measured and varies
      = (torque, speed)          where the speed varies, too, by more than the torque explains
      = speed                    else (an induction motor's slip tells its load)

On one axis a point lies between two neighbours, in the plane within a triangle of the Delaunay triangulation, axes
over their ranges; its weights are linear, 1 at a learned point. Outside, the nearest learned point is used alone.

What the lines at a point miss of those so interpolated grows with the distance of what they come from:

    V = 2·Σ_i w_i·|u − u_i|^p − Σ_ij w_i·w_j·|u_i − u_j|^p         times a variance of its own for every line

p   how evenly lines go with the operating point: 1 for a random walk, 2 for straight lines

Source   variance of a linear estimate under a power variogram: G. Matheron, Economic Geology 58 (1963) 1246–1266;
         linear interpolation on a Delaunay triangulation: M. de Berg et al., Computational Geometry, 3rd ed., ch. 9
Holds    lines that change evenly between the points learned; what they miss of one another is the scatter
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, QhullError

from twin.baseline.reading import WindowReading
from twin.errors import NotAvailable
from twin.thresholds import deciding

WIDTH_OF_POINT = 0.01  # of the mean, that takes the place of the range there: half of a usual motor's slip
SMOOTHNESS = 1.5  # p: between a random walk and a straight line


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatingThresholds:
    """When torque and speed distinguish operating points, and where the learned range ends."""

    torque_varies: float = deciding(
        0.03, of="mean torque", meaning="range of torque from which it is an axis",
        source="not derived: above the wander of a drive held at constant load",
    )  # fmt: skip
    speed_varies: float = deciding(
        0.05, of="mean speed", meaning="range of speed that torque does not explain, from which speed is an axis",
        source="not derived: an induction motor's slip stays below it",
    )  # fmt: skip
    least_readings_of_plane: int = deciding(
        4, meaning="windows from which a plane of torque and speed is spanned",
        source="derivation: three points span a triangle, the fourth can lie inside",
    )  # fmt: skip
    one_point: float = deciding(
        0.002, of="mean", meaning="range up to which recordings lie at one operating point",
        source="not derived: a tenth of the usual slip of an induction motor at full load",
    )  # fmt: skip
    beyond: float = deciding(
        0.05, of="learned range", meaning="distance from the nearest learned point from which a point is outside",
        source="not derived",
    )  # fmt: skip
    far: float = deciding(
        0.15, of="learned range", meaning="distance beyond the learned points from which small effects are not judged",
        source="not derived: chosen with the outermost loads of the broken-tooth set in view, 0.09 and 0.20 beyond",
    )  # fmt: skip


DEFAULT = OperatingThresholds()

UNITS = {"torque_nm": "N·m", "speed_hz": "Hz"}


def axes_of(readings: Sequence[WindowReading], limits: OperatingThresholds = DEFAULT) -> tuple[str, ...]:
    """Names of the quantities that distinguish the operating points of these readings."""
    torques = [r.torque_nm for r in readings]
    if any(t is None for t in torques):
        return ("speed_hz",)
    torque = np.array(torques, dtype=float)
    if np.ptp(torque) <= limits.torque_varies * abs(torque.mean()):
        return ("speed_hz",)
    speed = np.array([r.speed_hz for r in readings])
    if len(readings) >= limits.least_readings_of_plane:
        rest = speed - np.polyval(np.polyfit(torque, speed, 1), torque)
        if np.ptp(rest) > limits.speed_varies * speed.mean():
            return ("torque_nm", "speed_hz")
    return ("torque_nm",)


def point_of(reading: WindowReading, axes: Sequence[str]) -> np.ndarray:
    """A reading's place on the axes (d,); NotAvailable where it lacks one."""
    if "torque_nm" in axes and reading.torque_nm is None:
        raise NotAvailable("the window has no torque, by which the baseline was learned")
    return np.array([float(getattr(reading, axis)) for axis in axes])


def order_of(points: np.ndarray) -> list[tuple[int, int | None]]:
    """All points (n, d) from the middle one outwards, each with its nearest neighbour that came before."""
    place = _scaled(points, points)
    first = int(np.argmin(np.abs(place - np.median(place, axis=0)).sum(axis=1)))
    out: list[tuple[int, int | None]] = [(first, None)]
    left = [i for i in range(len(points)) if i != first]
    while left:
        done = [i for i, _ in out]
        distance = np.linalg.norm(place[left][:, None] - place[done][None], axis=2)
        i, j = np.unravel_index(int(np.argmin(distance)), distance.shape)
        out.append((left.pop(int(i)), done[int(j)]))
    return out


def weights_of(
    points: np.ndarray, at: np.ndarray, limits: OperatingThresholds = DEFAULT
) -> tuple[dict[int, float], bool]:
    """Weights of the points learned (n, d) for a point (d,), and whether it lies among them."""
    place, u = _scaled(points, points), _scaled(points, at[None])[0]
    found = _along(place[:, 0], float(u[0])) if place.shape[1] == 1 else _within(place, u)
    if found is not None:
        return found, True
    distance = np.linalg.norm(place - u, axis=1)
    near = int(np.argmin(distance))
    return {near: 1.0}, bool(distance[near] <= limits.beyond)


def miss_of(points: np.ndarray, at: np.ndarray, weights: Mapping[int, float]) -> float:
    """V of a point (d,) that has these weights of the points learned (n, d), distances over their range."""
    used = np.array(sorted(weights))
    w = np.array([weights[i] for i in used.tolist()])
    place, u = _scaled(points, points)[used], _scaled(points, at[None])[0]
    to = np.linalg.norm(place - u, axis=1) ** SMOOTHNESS
    among = np.linalg.norm(place[:, None] - place[None], axis=2) ** SMOOTHNESS
    return float(max(2 * w @ to - w @ among @ w, 0.0))


def distance_beyond(points: np.ndarray, at: np.ndarray) -> float:
    """Distance of a point (d,) from the nearest of those learned (n, d), of their range; 0 among them."""
    if weights_of(points, at)[1]:
        return 0.0
    return float(np.linalg.norm(_scaled(points, points) - _scaled(points, at[None])[0], axis=1).min())


def _scaled(points: np.ndarray, values: np.ndarray) -> np.ndarray:
    low, width = points.min(axis=0), np.ptp(points, axis=0)
    wide = WIDTH_OF_POINT * np.abs(points).mean(axis=0)  # recordings at one point: their wander is no range
    return (values - low) / np.maximum(np.where(varies(points), width, wide), 1e-300)


def varies(points: np.ndarray) -> np.ndarray:
    """Whether points (n, d) differ on each axis by more than they wander about one operating point (d,)."""
    return np.asarray(np.ptp(points, axis=0) > DEFAULT.one_point * np.abs(points).mean(axis=0))


def _along(place: np.ndarray, u: float) -> dict[int, float] | None:
    order = np.argsort(place, kind="stable")
    rising = place[order]
    if not rising[0] < u < rising[-1]:
        return None
    high = int(np.searchsorted(rising, u, side="right"))
    a, b = rising[high - 1], rising[high]
    t = float((u - a) / (b - a))
    return {int(order[high - 1]): 1 - t, int(order[high]): t}


def _within(place: np.ndarray, u: np.ndarray) -> dict[int, float] | None:
    try:
        mesh = Delaunay(place)
    except QhullError:  # all on one line
        return None
    simplex = int(mesh.find_simplex(u))
    if simplex < 0:
        return None
    A = mesh.transform[simplex]
    part = A[:2] @ (u - A[2])
    weights = np.append(part, 1 - part.sum())
    return {int(i): float(w) for i, w in zip(mesh.simplices[simplex], weights, strict=True) if w > 0}
