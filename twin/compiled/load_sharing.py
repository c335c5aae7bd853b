"""Load sharing of teeth that differ from one another: the kernel of `sharing.c` on numpy arrays."""

from __future__ import annotations

import numpy as np

from twin.compiled import _at, _given, _kernels
from twin.errors import ParameterError


def share_load(
    periods: int,
    stiffness: np.ndarray,
    gap: np.ndarray,
    missing: tuple[np.ndarray, np.ndarray],
    share: tuple[np.ndarray, np.ndarray],
    force: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Force on every flank where it touches, mean of its passages over so many mesh periods; (z1, 3n), (z2, 3n) [N].

    Pair q joins pinion tooth q mod z1 and gear tooth q mod z2 and is at rest under the load. Points along the path are
    n a base pitch, from one and a half base pitches before the pitch point on.

    stiffness, gap  of a pair (3n,) [N/m], [m]
    missing         material of every flank of pinion and gear (z1, 3n), (z2, 3n) [m]
    share           of a pair's stiffness that each tooth keeps (z1,), (z2,), above 0
    force           of all pairs together [N]
    """
    (z1, points), z2 = missing[0].shape, len(missing[1])
    if points % 3 or periods < 1 or periods % z1 or periods % z2:
        raise ParameterError(f"{points} points of three base pitches, {periods} periods for {z1} and {z2} teeth")
    k, g = _given(stiffness, points), _given(gap, points)
    h1, h2 = _given(missing[0], z1, points), _given(missing[1], z2, points)
    c1, c2 = _given(share[0], z1), _given(share[1], z2)
    load1, load2 = np.empty((z1, points)), np.empty((z2, points))
    _kernels.share_load(periods, points // 3, z1, z2, *map(_at, (k, g, h1, h2, c1, c2)), force, _at(load1), _at(load2))
    load1 *= z1 / periods
    load2 *= z2 / periods
    return load1, load2
