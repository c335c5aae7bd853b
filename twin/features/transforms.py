"""What the features' Fourier transforms share: window, power, lengths that are quick, and powers of a phase factor."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from functools import lru_cache
from math import pi

import numpy as np


@lru_cache(maxsize=8)
def hann(n: int) -> np.ndarray:
    """Hann window (n,) symmetric about its middle, nowhere zero; read-only."""
    rising = np.sin(pi * (np.arange((n + 1) // 2) + 0.5) / n) ** 2
    window = np.concatenate((rising, rising[: n // 2][::-1]))
    window.flags.writeable = False
    return window


def power_of(spectrum) -> np.ndarray:
    """|X|² of complex values, any shape."""
    return spectrum.real**2 + spectrum.imag**2


def fast_length_below(n: int) -> int:
    """The greatest number up to n ≥ 1 without prime factors above 5: a transform of that many real values is quick."""
    best, five = 1, 1
    while five <= n:
        three = five
        while three <= n:
            best = max(best, three << ((n // three).bit_length() - 1))
            three *= 3
        five *= 5
    return best


def bins_within(band: tuple[float, float], frequency: Callable[[int], float], count: int) -> slice:
    """The bins 0 … count − 1 whose frequency, which rises, lies within a band, its edges counted in."""
    bins = range(count)
    return slice(bisect_left(bins, band[0], key=frequency), bisect_right(bins, band[1], key=frequency))


def powers(factors, count: int) -> np.ndarray:
    """factors⁰ … factors^(count − 1); (m,) → (count, m) complex. By doubling: rounding grows with log₂(count)."""
    out = np.empty((count, len(factors)), dtype=complex)
    out[:1] = 1.0
    done, factor = 1, np.asarray(factors, dtype=complex)
    while done < count:
        more = min(done, count - done)
        np.multiply(out[:more], factor, out=out[done : done + more])
        done, factor = done + more, factor * factor
    return out
