"""The low harmonics of the contact problem solved directly, to precondition the rest.

Where contact is lost for part of the period the stiffness jumps between zero and k: its mean is a poor choice and
GMRES needs a hundred steps. But only harmonics up to the structure's fastest mode move much; for the m lowest of them

    A·u = u + Σ_i r_i·rfft(t_i·irfft(w·u)),        (t·c)_k = Σ_j (t̂_{k−j}·c_j + t̂_{k+j}·c̄_j)

is a Toeplitz and a Hankel matrix over the reals and imaginaries, small enough to factorise.

Source   Hill's determinant: A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley 1979, ch. 5
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.fft import rfft
from scipy.linalg import hankel, lu_factor, lu_solve, toeplitz


def low_harmonic_inverse(
    terms: Sequence[tuple[np.ndarray, np.ndarray]], to_closing: np.ndarray, m: int
) -> Callable[[np.ndarray], np.ndarray]:
    """u (n//2 + 1,) → A⁻¹·u on the m lowest lines, the others untouched.

    terms       pairs r_i (n//2 + 1,) and t_i (n,) of A
    to_closing  w (n//2 + 1,)
    """
    w = to_closing[:m]
    A = np.eye(2 * m)
    for r, t in terms:
        lines = rfft(t, norm="forward")[: 2 * m - 1]
        T = toeplitz(lines[:m], lines[:m].conj())
        H = hankel(lines[:m], lines[m - 1 :])
        H[:, 0] = 0  # the mean counts once
        of_real, of_imag = r[:m, None] * (T + H), 1j * r[:m, None] * (T - H)
        x, y = of_real * w.real + of_imag * w.imag, of_imag * w.real - of_real * w.imag
        A += np.block([[x.real, y.real], [x.imag, y.imag]])
    factors = lu_factor(A)

    def inverse(u: np.ndarray) -> np.ndarray:
        solved = lu_solve(factors, np.concatenate((u[:m].real, u[:m].imag)))
        out = u.copy()
        out[:m] = solved[:m] + 1j * solved[m:]
        return out

    return inverse
