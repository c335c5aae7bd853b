"""A table of pair stiffness that a rig file gives, checked before a model is built from it.

The check stands apart from `mesh/stiffness` so that whoever only reads rig files, as a starting service does with those
of all its machines, loads no more than numpy.
"""

from __future__ import annotations

import numpy as np

from twin.errors import ParameterError
from twin.geometry.gear_pair import GearPair

LEVELLING = 0.05  # length over which the stiffness levels off beyond the path of contact, over the base pitch
_KNOTS = 513


def knots(pair: GearPair) -> np.ndarray:
    """Path positions (513,) [m] of a spline of pair stiffness: the path of contact and a little beyond."""
    beyond = LEVELLING * pair.base_pitch
    return np.linspace(pair.path_start - beyond, pair.path_end + beyond, _KNOTS)


def not_a_knot(x, y, at: np.ndarray) -> np.ndarray:
    """The cubic spline through y (n,) at rising x (n,), n ≥ 4, at the places `at` (m,) → (m,); its end pieces go on.

    Solved for the second derivatives at the points, with the third derivative continuous at the second and at the last
    but one: C. de Boor, A Practical Guide to Splines, ch. IV.
    """
    x, y = np.asarray(x, float), np.asarray(y, float)
    n, h = x.size, np.diff(x)
    slope = np.diff(y) / h
    A, b = np.zeros((n, n)), np.zeros(n)
    inner = np.arange(1, n - 1)
    A[inner, inner - 1], A[inner, inner], A[inner, inner + 1] = h[:-1], 2 * (h[:-1] + h[1:]), h[1:]
    b[1:-1] = 6 * np.diff(slope)
    A[0, :3] = h[1], -(h[0] + h[1]), h[0]
    A[-1, -3:] = h[-1], -(h[-2] + h[-1]), h[-2]
    second = np.linalg.solve(A, b)

    i = np.clip(np.searchsorted(x, at) - 1, 0, n - 2)
    t, left, right = at - x[i], second[i], second[i + 1]
    first = slope[i] - h[i] * (2 * left + right) / 6
    return y[i] + t * (first + t * (left / 2 + t * (right - left) / (6 * h[i])))


def refuse_unless_positive(pair: GearPair, stiffness: np.ndarray) -> None:
    """Raises ParameterError where stiffness (513,) [N/m] at the knots of a pair is not positive throughout."""
    if not stiffness.min() > 0:
        raise ParameterError(
            f"the given pair stiffness falls to {stiffness.min():g} N/m at s = {knots(pair)[stiffness.argmin()]:g} m, "
            "between or beyond its points; it must stay positive: scattered values, or too few points?"
        )
