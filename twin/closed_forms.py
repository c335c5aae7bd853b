"""Small closed forms, in place of scipy.stats and scipy.signal, which take as long to load as all else together.

    ln p(r) = −½·(|L⁻¹·r|² + n·ln 2π) − Σ ln L_ii,      C = L·Lᵀ
    X_k = Σ_j x_j·e^{−i·j·(k + first)·φ} = c_k·Σ_j (x_j·e^{−i·j·first·φ}·c_j)·c̄_{k−j},      c_j = e^{−i·j²·φ/2}

Source   C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press (2006), eq. A.23;
         L. I. Bluestein, IEEE Trans. Audio Electroacoust. 18 (1970) 451–455 (chirp-z transform)
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import fft


def log_density(rest: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """ln of the density of normal variables of mean zero, at rows of rest (…, n) → (…,)."""
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, rest[..., None])[..., 0]
    size = rest.shape[-1] * np.log(2 * np.pi)
    return -0.5 * ((white**2).sum(axis=-1) + size) - np.log(np.diagonal(root)).sum()


def ranks(values: np.ndarray) -> np.ndarray:
    """Ranks from 1 along the last axis, the mean rank where values are the same; (…, n) → (…, n)."""
    if values.ndim > 1:
        return np.array([ranks(row) for row in values])
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - (count - 1) / 2)[place]


def resampled(values: np.ndarray, count: int) -> np.ndarray:
    """One period of real values (n,) at other even places from the same first (count,), by its Fourier lines."""
    lines, common = np.fft.rfft(values) * (count / values.size), min(values.size, count)
    kept = np.zeros(count // 2 + 1, dtype=complex)
    kept[: common // 2 + 1] = lines[: common // 2 + 1]
    if common % 2 == 0 and count != values.size:  # the line at half the rate stands for both of its signs
        kept[common // 2] *= 2 if count < values.size else 0.5
    return np.fft.irfft(kept, count)


def chirp_transform(size: int, count: int, φ: float, first: int = 0) -> Callable[[np.ndarray], np.ndarray]:
    """What gives X_k (…, count), k = 0 … count − 1, of values (…, size)."""
    j = np.arange(max(size, count))
    chirp = np.exp(-0.5j * φ * j**2)
    length = fft.next_fast_len(size + count - 1)
    against = np.zeros(length, dtype=complex)
    against[:count] = chirp[:count].conj()
    against[length - size + 1 :] = chirp[1:size][::-1].conj()
    filtered, turned = fft.fft(against), chirp[:size] * np.exp(-1j * φ * first * j[:size])
    return lambda values: chirp[:count] * fft.ifft(fft.fft(values * turned, length) * filtered)[..., :count]
