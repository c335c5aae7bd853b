"""Roots of functions that rise, many at once.

    x ← x − f(x)/f'(x)      where that lies between the bounds known so far, else their middle

Source   W. H. Press et al., Numerical Recipes, 3rd ed., Cambridge (2007), section 9.4 (Newton's method with bisection)
Holds    for one root between the bounds; without one, the bound on its side is found
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

LEAST_STEP = 1e-13  # of halving
MOST_STEPS = 60  # by halves alone, from 16 to the least


def rising_roots(
    function: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
    low: np.ndarray | float,
    high: np.ndarray | float,
    last_step: float = 1e-7,
) -> np.ndarray:
    """Where functions are zero (n,), from a start (n,) between two bounds (n,) each.

    function   values and slopes (n,) at places (n,)
    last_step  of Newton's method: what is left after it is of the order of its square
    """
    x = start
    for _ in range(MOST_STEPS):
        value, slope = function(x)
        short = value < 0
        low, high = np.where(short, x, low), np.where(short, high, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = x - value / slope
        inside = (newton >= low) & (newton <= high)
        before, x = x, np.where(inside, newton, 0.5 * (low + high))
        if np.all(np.abs(x - before) <= np.where(inside, last_step, LEAST_STEP)):
            break
    return x
