"""The lines that one shaft alone makes."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

LINES = 12  # of a shaft that are compared, from its first


def own_multiples(shaft: Fraction, shafts: Sequence[Fraction], highest: float, most: int = LINES) -> np.ndarray:
    """n of a shaft's lines n·s that no other shaft makes by itself, the lowest first."""
    others = [s for s in shafts if s != shaft]
    n = range(1, int(highest / float(shaft)) + 1)
    own = [m for m in n if not any((m * shaft / s).denominator == 1 for s in others)]
    return np.array(own[:most], dtype=int)
