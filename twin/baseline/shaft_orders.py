"""The lines that one shaft alone makes."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

LINES = 12  # of a shaft that are compared, from its first


def own_multiples(shaft: Fraction, shafts: Sequence[Fraction], highest: float, most: int = LINES) -> np.ndarray:
    """n of a shaft's lines n·s that no other shaft makes by itself, the lowest first."""
    n = np.arange(1, int(highest / float(shaft)) + 1)
    # n·s is a multiple of another shaft's order where n is one of the denominator of s over that order
    shared = [(shaft / other).denominator for other in shafts if other != shaft]
    return np.asarray(n[np.all([n % step != 0 for step in shared], axis=0)][:most] if shared else n[:most])
