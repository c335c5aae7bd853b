"""Lost samples: filled where that is harmless, marked where it is not."""

from __future__ import annotations

import numpy as np


def runs(mask) -> list[tuple[int, int]]:
    """The stretches [start, stop) in which a boolean mask (n,) is true."""
    if np.all(mask):
        return [(0, len(mask))] if len(mask) else []
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def filled(values, longest: int) -> tuple[np.ndarray, np.ndarray]:
    """Values with every NaN replaced on the straight line between its neighbours, and what may be used.

    values  (n,), at least one of them finite
    returns the filled values (n,) and a mask (n,): true but in gaps of more than `longest` values
    """
    lost = ~np.isfinite(values)
    if not lost.any():
        return np.asarray(values, dtype=float), np.ones(len(values), dtype=bool)
    index = np.arange(len(values))
    out = np.interp(index, index[~lost], np.asarray(values, dtype=float)[~lost])
    usable = np.ones(len(values), dtype=bool)
    for start, stop in runs(lost):
        if stop - start > longest or start == 0 or stop == len(values):
            usable[start:stop] = False
    return out, usable


def taper(usable, width: int) -> np.ndarray:
    """A weight (n,) that falls smoothly to zero towards every unusable stretch, over `width` values."""
    if usable.all():
        return np.ones(len(usable))
    weight = usable.astype(float)
    ramp = np.sin(0.5 * np.pi * (np.arange(width) + 0.5) / max(width, 1)) ** 2
    for start, stop in runs(~usable):
        left = weight[max(0, start - width) : start]
        left *= ramp[: left.size][::-1]
        right = weight[stop : stop + width]
        right *= ramp[: right.size]
    return weight
