"""How a steady state changes with the parameters of its equations, to first order.

    R(d; p) = 0        J·∂d/∂p = −∂R/∂p,        J = ∂R/∂d

J is made once for a steady state, over the samples of its period, and serves every parameter:

    J = K·M + C(1/G) + Σ_c C(G_c/G)·K_c·M,        M = C(1 + iωτ)

C(H)  convolution with the response whose lines are H: a circulant matrix
K     diagonal of the closed contacts' stiffness, of the mesh force; K_c of each further action

∂R/∂p comes from the equations of slightly other contacts, structure or loads at the same motion; then no iteration is
left. Contacts that open or close elsewhere change the forces from second order on.

Source   direct differentiation of the balanced equations: J. S. Arora, E. J. Haug, AIAA J. 17 (1979) 970–974
Holds    smoothly varying steady states: not where the response jumps
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.fft import irfft, rfft
from scipy.linalg import lu_factor, lu_solve

from twin.dynamics.harmonic_balance import Balance, Contacts, Load, SteadyState, quasi_static_deflection
from twin.dynamics.structure import Structure
from twin.errors import ParameterError


@lru_cache(maxsize=4)
def _cyclic(n: int) -> np.ndarray:
    """(i − j) modulo n."""
    i = np.arange(n)
    return (i[:, None] - i[None, :]) % n


def _circulant(lines: np.ndarray, n: int) -> np.ndarray:
    return irfft(lines, n)[_cyclic(n)]


class Linearised:
    """A steady state, ready to be moved.

    structure, contacts, mean_force, loads  as it was solved with
    steady                                  the steady state itself
    """

    def __init__(
        self,
        structure: Structure,
        contacts: Contacts,
        mean_force: float,
        steady: SteadyState,
        loads: tuple[Load, ...] = (),
    ) -> None:
        n = contacts.samples
        balance = Balance(structure, contacts, mean_force, loads)
        self.d_hat = rfft(steady.deflection, norm="forward")
        found = balance.at(self.d_hat)
        tangent, tangents = balance.tangents(found.closed)
        M = _circulant(balance.closing, n)
        J = tangent[:, None] * M + _circulant(balance.inverse, n)
        for ratio, weighted in zip(balance.ratios, tangents, strict=True):
            J += irfft(ratio[:, None] * rfft(weighted[:, None] * M, axis=0), n, axis=0)
        self._factors = lu_factor(J, overwrite_a=True, check_finite=False)
        self._left = found.residual  # what the solver left
        self.samples = n

    def moved(
        self, structure: Structure, contacts: Contacts, mean_force: float, loads: tuple[Load, ...] = ()
    ) -> SteadyState:
        """The steady state of slightly other contacts, structure or loads; `converged` does not refer to its error.

        Raises ParameterError where the period is not sampled alike.
        """
        if contacts.samples != self.samples:
            raise ParameterError(f"{contacts.samples} samples a period: the steady state has {self.samples}")
        balance = Balance(structure, contacts, mean_force, loads)
        change = balance.at(self.d_hat).residual - self._left
        step = lu_solve(self._factors, -irfft(change, self.samples, norm="forward"), check_finite=False)
        d_hat = self.d_hat + rfft(step, norm="forward")
        found = balance.at(d_hat)
        state = balance.state(d_hat, found, quasi_static_deflection(contacts, mean_force), 0, True)
        # the structure answers what is left of second order many times over: the force that it needs is kept
        return replace(state, force_lines=state.force_lines - (found.residual - self._left))
