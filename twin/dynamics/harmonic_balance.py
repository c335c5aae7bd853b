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
FFT between; preconditioner 1/(k̄(1 + iωτ) + 1/G), and the low harmonics solved directly where contact is lost. Starts
from the quasi-static solution.

Source   alternating frequency/time harmonic balance: T. M. Cameron, J. H. Griffin, J. Appl. Mech. 56
         (1989) 149–154; Newton–Krylov: C. T. Kelley, Solving Nonlinear Equations with Newton's Method,
         SIAM 2003, ch. 3
Holds    responses that repeat with the period; others do not converge, which `converged` reports
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import pi

import numpy as np
from scipy.fft import irfft, rfft

from twin.dynamics.gmres import gmres
from twin.dynamics.low_harmonics import low_harmonic_inverse
from twin.dynamics.structure import Structure
from twin.errors import NotConverged, ParameterError

Map = Callable[[np.ndarray], np.ndarray]

MAX_NEWTON = 40
MAX_STALLED = 12  # Newton steps with little progress, while contacts open and close
MAX_HALVINGS = 8
TOLERANCE = 1e-9  # of the mean force
WIDEST = 30.0  # rounding of the contacts' corner at the start of the continuation through contact loss, of F/k̄
SHARP = 3e-3  # rounding from which the corner itself is tried, of F/k̄
MAX_STAGES = 40
LONG, MAX_LONG = (
    8192,
    1200,
)  # samples of a period from which the whole continuation may take so many products with its Jacobian
BEYOND_MODES = 2.0  # harmonics solved directly under contact loss reach this far beyond the fastest mode
MAX_LOW_HARMONICS = 300


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
class SteadyState:
    """A steady state over one period."""

    deflection: np.ndarray  # d (n,) [m]
    quasi_static: np.ndarray  # d of the same contacts without inertia (n,) [m]
    contact_forces: np.ndarray  # k_p·max(0, …) ≥ 0 (p, n) [N]
    mesh_force: np.ndarray  # F (n,) [N]
    force_lines: np.ndarray  # F̂_k (n//2 + 1,) two-sided coefficients [N]
    action_lines: tuple[np.ndarray, ...]  # Â_ck, as many as actions
    omega: np.ndarray  # (n//2 + 1,) [rad/s]
    residual: float  # largest residual, of the mean force
    iterations: int
    converged: bool
    products: int = 0  # with the Jacobian, all iterations together
    directions: tuple[np.ndarray, ...] = field(default=(), repr=False)
    loads: tuple[Load, ...] = field(default=(), repr=False)

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

    def lines(self, structure: Structure, response: np.ndarray) -> np.ndarray:
        """Complex amplitudes of a response direction for k ≥ 1 (n//2,): x(t) = Re Σ X_k e^{iω_k t}."""
        ω = self.omega[1:]
        x = -structure.receptance(ω, structure.mesh, response) * self.force_lines[1:]
        for a, A in zip(self.directions, self.action_lines, strict=True):
            x = x - structure.receptance(ω, a, response) * A[1:]
        for load in self.loads:
            x = x + structure.receptance(ω, load.direction, response) * load.lines[1:]
        return 2 * x


def quasi_static_deflection(contacts: Contacts, mean_force: float) -> np.ndarray:
    """d (n,) [m] at which the drive flanks carry the mean force at every instant, without dynamics.

    Newton's method on a convex, piecewise linear function: monotone from above, exact after as many
    steps as there are contacts.
    """
    drive = contacts.side > 0
    k, e = contacts.stiffness[drive], contacts.separation[drive]
    d = (mean_force / k).max(axis=0) + np.max(-e, axis=0)
    before = None
    for _ in range(k.shape[0] + 1):
        touching = d + e > 0
        if before is not None and np.array_equal(touching, before):
            break
        before = touching
        closed = k * touching
        d = d - ((closed * (d + e)).sum(axis=0) - mean_force) / closed.sum(axis=0)
    return d


def _lines(values: np.ndarray) -> np.ndarray:
    """Two-sided Fourier coefficients of a record, k ≥ 0; (n,) → (n//2 + 1,)."""
    return rfft(values, norm="forward")


