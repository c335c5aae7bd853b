"""Generalised minimal residuals, for real-linear operators on complex vectors.

A line spectrum is a vector over the reals: multiplying a signal in time takes its lines to combinations of lines and
of their conjugates. So the inner product is Re⟨a, b⟩ and all coefficients are real.

Source   Y. Saad, M. H. Schultz, SIAM J. Sci. Stat. Comput. 7 (1986) 856–869; Givens rotations as in C. T. Kelley,
         Iterative Methods for Linear and Nonlinear Equations, SIAM 1995, ch. 3.5
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

import numpy as np
from scipy.linalg import solve_triangular


def gmres(
    apply: Callable[[np.ndarray], np.ndarray], right: np.ndarray, tolerance: float, *, longest: int = 120
) -> np.ndarray:
    """u (n,) with |A·u − right| ≤ tolerance·|right|, or as near as `longest` steps come; from u = 0.

    apply  u → A·u, linear over the reals; (n,) complex → (n,) complex
    """
    n = right.size
    size = float(np.linalg.norm(right))
    if size == 0:
        return np.zeros_like(right)
    basis = np.empty((longest + 1, 2 * n))  # each complex vector as 2n reals
    basis[0] = right.view(float) / size
    R = np.zeros((longest, longest))
    rotations: list[tuple[float, float]] = []
    remaining = [size]
    for j in range(longest):
        w = apply(basis[j].view(complex)).view(float)
        known = basis[: j + 1]
        h = known @ w
        w = w - h @ known
        again = known @ w  # once more: one pass loses orthogonality
        w -= again @ known
        column = (h + again).tolist()
        length = float(np.linalg.norm(w))
        for i, (c, s) in enumerate(rotations):
            column[i], column[i + 1] = c * column[i] + s * column[i + 1], c * column[i + 1] - s * column[i]
        diagonal = hypot(column[j], length)
        if diagonal == 0:  # the operator is singular in this direction: nothing more to gain
            break
        c, s = column[j] / diagonal, length / diagonal
        rotations.append((c, s))
        column[j] = diagonal
        R[: j + 1, j] = column
        remaining.append(-s * remaining[j])
        remaining[j] *= c
        if abs(remaining[j + 1]) <= tolerance * size or length == 0:
            break
        basis[j + 1] = w / length
    m = len(rotations)
    y = solve_triangular(R[:m, :m], remaining[:m])
    return (y @ basis[:m]).view(complex)
