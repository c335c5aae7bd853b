"""A complex factor over frequency, learned from windows, with a prior of one.

What the 21 degrees of freedom say of the path from the mesh to the accelerometer is right for the rig they were
fitted to and no more than a prior for a real machine, with its casing and its own shafts. Measured response over
predicted response, line by line, is one plus a smooth random function of frequency:

    ρ(f) = 1 + u(f, j),     cov(u, u') = σ²·exp(−½(ln(f/f')/ℓ)²)·exp(−|j − j'|/m)

u     complex, circular
j     number of the window: what was learned long ago counts less
ℓ, m  how far a measurement reaches in frequency and in windows

Source   C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press 2006, eqs 2.25, 2.26
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FARTHEST = -100.0  # ln of a correlation that is none: numbers near the least of all take several times as long


@dataclass(frozen=True, slots=True, kw_only=True)
class FrequencyCorrection:
    """Prior of a factor over frequency."""

    spread: float  # σ, of the real and of the imaginary part
    reach: float  # ℓ, relative frequency
    memory: float  # m, windows

    def _covariance(self, f: np.ndarray, j: np.ndarray, f2: np.ndarray, j2: np.ndarray) -> np.ndarray:
        apart = (np.log(f)[:, None] - np.log(f2)) / self.reach
        far = np.maximum(-0.5 * apart**2 - np.abs(j[:, None] - j2) / self.memory, FARTHEST)
        return self.spread**2 * np.exp(far)

    def predict(
        self,
        learned: Sequence[tuple[float, float, complex, float]],
        frequency: np.ndarray,
        window: float,
    ) -> np.ndarray:
        """Factor at frequencies [Hz] in a window (n,).

        learned  (window, frequency [Hz], factor, std of its real and imaginary part) of every line measured
        """
        f = np.asarray(frequency, dtype=float)
        j = np.full(f.size, float(window))
        if not learned:
            return np.ones(f.size, dtype=complex)
        j_l, f_l, ρ, σ = (np.array(column) for column in zip(*learned, strict=True))
        K = self._covariance(f_l.real, j_l.real, f_l.real, j_l.real) + np.diag(σ.real**2)
        cross = self._covariance(f, j, f_l.real, j_l.real)
        off = ρ - 1
        return 1 + (cross @ np.linalg.solve(K, np.stack([off.real, off.imag], axis=1))) @ [1, 1j]
