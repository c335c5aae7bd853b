"""What an order of the pinion's turn belongs to: the one question behind every "of no shaft".

    pinion  o = n           gear  o = n·z1/z2           mesh  o = n·z1, among both
    hunting o = n·h, h = gcd(z1, z2)/z2, n up to 3: the same two teeth meet again after z2/gcd turns of the pinion
    fraction o = n·z1/2, n·z1/3: every second or third tooth
    mixed   o = |n·z1 ± a| or |n·z1 ± a ± b|, n from 0: two lines that are known modulate one another, or the mesh

a, b  orders of lines that have been explained: run-outs, a ripple of the torque, a force on a shaft

A bearing's order is not told by nearness: k/m of a turn or of the mesh order (k, m ≤ 3), it is the shaft's where its
phase is locked to the shaft's angle (twin/tracing/phase_lock.py).

Every order is a multiple of h to within h/2: higher multiples of it say nothing unless windows are longer than the
hunting period by far, and are not excluded. An order counts as one of these within the resolution of the windows.

Source   hunting tooth frequency: P. D. McFadden, Mech. Syst. Signal Process. 5 (1991) 435–440; sums and differences of
         modulating frequencies: P. D. McFadden, J. Vib. Acoust. Stress Reliab. Des. 108 (1986) 165–170
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations_with_replacement
from math import gcd

import numpy as np

HUNTING = 3  # multiples of the tooth-hunting order
PINION, GEAR, HUNTED = "pinion", "gear", "tooth-hunting period"
MIXED, FRACTION = "sum or difference of known lines", "fraction of the mesh order"


def distance_from_turns(orders: np.ndarray, teeth: tuple[int, int]) -> np.ndarray:
    """Distance [order] of each order from the nearest multiple of either shaft's turn; (n,) → (n,)."""
    o, gear = np.asarray(orders, dtype=float), teeth[0] / teeth[1]
    return np.minimum(np.abs(o - np.rint(o)), np.abs(o - gear * np.rint(o / gear)))


def owner_of(order: float, teeth: tuple[int, int], width: float, known: Iterable[float] = ()) -> str | None:
    """What an order belongs to, by the names above; None where to none: then it may be said to belong to no shaft.

    width  distance [order] within which two orders cannot be told apart
    known  orders of lines that have been explained, beside those of the mesh
    """
    for name, unit, most in (
        (PINION, 1.0, None),
        (GEAR, teeth[0] / teeth[1], None),
        (HUNTED, gcd(*teeth) / teeth[1], HUNTING),
    ):
        n = max(1, round(order / unit))
        if (most is None or n <= most) and abs(order - n * unit) <= width:
            return name
    if _is_mixed(order, teeth[0], width, tuple(known)):
        return MIXED
    return FRACTION if fraction_of_mesh(order, teeth[0], width) else None


def fraction_of_mesh(order: float, mesh: int, width: float) -> str:
    """Halves and thirds of the mesh order, as "1/2"; empty where an order is none of them."""
    for m in (2, 3):
        k = round(m * order / mesh)
        if k % m and abs(order - k * mesh / m) <= width:
            return f"{k}/{m}"
    return ""


def fractions(teeth: tuple[int, int], lowest: float, highest: float) -> dict[float, int]:
    """Orders k/m of both turns and of the mesh (k, m ≤ 3), and whole turns of the pinion, in a range; with their m."""
    units = (1.0, teeth[0] / teeth[1], float(teeth[0]))
    found = [(k / m * unit, m) for unit in units for m in (1, 2, 3) for k in (1, 2, 3) if gcd(k, m) == 1]
    found += [(float(k), 1) for k in range(1, int(highest) + 1)]
    out: dict[float, int] = {}
    for order, m in sorted(found, key=lambda item: item[1]):
        if lowest < order < highest and all(abs(order - other) > 1e-9 for other in out):
            out[order] = m
    return dict(sorted(out.items()))


def _is_mixed(order: float, mesh: int, width: float, known: tuple[float, ...]) -> bool:
    """Whether an order is a mesh harmonic, or 0, more or less one or two known orders."""
    pairs = combinations_with_replacement(known, 2)
    offsets = {*known, *(abs(a + sign * b) for a, b in pairs for sign in (-1, 1))}
    around = mesh * round(order / mesh)
    near = (around, around - mesh, around + mesh)
    return any(abs(abs(o + sign * a) - order) <= width for a in offsets if a > 0 for o in near for sign in (-1, 1))
