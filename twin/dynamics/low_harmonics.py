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
from functools import cached_property

import numpy as np
from scipy.fft import rfft
from scipy.linalg import hankel, inv, toeplitz


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
        A = np.eye(2 * m)
        for r, t in zip(self.ratios, self.tangents, strict=True):
            lines = rfft(t, norm="forward")[: 2 * m - 1]
            T = toeplitz(lines[:m], lines[:m].conj())
            H = hankel(lines[:m], lines[m - 1 :])
            H[:, 0] = 0  # the mean counts once
            of_real, of_imag = r[:m, None] * (T + H), 1j * r[:m, None] * (T - H)
            x, y = of_real * w.real + of_imag * w.imag, of_imag * w.real - of_real * w.imag
            A += np.block([[x.real, y.real], [x.imag, y.imag]])
        return np.ascontiguousarray(inv(A, overwrite_a=True, check_finite=False), dtype=np.float32)
