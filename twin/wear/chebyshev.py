"""Runge–Kutta–Chebyshev steps: explicit, of second order, and stable over long stretches of the negative real axis.

A step of s stages, which evaluates the rate s times, is stable where its length times the fastest rate of decay is
below β(s) ≈ 0.65·s²: five stages go eight times as far as the midpoint rule (s = 2) for two and a half times its work.

    Y_0 = y,   Y_1 = Y_0 + μ̃_1·Δ·F_0
    Y_j = (1 − μ_j − ν_j)·Y_0 + μ_j·Y_{j−1} + ν_j·Y_{j−2} + μ̃_j·Δ·F_{j−1} + γ̃_j·Δ·F_0,      j = 2 … s

Source   B. P. Sommeijer, L. F. Shampine, J. G. Verwer, RKC: an explicit solver for parabolic PDEs, J. Comput. Appl.
         Math. 88 (1998) 315–326, eqs. 2.1–2.10
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from numpy.polynomial.chebyshev import Chebyshev

DAMPING = 2 / 13  # ε of the source: a strip about the axis in which all but the slowest changes are damped
MOST_STAGES = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class Scheme:
    """Coefficients of a step, each by stage 0 … s; those that a stage does not have are 0."""

    at: tuple[float, ...]  # c_j: where in the step a stage lies, 0 to 1
    own: tuple[float, ...]  # μ_j
    before: tuple[float, ...]  # ν_j
    rate: tuple[float, ...]  # μ̃_j
    first_rate: tuple[float, ...]  # γ̃_j

    @property
    def stages(self) -> int:
        return len(self.at) - 1


@lru_cache(maxsize=MOST_STAGES)
def stable_to(stages: int) -> float:
    """β(s) = (w_0 + 1)·T_s''(w_0)/T_s'(w_0): the longest step, times the fastest rate of decay, that s stages bear."""
    T, w0 = Chebyshev.basis(stages), 1 + DAMPING / stages**2
    return (w0 + 1) * float(T.deriv(2)(w0) / T.deriv()(w0))


def stages_for(decay: float) -> int:
    """The fewest stages that bear a step times its fastest rate of decay; no more than MOST_STAGES."""
    return next((s for s in range(2, MOST_STAGES) if stable_to(s) >= decay), MOST_STAGES)


@lru_cache(maxsize=MOST_STAGES)
def scheme(stages: int) -> Scheme:
    """The coefficients of a step of s ≥ 2 stages."""
    s, w0 = stages, 1 + DAMPING / stages**2
    T = [Chebyshev.basis(j) for j in range(s + 1)]
    first, second = [float(t.deriv()(w0)) for t in T], [float(t.deriv(2)(w0)) for t in T]
    w1 = first[s] / second[s]
    b = [0.0, 0.0, *(second[j] / first[j] ** 2 for j in range(2, s + 1))]
    b[0] = b[1] = b[2]
    later = range(2, s + 1)
    rate = [0.0, b[1] * w1, *(2 * b[j] * w1 / b[j - 1] for j in later)]
    at = [0.0, 0.0, *(w1 * second[j] / first[j] for j in later)]
    at[1] = at[2] / float(T[2].deriv()(w0))
    return Scheme(
        at=tuple(at),
        own=(0.0, 0.0, *(2 * b[j] * w0 / b[j - 1] for j in later)),
        before=(0.0, 0.0, *(-b[j] / b[j - 2] for j in later)),
        rate=tuple(rate),
        first_rate=(0.0, 0.0, *(-(1 - b[j - 1] * float(T[j - 1](w0))) * rate[j] for j in later)),
    )
