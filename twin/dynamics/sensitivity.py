"""How a steady state changes with the parameters of its equations, to first order.

    R(d; p) = 0        J·∂d/∂p = −∂R/∂p,        J = ∂R/∂d

J is that of the closed contacts at the steady state, and serves every parameter: each takes one linear solution by
GMRES, preconditioned by the low harmonics that the state was solved with. ∂R/∂p comes from the equations of slightly
other contacts, structure or loads at the same motion. Contacts that open or close elsewhere change the forces from
second order on.

Source   direct differentiation of the balanced equations: J. S. Arora, E. J. Haug, AIAA J. 17 (1979) 970–974
Holds    smoothly varying steady states: not where the response jumps
"""

from __future__ import annotations

from twin.compiled import to_lines
from twin.dynamics.harmonic_balance import (
    MAX_NEAR,
    NEAR_MODES,
    Balance,
    Contacts,
    Load,
    SteadyState,
)
from twin.dynamics.structure import Structure

TOLERANCE = 1e-9  # of the linear solution


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
        balance = Balance(structure, contacts, mean_force, loads)
        self._steady, self._compiled = steady, balance.compiled
        self.d_hat = to_lines(steady.deflection)
        found = balance.at(self.d_hat)
        self._left = found.residual  # what the solver left
        self._low = None
        near, count = steady.low_harmonics, balance.lowest(NEAR_MODES)
        if near is not None:
            self._low = near.inverse
        elif count <= MAX_NEAR:
            self._low = balance.low_harmonics(*balance.tangents(found.closed), count).inverse

    def moved(
        self, structure: Structure, contacts: Contacts, mean_force: float, loads: tuple[Load, ...] = ()
    ) -> SteadyState:
        """The steady state of slightly other contacts, structure or loads; `converged` does not refer to its error.

        Its quasi-static deflection is that of the state that is moved. Raises ParameterError where the period is not
        sampled alike.
        """
        balance = Balance(structure, contacts, mean_force, loads)
        reached = self._compiled.carry_on(balance.compiled, self.d_hat, self._left, self._low, TOLERANCE)
        return balance.state(reached, self._steady.quasi_static)
