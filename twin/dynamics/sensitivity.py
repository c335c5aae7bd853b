"""How a steady state changes with the parameters of its equations, to first order.

    R(d; p) = 0        J·∂d/∂p = −∂R/∂p,        J = ∂R/∂d

J is that of the closed contacts at the steady state, and serves every parameter: each takes one linear solution by
GMRES with the state's own low harmonics. ∂R/∂p comes from the equations of slightly other contacts, structure or loads
at the same motion. Contacts that open or close elsewhere change the forces from second order on.

Source   direct differentiation of the balanced equations: J. S. Arora, E. J. Haug, AIAA J. 17 (1979) 970–974
Holds    smoothly varying steady states: not where the response jumps
"""

from __future__ import annotations

from dataclasses import replace

from twin.compiled import to_lines
from twin.dynamics.harmonic_balance import (
    MAX_NEAR,
    NEAR_MODES,
    Balance,
    Contacts,
    Load,
    SteadyState,
    quasi_static_deflection,
)
from twin.dynamics.structure import Structure
from twin.errors import ParameterError

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
        self._balance = Balance(structure, contacts, mean_force, loads)
        self.d_hat = to_lines(steady.deflection)
        found = self._balance.at(self.d_hat)
        count = self._balance.lowest(NEAR_MODES)
        self._low = None
        if count <= MAX_NEAR:
            self._low = self._balance.low_harmonics(*self._balance.tangents(found.closed), count).inverse
        self._left = found.residual  # what the solver left
        self.samples = contacts.samples

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
        _, step = self._balance.compiled.linear_solution(self.d_hat, -change, self._low, TOLERANCE)
        d_hat = self.d_hat + step
        found = balance.at(d_hat)
        state = balance.state(balance.reached(d_hat), quasi_static_deflection(contacts, mean_force))
        # the structure answers what is left of second order many times over: the force that it needs is kept
        return replace(state, force_lines=state.force_lines - (found.residual - self._left))
