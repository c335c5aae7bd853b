"""Roots of functions that rise, many at once.

    x ← x − f(x)/f'(x)      where that lies between the bounds known so far, else their middle

Source   W. H. Press et al., Numerical Recipes, 3rd ed., Cambridge (2007), section 9.4 (Newton's method with bisection)
Holds    for one root between the bounds; without one, the bound on its side is found
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

ACCURACY = 1e-13  # of a step, absolute or relative
MOST_STEPS = 60  # by halves alone, from 16 to the accuracy


def rising_roots(
    function: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
    low: np.ndarray | float,
    high: np.ndarray | float,
) -> np.ndarray:
    """Where functions are zero (n,), from a start (n,) between two bounds (n,) each.

    function  values and slopes (n,) at places (n,)
    """
    x = start
    for _ in range(MOST_STEPS):
        value, slope = function(x)
        short = value < 0
        low, high = np.where(short, x, low), np.where(short, high, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = x - value / slope
        before, x = x, np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        if np.all(np.abs(x - before) <= ACCURACY * np.maximum(1.0, np.abs(x))):
            break
    return x
