"""The low harmonics of the contact problem solved directly, to precondition the rest.

GMRES spends its steps on the harmonics near the structure's resonances. Only those up to its fastest mode move much;
for the m lowest of them

    A·u = u + Σ_i r_i·rfft(t_i·irfft(w·u)),        (t·c)_k = Σ_j (t̂_{k−j}·c_j + t̂_{k+j}·c̄_j)

is a Toeplitz and a Hankel matrix over the reals and imaginaries, small enough to be inverted. The inverse serves
neighbouring motions, too, as long as the same contacts carry.

Source   Hill's determinant: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley 1979, ch. 5
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg.lapack import sgetrf, sgetri

from twin.compiled import to_lines
from twin.errors import NotConverged


@dataclass(frozen=True, eq=False, kw_only=True)
class LowHarmonics:
    """The m lowest lines at one motion; their inverse is made when it is first asked for."""

    ratios: Sequence[np.ndarray]  # r_i (n//2 + 1,), one of them 1 for the force of the mesh
    tangents: Sequence[np.ndarray]  # t_i (n,)
    to_closing: np.ndarray  # w (n//2 + 1,)
    count: int  # m

    @property
    def lines(self) -> int:
        """n//2 + 1."""
        return self.to_closing.size

    @property
    def nbytes(self) -> int:
        """Memory of its own arrays [bytes]."""
        made = 2 * self.count * 2 * self.count * 4 if "inverse" in self.__dict__ else 0
        return sum(values.nbytes for values in (*self.ratios, *self.tangents, self.to_closing)) + made

    @cached_property
    def inverse(self) -> np.ndarray:
        """A⁻¹ (2m, 2m) over the lines' real parts, then their imaginary parts; single precision."""
        m, w = self.count, self.to_closing[: self.count]
        of_real, of_imag = np.zeros((m, m), dtype=complex), np.zeros((m, m), dtype=complex)
        for r, t in zip(self.ratios, self.tangents, strict=True):
            lines = to_lines(t)[: 2 * m - 1]
            T = np.concatenate((lines[m - 1 : 0 : -1].conj(), lines[:m]))[_differences(m)]
            H = sliding_window_view(lines, m).copy()
            H[:, 0] = 0  # the mean counts once
            of_real += r[:m, None] * (T + H)
            of_imag += 1j * r[:m, None] * (T - H)
        x, y = of_real * w.real + of_imag * w.imag, of_imag * w.real - of_real * w.imag
        A = np.empty((2 * m, 2 * m), dtype=np.float32, order="F")
        A[:m, :m], A[:m, m:], A[m:, :m], A[m:, m:] = x.real, y.real, x.imag, y.imag
        A[np.diag_indices(2 * m)] += 1
        factors, pivots, singular = sgetrf(A, overwrite_a=True)
        if singular:
            raise NotConverged("the low harmonics of the contact problem are singular")
        return np.ascontiguousarray(sgetri(factors, pivots, overwrite_lu=True)[0])


@lru_cache(maxsize=8)
def _differences(m: int) -> np.ndarray:
    """i − j for a Toeplitz matrix, counted from the middle of 2m − 1 (m, m)."""
    return m - 1 + np.arange(m)[:, None] - np.arange(m)
