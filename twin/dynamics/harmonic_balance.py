"""Steady response of a linear structure closed by unilateral contacts, without time-stepping.

The contacts are the only non-linear and time-varying part, and they see the structure through the single
coordinate d along the line of action. With G = gᵀH(ω)g of the structure without its contacts, the steady
state over one period is a scalar problem, harmonic by harmonic:

    F̂_k + Σ_c Â_ck·G_c/G + (d̂_k − Σ_l f̂_lk·G_l)/G = 0   (k ≠ 0),        F̂_0 + Σ_c m_c·Â_c0 = F_mean

    F = Σ_p σ_p·k_p·max(0, δ_p + τ·δ_p'),        δ_p = σ_p·d + e_p

d      deflection along the line of action, positive in compression                       [m]
e_p    separation of contact p from the perfect surfaces, negative where material is missing [m]
σ_p    +1 where compression closes the contact (drive flanks), −1 where it opens (back flanks)
k_p, τ stiffness of a contact [N/m] and its relative damping time [s]
A_c    further actions of the same contacts on the structure, Σ_p w_cp·σ_p·F_p along a direction of
       their own (friction is one); G_c = gᵀH(ω)a_c; m_c their moment on the driven shaft, of the mesh force's
f_l    loads that do not depend on the motion (unbalance, torque ripple), along a direction of their own

Newton's method with GMRES, contact forces in the time domain, the structure in the frequency domain,
FFT between, all compiled (twin/compiled); preconditioner 1/(k̄(1 + iωτ) + 1/G), and the low harmonics
solved directly, at the neighbouring state that it starts from or, where contact is lost, anew at every step. Starts
from the quasi-static solution.

Source   alternating frequency/time harmonic balance: T. M. Cameron, J. H. Griffin, J. Appl. Mech. 56
         (1989) 149–154; Newton–Krylov: C. T. Kelley, Solving Nonlinear Equations with Newton's Method,
         SIAM 2003, ch. 3
Holds    responses that repeat with the period; others do not converge, which `converged` reports
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import pi

import numpy as np

from twin.compiled import CompiledBalance, Progress, Solution, quasi_static, split, to_lines, to_samples
from twin.dynamics.low_harmonics import LowHarmonics
from twin.dynamics.structure import Structure
from twin.errors import NotConverged, ParameterError

MAX_NEWTON = 40
MAX_STALLED = 12  # Newton steps with little progress, while contacts open and close
TOLERANCE = 1e-9  # of the mean force
NEAR_MODES, MAX_NEAR = 1.4, 128  # harmonics solved directly at a neighbouring state: of the fastest mode's; at most
PARTED_MODES, MAX_PARTED = 2.0, 300  # the same where contact is lost
PARTED = 0.2  # slope of the contacts, of its mean, below which contact counts as lost
EVERY = slice(1, None)  # line of a response
# Products a Newton step from which a neighbour's low harmonics are not handed on: beyond OWN, which a state's own take,
# as many as cost as much as an inversion. A product's cost grows with the samples, an inversion's does not.
OWN, INVERSION = 8, 4096  # products; products times samples


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Action:
    """A further action of the contact forces on the structure."""

    direction: np.ndarray  # a_c (21,)
    weight: np.ndarray  # w_cp (p, n)
    mean: float = 0.0  # m_c: moment about the driven shaft over that of the mesh force, a_c·r/(g·r)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Load:
    """A periodic force on the structure that does not depend on its motion."""

    direction: np.ndarray  # a_l (21,)
    lines: np.ndarray  # f̂_lk (n//2 + 1,) two-sided coefficients of the period's harmonics; f̂_l0 = 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Contacts:
    """All contacts that can close during one period, sampled evenly in time."""

    stiffness: np.ndarray  # k_p (p, n) [N/m]
    separation: np.ndarray  # e_p (p, n) [m]
    separation_rate: np.ndarray  # de_p/dt (p, n) [m/s]
    side: np.ndarray  # σ_p (p,) +1 or −1
    damping_time: float  # τ [s]
    period: float  # [s]
    actions: tuple[Action, ...] = ()

    @property
    def samples(self) -> int:
        return self.stiffness.shape[1]

    @property
    def omega(self) -> np.ndarray:
        """Angular frequency of each harmonic (n//2 + 1,) [rad/s]."""
        return 2 * pi / self.period * np.arange(self.samples // 2 + 1)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SteadyLines:
    """What contacts and loads do to the structure at every harmonic of a period."""

    omega: np.ndarray  # (n//2 + 1,) [rad/s]
    force_lines: np.ndarray  # F̂_k (n//2 + 1,) two-sided coefficients [N]
    action_lines: tuple[np.ndarray, ...]  # Â_ck, as many as actions
    directions: tuple[np.ndarray, ...] = field(default=(), repr=False)
    loads: tuple[Load, ...] = field(default=(), repr=False)

    def lines(self, structure: Structure, response: np.ndarray, at: slice | np.ndarray = EVERY) -> np.ndarray:
        """Complex amplitudes of a response direction for k ≥ 1 (n//2,): x(t) = Re Σ X_k e^{iω_k t}.

        at  which k, where not all are asked for
        """

        def moved(by: np.ndarray) -> np.ndarray:
            if at is EVERY:
                n, lowest = 2 * (self.omega.size - 1), float(self.omega[1])
                return _receptance(structure, n, lowest, by.tobytes(), response.tobytes())
            return structure.receptance(self.omega[at], by, response)

        x = -moved(structure.mesh) * self.force_lines[at]
        for a, A in zip(self.directions, self.action_lines, strict=True):
            x = x - moved(a) * A[at]
        for load in self.loads:
            x = x + moved(load.direction) * load.lines[at]
        return 2 * x

    @property
    def spectra(self) -> SteadyLines:
        """These alone."""
        return SteadyLines(
            omega=self.omega,
            force_lines=self.force_lines,
            action_lines=self.action_lines,
            directions=self.directions,
            loads=self.loads,
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SteadyState(SteadyLines):
    """A steady state over one period."""

    deflection: np.ndarray  # d (n,) [m]
    quasi_static: np.ndarray  # d of the same contacts without inertia (n,) [m]
    contact_forces: np.ndarray  # k_p·max(0, …) ≥ 0 (p, n) [N]
    mesh_force: np.ndarray  # F (n,) [N]
    residual: float  # largest residual, of the mean force
    iterations: int
    converged: bool
    products: int = 0  # with the Jacobian, all iterations together
    low_harmonics: LowHarmonics | None = field(default=None, repr=False)  # for a neighbouring state

    @property
    def nbytes(self) -> int:
        """Memory of its own arrays [bytes]."""
        own = (self.deflection, self.quasi_static, self.contact_forces, self.mesh_force, self.force_lines, self.omega)
        low = 0 if self.low_harmonics is None else self.low_harmonics.nbytes
        return sum(values.nbytes for values in (*own, *self.action_lines)) + low

    @property
    def contact_loss(self) -> float:
        """Share of the period in which no contact carries load."""
        return float(np.mean(self.contact_forces.sum(axis=0) == 0))

    def require_converged(self) -> SteadyState:
        """Itself; raises NotConverged where it is no answer."""
        if not self.converged:
            raise NotConverged(
                f"harmonic balance stopped at a residual of {self.residual:.2e} of the mean force after "
                f"{self.iterations} iterations (tolerance {TOLERANCE:g}): the response may not repeat with the period"
            )
        return self


def quasi_static_deflection(contacts: Contacts, mean_force: float) -> np.ndarray:
    """d (n,) [m] at which the drive flanks carry the mean force at every instant, without dynamics."""
    return quasi_static(contacts.stiffness, contacts.separation, contacts.side, mean_force)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Evaluated:
    """The balance at one motion."""

    residual: np.ndarray  # lines (n//2 + 1,) [N]
    penetration: np.ndarray  # ≥ 0 (p, n) [m]
    closed: np.ndarray  # its slope 0 … 1 (p, n)


class Balance:
    """The equations of one period: structure, contacts and loads.

    mean_force  mean mesh force T/r_b1 [N], > 0
    loads       forces that do not depend on the motion
    rounding    ε [m] of contacts that open gradually, (x + sqrt(x² + ε²))/2 for max(0, x); an aid of the continuation
    """

    def __init__(
        self,
        structure: Structure,
        contacts: Contacts,
        mean_force: float,
        loads: tuple[Load, ...] = (),
        rounding: float = 0.0,
    ) -> None:
        if not mean_force > 0:
            raise ParameterError(f"mean_force = {mean_force:g} N must be positive: the gears are driven forward")
        self.contacts, self.mean_force, self.loads, self.rounding = contacts, mean_force, loads, rounding
        n, period, τ = contacts.samples, contacts.period, contacts.damping_time
        if n % 2:
            raise ParameterError(f"samples = {n} a period must be even")
        self.omega = _omega(n, period)
        lowest, mesh = float(self.omega[1]), structure.mesh.tobytes()
        self.closing = _closing(n, period, τ)  # from the lines of d to those of d + τ·d'
        self.inverse = _inverse(structure, n, lowest)
        self._split = _split(structure, n, period, lowest, τ)
        self.ratios = np.zeros((len(contacts.actions), self.omega.size), dtype=complex)
        for ratio, action in zip(self.ratios, contacts.actions, strict=True):
            ratio[:] = _ratio(structure, n, lowest, action.direction.tobytes())
            ratio[0] = action.mean
        self.driven = np.zeros(self.omega.size, dtype=complex)
        for load in loads:
            moved = _receptance(structure, n, lowest, load.direction.tobytes(), mesh)
            self.driven += _spectrum(moved * load.lines[1:])
        self._side = contacts.side[:, None]
        self._open_by = contacts.separation + τ * contacts.separation_rate
        self._structure = structure

    @cached_property
    def compiled(self) -> CompiledBalance:
        """The same for the kernels."""
        contacts = self.contacts
        weights = np.empty((len(contacts.actions), *contacts.stiffness.shape))
        for weight, action in zip(weights, contacts.actions, strict=True):
            weight[:] = action.weight
        return CompiledBalance(
            contacts.stiffness, self._open_by, contacts.side, weights, *self._split,
            split(self.ratios), split(self.driven), self.mean_force, self.rounding,
        )  # fmt: skip

    def at(self, d_hat: np.ndarray) -> Evaluated:
        """Residual and contacts for the lines of d (n//2 + 1,)."""
        x = self._side * to_samples(self.closing * d_hat) + self._open_by
        if self.rounding:
            root = np.sqrt(x**2 + self.rounding**2)
            penetration, closed = (x + root) / 2, (1 + x / root) / 2
        else:
            penetration, closed = np.maximum(x, 0.0), x > 0
        forces = self._side * self.contacts.stiffness * penetration
        residual = to_lines(forces.sum(axis=0)) + self.inverse * (d_hat - self.driven)
        for action, ratio in zip(self.contacts.actions, self.ratios, strict=True):
            residual += ratio * to_lines((action.weight * forces).sum(axis=0))
        residual[0] -= self.mean_force
        return Evaluated(residual=residual, penetration=penetration, closed=closed)

    def tangents(self, closed: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Stiffness of the closed contacts against d, of the mesh force and of every action; (n,) each [N/m]."""
        stiffness = self.contacts.stiffness * closed
        return stiffness.sum(axis=0), [(action.weight * stiffness).sum(axis=0) for action in self.contacts.actions]

    def lowest(self, beyond: float) -> int:
        """How many of the lowest lines reach so far beyond the structure's fastest mode."""
        fastest = self._structure.modes[0].max() / self.omega[1]
        return min(int(beyond * fastest) + 2, self.contacts.samples // 4)

    def low_harmonics(self, tangent: np.ndarray, tangents: Iterable[np.ndarray], count: int) -> LowHarmonics:
        """The lowest lines where the contacts have these slopes."""
        mean = float(tangent.mean()) or float(self.contacts.stiffness.mean())
        return LowHarmonics(
            ratios=(np.ones(self.omega.size), *self.ratios),
            tangents=(tangent - mean, *tangents),
            to_closing=self.closing / (mean * self.closing + self.inverse),
            count=count,
        )

    def reached(self, d_hat: np.ndarray) -> Solution:
        """The contacts at the lines of a motion (n//2 + 1,)."""
        found = self.at(d_hat)
        forces = self.contacts.stiffness * found.penetration
        tangent, tangents = self.tangents(found.closed)
        signed = self._side * forces
        return Solution(
            progress=Progress(float(np.abs(found.residual).max()) / self.mean_force, 0, 0, 0),
            deflection=to_samples(d_hat),
            forces=forces,
            force_lines=to_lines(signed.sum(axis=0)),
            action_lines=np.array([to_lines((action.weight * signed).sum(axis=0)) for action in self.contacts.actions]),
            tangent=tangent,
            action_tangents=np.array(tangents),
        )

    def state(self, reached: Solution, static: np.ndarray, *, converged: bool = True) -> SteadyState:
        """The motion that was reached as a steady state."""
        return SteadyState(
            deflection=reached.deflection,
            quasi_static=static,
            contact_forces=reached.forces,
            mesh_force=self.contacts.side @ reached.forces,
            force_lines=reached.force_lines,
            action_lines=tuple(reached.action_lines),
            omega=self.omega,
            residual=reached.progress.residual,
            iterations=reached.progress.iterations,
            converged=converged,
            products=reached.progress.products,
            directions=tuple(action.direction for action in self.contacts.actions),
            loads=self.loads,
        )

    def search(
        self, start: np.ndarray, static: np.ndarray, near: LowHarmonics | None, tolerance: float, most: float
    ) -> SteadyState:
        """Newton's method from a deflection (n,); near: the low harmonics of a neighbouring state.

        Where contact is lost, the low harmonics are solved anew at every step.
        """
        direct = self.lowest(PARTED_MODES)
        parted = PARTED if direct <= MAX_PARTED else -1.0
        reached = self.compiled.newton(
            start, None if near is None else near.inverse, tolerance,
            most_steps=MAX_NEWTON, most_products=most, parted=parted, stalled=0,
        )  # fmt: skip
        done = reached.progress
        lost = False
        while done.residual > tolerance and done.iterations < MAX_NEWTON and done.stalled < MAX_STALLED:
            if done.products >= most:
                break
            lost = True
            own = self.low_harmonics(reached.tangent, reached.action_tangents, direct)
            reached = self.compiled.newton(
                reached.deflection, own.inverse, tolerance,
                most_steps=1, most_products=most, parted=-1.0, stalled=done.stalled,
            )  # fmt: skip
            step = reached.progress
            done = Progress(
                step.residual, done.iterations + step.iterations, done.products + step.products, step.stalled
            )
        found = self.state(reached._replace(progress=done), static, converged=done.residual <= tolerance)
        count = self.lowest(NEAR_MODES)
        if count > MAX_NEAR:
            return found
        stale = OWN + INVERSION / self.contacts.samples
        if near is None or lost or done.products > stale * max(done.iterations, 1):
            near = self.low_harmonics(reached.tangent, reached.action_tangents, count)
        return replace(found, low_harmonics=near)

    def along_branch(
        self, d_hat: np.ndarray, low: np.ndarray | None, tolerance: float
    ) -> tuple[Progress, np.ndarray, np.ndarray, np.ndarray | None]:
        """At a motion with rounded contacts: J⁻¹·(−R) and J⁻¹·(−∂R/∂ln ε), each to a relative tolerance, and the
        inverse of the low harmonics, made here where it is not given."""
        count = self.lowest(PARTED_MODES)
        if low is None and count <= MAX_PARTED:
            low = self.low_harmonics(*self.tangents(self.at(d_hat).closed), count).inverse
        return *self.compiled.branch_solutions(d_hat, low, tolerance), low


@lru_cache(maxsize=16)
def _omega(samples: int, period: float) -> np.ndarray:
    """Angular frequency of each harmonic (n//2 + 1,) [rad/s]."""
    return 2 * pi / period * np.arange(samples // 2 + 1)


@lru_cache(maxsize=16)
def _closing(samples: int, period: float, damping_time: float) -> np.ndarray:
    """Lines of 1 + iωτ; the derivative of the Nyquist line is not real."""
    lines = 1 + 2j * pi / period * damping_time * np.arange(samples // 2 + 1)
    lines[-1] = 1
    return lines


@lru_cache(maxsize=64)
def _receptance(structure: Structure, samples: int, lowest: float, force: bytes, response: bytes) -> np.ndarray:
    """From a force along one direction to the response along another, at all harmonics of the lowest [rad/s]."""
    ω = lowest * np.arange(1, samples // 2 + 1)
    return structure.receptance(ω, np.frombuffer(force), np.frombuffer(response))


@lru_cache(maxsize=16)
def _inverse(structure: Structure, samples: int, lowest: float) -> np.ndarray:
    """Lines of 1/G."""
    mesh = structure.mesh.tobytes()
    return _spectrum(1 / _receptance(structure, samples, lowest, mesh, mesh))


@lru_cache(maxsize=16)
def _split(structure: Structure, samples: int, period: float, lowest: float, τ: float) -> tuple[np.ndarray, np.ndarray]:
    """Lines of 1 + iωτ and of 1/G as the kernels read them."""
    return split(_closing(samples, period, τ)), split(_inverse(structure, samples, lowest))


@lru_cache(maxsize=16)
def _ratio(structure: Structure, samples: int, lowest: float, direction: bytes) -> np.ndarray:
    """Lines of G_c/G of a force along a direction."""
    mesh = structure.mesh.tobytes()
    G = _receptance(structure, samples, lowest, mesh, mesh)
    return _spectrum(_receptance(structure, samples, lowest, direction, mesh) / G)


def _spectrum(values: np.ndarray) -> np.ndarray:
    """Lines (n//2 + 1,) from those of k ≥ 1; the Nyquist line of a real signal is real."""
    lines = np.concatenate(([0], values))
    lines[-1] = lines[-1].real
    return lines


def solve(
    structure: Structure,
    contacts: Contacts,
    mean_force: float,
    *,
    loads: tuple[Load, ...] = (),
    start: np.ndarray | SteadyState | None = None,
    tolerance: float = TOLERANCE,
    rounding: float = 0.0,
    most: int | None = None,
) -> SteadyState:
    """The steady state over one period.

    start       deflection to start from (n,) [m]; or a steady state of similar contacts, whose departure from its
                quasi-static deflection is added to that of these; the quasi-static one where None
    most        products with the Jacobian after which it is given up
    Others as `Balance`. Returns a SteadyState whose `converged` says whether it may be used.
    """
    balance = Balance(structure, contacts, mean_force, loads, rounding)
    static, near = quasi_static_deflection(contacts, mean_force), None
    if start is None:
        deflection = static
    elif isinstance(start, SteadyState):
        deflection = static + (start.deflection - start.quasi_static)
        if start.low_harmonics is not None and start.low_harmonics.lines == balance.omega.size:
            near = start.low_harmonics
    else:
        deflection = start
    return balance.search(deflection, static, near, tolerance, np.inf if most is None else most)