def solve_through_contact_loss(
    structure: Structure,
    contacts: Contacts,
    mean_force: float,
    *,
    loads: tuple[Load, ...] = (),
    start: np.ndarray | SteadyState | None = None,
    tolerance: float = TOLERANCE,
) -> SteadyState:
    """As `solve`; where that fails, rounds the corner at which contacts open and sharpens it step by step.

    Rounded over 30 F/k̄ hardly any contact is ever lost and the solution is easily found; each stage starts from
    the one before, and one that fails is tried again with a smaller change. The last is the sharp corner itself. Over
    many mesh periods the continuation is cut short: where it is that long, it hardly ever converges.
    """
    room = MAX_LONG if contacts.samples > LONG else None
    steady = solve(structure, contacts, mean_force, loads=loads, start=start, tolerance=tolerance, most=room)
    if steady.converged:
        return steady
    deflection = mean_force / float(contacts.stiffness.mean())
    rounding, ratio = WIDEST * deflection, 0.5
    reached: tuple[float, np.ndarray | None] = (rounding, None)
    room = None if room is None else room - steady.products
    for _ in range(MAX_STAGES):
        if room is not None and room <= 0:
            break
        stage = solve(
            structure,
            contacts,
            mean_force,
            loads=loads,
            start=reached[1],
            tolerance=tolerance,
            rounding=rounding,
            most=room,
        )
        room = None if room is None else room - stage.products
        if stage.converged:
            if rounding == 0:
                return stage
            reached = rounding, stage.deflection
            if stage.iterations < 10:
                ratio = max(0.1, ratio**1.5)
        elif reached[1] is None or ratio > 0.9:
            break
        else:
            ratio **= 0.5
        rounding = ratio * reached[0] if ratio * reached[0] > SHARP * deflection else 0.0
    return steady


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
        n, ω, τ = contacts.samples, contacts.omega, contacts.damping_time
        iω = 1j * ω
        if n % 2 == 0:
            iω[-1] = 0  # the derivative of the Nyquist line is not real
        self.omega = ω
        self.closing = 1 + iω * τ  # from the lines of d to those of d + τ·d'

        def spectrum(values: np.ndarray) -> np.ndarray:
            """Lines (n//2 + 1,) from those of k ≥ 1; the Nyquist line of a real signal is real."""
            lines = np.concatenate(([0], values))
            if n % 2 == 0:
                lines[-1] = lines[-1].real
            return lines

        def to_mesh(a: np.ndarray) -> np.ndarray:
            return structure.receptance(ω[1:], a, structure.mesh)

        G = to_mesh(structure.mesh)
        self.inverse = spectrum(1 / G)
        self.ratios = [spectrum(to_mesh(action.direction) / G) for action in contacts.actions]
        for ratio, action in zip(self.ratios, contacts.actions, strict=True):
            ratio[0] = action.mean
        self._driven = spectrum(sum((to_mesh(load.direction) * load.lines[1:] for load in loads), np.zeros_like(G)))
        self._side = contacts.side[:, None]
        self._open_by = contacts.separation + τ * contacts.separation_rate
        self._signed_stiffness = self._side * contacts.stiffness
        self._weighted_stiffness = [action.weight * self._signed_stiffness for action in contacts.actions]

    def at(self, d_hat: np.ndarray) -> Evaluated:
        """Residual and contacts for the lines of d (n//2 + 1,)."""
        x = self._side * irfft(self.closing * d_hat, self.contacts.samples, norm="forward") + self._open_by
        if self.rounding:
            root = np.sqrt(x**2 + self.rounding**2)
            penetration, closed = (x + root) / 2, (1 + x / root) / 2
        else:
            penetration, closed = np.maximum(x, 0.0), x > 0
        residual = _lines((self._signed_stiffness * penetration).sum(axis=0)) + self.inverse * (d_hat - self._driven)
        for weighted, ratio in zip(self._weighted_stiffness, self.ratios, strict=True):
            residual += ratio * _lines((weighted * penetration).sum(axis=0))
        residual[0] -= self.mean_force
        return Evaluated(residual=residual, penetration=penetration, closed=closed)

    def tangents(self, closed: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Stiffness of the closed contacts against d, of the mesh force and of every action; (n,) each [N/m]."""
        tangent = (self.contacts.stiffness * closed).sum(axis=0)
        return tangent, [(self._side * weighted * closed).sum(axis=0) for weighted in self._weighted_stiffness]

    def size(self, found: Evaluated) -> float:
        """Largest residual, of the mean force."""
        return float(np.abs(found.residual).max()) / self.mean_force

    def state(
        self,
        d_hat: np.ndarray,
        found: Evaluated,
        static: np.ndarray,
        iterations: int,
        converged: bool,
        products: int = 0,
    ) -> SteadyState:
        """The motion as a steady state."""
        forces = self.contacts.stiffness * found.penetration
        mesh_force = (self._side * forces).sum(axis=0)
        actions = self.contacts.actions
        return SteadyState(
            deflection=irfft(d_hat, self.contacts.samples, norm="forward"),
            quasi_static=static,
            contact_forces=forces,
            mesh_force=mesh_force,
            force_lines=_lines(mesh_force),
            action_lines=tuple(_lines((a.weight * self._side * forces).sum(axis=0)) for a in actions),
            omega=self.omega,
            residual=self.size(found),
            iterations=iterations,
            converged=converged,
            products=products,
            directions=tuple(a.direction for a in actions),
            loads=self.loads,
        )


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
    n, ω, closing, inverse, ratios = (
        contacts.samples, balance.omega, balance.closing, balance.inverse, balance.ratios,
    )  # fmt: skip

    def unchanged(u: np.ndarray) -> np.ndarray:
        return u

    low_harmonics = min(int(BEYOND_MODES * structure.modes[0].max() / ω[1]) + 2, n // 4)
    static = quasi_static_deflection(contacts, mean_force)
    if start is None:
        start = static
    elif isinstance(start, SteadyState):
        start = static + (start.deflection - start.quasi_static)
    d_hat = _lines(np.asarray(start, dtype=float))
    found = balance.at(d_hat)
    size = balance.size(found)
    iterations = stuck = products = 0
    while size > tolerance and iterations < MAX_NEWTON and stuck < MAX_STALLED and (most is None or products < most):
        tangent, tangents = balance.tangents(found.closed)
        k_mean = float(tangent.mean()) or float(contacts.stiffness.mean())
        precondition = 1 / (k_mean * closing + inverse)
        to_closing = closing * precondition

        def jacobian(u, to_closing=to_closing, varying=tangent - k_mean, tangents=tangents):
            """The residual's change for the change P·u of d; u itself where the stiffness is k̄ throughout."""
            nonlocal products
            products += 1
            change = irfft(to_closing * u, n, norm="forward")
            out = u + _lines(varying * change)
            for weighted, ratio in zip(tangents, ratios, strict=True):
                out += ratio * _lines(weighted * change)
            return out

        coarse: Map = unchanged
        if low_harmonics <= MAX_LOW_HARMONICS and tangent.min() < 0.2 * k_mean:
            terms = [(np.ones(ω.size), tangent - k_mean), *zip(ratios, tangents, strict=True)]
            coarse = low_harmonic_inverse(terms, to_closing, low_harmonics)

        forcing = min(1e-2, max(0.1 * size, 0.1 * tolerance / size))

        def preconditioned(u: np.ndarray, A: Map = jacobian, M: Map = coarse) -> np.ndarray:
            return A(M(u))

        correction = precondition * coarse(gmres(preconditioned, -found.residual, forcing))
        step = 1.0
        for _ in range(MAX_HALVINGS):
            trial = balance.at(d_hat + step * correction)
            gain = np.linalg.norm(trial.residual) / np.linalg.norm(found.residual)
            if gain < 1:
                break
            step /= 2
        stuck = stuck + 1 if gain >= 0.9 else 0
        d_hat = d_hat + step * correction
        found = trial
        size = balance.size(found)
        iterations += 1
    return balance.state(d_hat, found, static, iterations, size <= tolerance, products)
