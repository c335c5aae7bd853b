"""What the features' Fourier transforms share: window, power, lengths that are quick, and powers of a phase factor."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from functools import lru_cache
from math import pi

import numpy as np
from scipy import fft


@lru_cache(maxsize=8)
def hann(n: int) -> np.ndarray:
    """Hann window (n,) symmetric about its middle, nowhere zero; read-only."""
    rising = (_turns(2 * n, (n + 1) // 2) * np.exp(-0.5j * pi / n)).imag ** 2
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


def _turns(n: int, count: int) -> np.ndarray:
    """exp(−2πi·k/n) for k < count; (count,) complex."""
    out, done = np.ones(count, dtype=complex), 1
    while done < count:
        more = min(done, count - done)
        np.multiply(out[:more], np.exp(-2j * pi * done / n), out=out[done : done + more])
        done += more
    return out


def _is_slow(n: int) -> bool:
    """Whether a transform of n real values is quicker as one of half as many complex values."""
    return n % 2 == 0 and fft.next_fast_len(n // 2) != n // 2


def spectrum_of(values) -> np.ndarray:
    """Fourier sums Σ x·exp(−2πi·k·m/n) of any length, k ≤ n/2; (n,) real → (n//2 + 1,) complex.

    An even number of values with a large prime factor is taken as half as many complex ones, x_2m + i·x_2m+1 → Z:
    X_k = (Z_k + Z*_h−k)/2 − i·exp(−2πi·k/n)·(Z_k − Z*_h−k)/2, h = n/2, in a third of the time.
    """
    x = np.ascontiguousarray(values, dtype=float)
    if not _is_slow(x.size):
        return fft.rfft(x)
    z = fft.fft(x.view(complex))
    one = np.append(z, z[0])
    other = one[::-1].conj()
    return 0.5 * (one + other) - 0.5j * _turns(x.size, one.size) * (one - other)


def record_of(spectrum, n: int) -> np.ndarray:
    """The record of such sums; (n//2 + 1,) complex → (n,) real."""
    if not _is_slow(n):
        return fft.irfft(spectrum, n)
    other = spectrum[::-1].conj()
    whole = 0.5 * (spectrum + other) + 0.5j * _turns(n, spectrum.size).conj() * (spectrum - other)
    return fft.ifft(whole[:-1]).view(float)


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
