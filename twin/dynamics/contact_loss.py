"""Steady states behind contact loss, by following a branch of solutions from a problem that is easily solved.

Newton's method often fails where contacts open for a part of the period. With the corner of max(0, x) rounded to
(x + sqrt(x² + ε²))/2 over ε of many times the contacts' deflection hardly any contact is ever lost, and there is one
solution. From there the branch (d̂, ln ε) is followed by its arc length, which passes its folds, until ε is so small
that the sharp corner itself converges. A branch that begins at a single regular solution and stays bounded reaches
the sharp corner.

What is found there may be a motion that no machine keeps: its Floquet multipliers decide (twin/dynamics/stability.py).
Then the equations are integrated from a motion near it, and where that settles is the steady state; where it does not
settle, there is none.

Source   pseudo-arclength continuation: H. B. Keller, in P. H. Rabinowitz (ed.), Applications of Bifurcation Theory,
         Academic Press 1977, 359–384; E. L. Allgower, K. Georg, Introduction to Numerical Continuation Methods,
         SIAM 2003, ch. 2 and 11
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf, log

import numpy as np

from twin.closed_forms import resampled
from twin.compiled import to_lines, to_samples
from twin.dynamics.harmonic_balance import TOLERANCE, Balance, Contacts, Load, SteadyState, solve
from twin.dynamics.integrator import integrate, longest_step, steady_start
from twin.dynamics.stability import largest_multiplier
from twin.dynamics.structure import Structure

WIDEST = 30.0  # ε at the start, of F/k̄
SHARP = 3e-3  # ε below which the sharp corner is tried, of F/k̄
NARROWEST = 1e-5  # ε at which the branch is given up, of F/k̄
MAX_STEPS = 200  # along the branch
MAX_CORRECTIONS = 6  # of one step
FARTHEST = 10.0  # change of ln ε at which the corrections of one step have left the branch
EASY = 3  # corrections up to which the next step is longer
NEAR = 1e-6  # largest residual of a point on the branch, of the mean force
FIRST, LONGEST, SHORTEST = 0.5, 2.0, 1e-3  # steps along the branch
STRAIGHT = 0.7  # least cosine between the directions of the branch at the ends of a step
LINEAR = 1e-3  # relative residual of the linear solutions
MANY = 40  # products of two linear solutions from which the low harmonics are inverted anew
LONG, MAX_LONG = 8192, 1200  # samples of a period from which a search may take so many products with its Jacobian
STABLE = 1.0 + 1e-3  # largest Floquet multiplier of a motion that lasts
ROUNDS, ROUND = 4, 250  # stretches of integration, and periods of each
AWAY = 0.01  # share of the rates by which a motion begins beside the steady state that it leaves


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Point:
    """A point of the branch, and where the branch goes on from there."""

    d_hat: np.ndarray  # (n//2 + 1,)
    log_rounding: float  # ln ε
    slope: np.ndarray  # ∂d̂/∂ln ε (n//2 + 1,)
    forward: float  # +1 where the arc length grows with ln ε, else −1


def solve_through_contact_loss(
    structure: Structure,
    contacts: Contacts,
    mean_force: float,
    *,
    loads: tuple[Load, ...] = (),
    start: np.ndarray | SteadyState | None = None,
    tolerance: float = TOLERANCE,
) -> SteadyState:
    """As `solve`; where that fails, by the branch from rounded contacts.

    Over many mesh periods the search is cut short: where it is that long, it hardly ever converges. Motions that do
    not last count as not converged; where there are loads, or the period is that long, no other motion is sought.
    """
    room = MAX_LONG if contacts.samples > LONG else None
    steady = solve(structure, contacts, mean_force, loads=loads, start=start, tolerance=tolerance, most=room)
    if steady.converged:
        return steady
    left = None if room is None else room - steady.products
    found = Branch(structure, contacts, mean_force, loads, tolerance, left).sharp()
    if found is None:
        return steady
    if largest_multiplier(structure, contacts, found) <= STABLE:
        return found
    settled = None if loads or room is not None else _settled(structure, contacts, mean_force, found, tolerance)
    return replace(found, converged=False) if settled is None else settled


def _settled(
    structure: Structure, contacts: Contacts, mean_force: float, left: SteadyState, tolerance: float
) -> SteadyState | None:
    """The lasting steady state at which a motion settles that begins near another; None where it settles at none."""
    load = mean_force * structure.mesh  # balances the mean mesh force without another deflection
    displacement, rate = steady_start(structure, left, load)
    state, per_step = (displacement, (1 + AWAY) * rate), 2.0
    while per_step * contacts.period / contacts.samples > 0.5 * longest_step(structure, contacts):
        per_step /= 2
    length, seen, steps = ROUND * contacts.period, structure.mesh[None, :], round(contacts.samples / per_step)
    for _ in range(ROUNDS):
        motion = integrate(structure, contacts, load, length, seen, samples_per_step=per_step, start=state)
        state = motion.modal
        start = resampled(motion.deflection[-steps - 1 : -1], contacts.samples)
        found = solve(structure, contacts, mean_force, start=start, tolerance=tolerance)
        if found.converged and largest_multiplier(structure, contacts, found) <= STABLE:
            return found
    return None


class Branch:
    """The solutions of one period's balance with ever sharper contacts."""

    def __init__(
        self,
        structure: Structure,
        contacts: Contacts,
        mean_force: float,
        loads: tuple[Load, ...],
        tolerance: float,
        room: int | None,
    ) -> None:
        self._problem = (structure, contacts, mean_force)
        self._loads, self._tolerance, self._room = loads, tolerance, inf if room is None else room
        self._unit = mean_force / float(contacts.stiffness.mean())  # F/k̄ [m]
        self._low: np.ndarray | None = None

    def sharp(self) -> SteadyState | None:
        """The solution with sharp corners at the end of the branch; None where it is not reached."""
        rounding = WIDEST * self._unit
        first = self._solved(None, tolerance=NEAR, rounding=rounding)
        if not first.converged:
            return None
        d_hat = to_lines(first.deflection)
        _, _, slope = self._linear(d_hat, log(rounding))
        point = Point(d_hat=d_hat, log_rounding=log(rounding), slope=slope, forward=-1.0)
        length, tried = FIRST, log(SHARP * self._unit)
        for _ in range(MAX_STEPS):
            following, corrections = self._next(point, length)
            if following is None:
                length /= 2
                if length < SHORTEST or self._room <= 0:
                    return None
                continue
            if corrections <= EASY:
                length = min(1.5 * length, LONGEST)
            point = following
            if point.log_rounding < tried:
                found = self._solved(to_samples(point.d_hat), tolerance=self._tolerance)
                if found.converged:
                    return found
                tried = point.log_rounding - log(4.0)
            if not log(NARROWEST * self._unit) < point.log_rounding < log(2 * WIDEST * self._unit):
                return None
        return None

    def _solved(self, start: np.ndarray | None, *, tolerance: float, rounding: float = 0.0) -> SteadyState:
        """By Newton's method, within the products that are left."""
        most = None if self._room == inf else max(int(self._room), 0)
        found = solve(
            *self._problem, loads=self._loads, start=start, tolerance=tolerance, rounding=rounding, most=most
        )  # fmt: skip
        self._room -= found.products
        return found

    def _linear(self, d_hat: np.ndarray, log_rounding: float) -> tuple[float, np.ndarray, np.ndarray]:
        """Residual of the mean force, Newton's step at a fixed ε, and ∂d̂/∂ln ε."""
        balance = Balance(*self._problem, self._loads, exp(log_rounding))
        done, step, slope, self._low = balance.along_branch(d_hat, self._low, LINEAR)
        self._room -= done.products
        if done.products > MANY:
            self._low = None
        return done.residual, step, slope

    def _next(self, point: Point, length: float) -> tuple[Point | None, int]:
        """The point an arc length further on, and the corrections that it took; None where they did not converge."""
        scale = point.forward / np.sqrt(self._inner(point.slope, point.slope) + 1)
        along, along_log = scale * point.slope, scale
        d_hat, log_rounding = point.d_hat + length * along, point.log_rounding + length * along_log
        before = inf
        for correction in range(MAX_CORRECTIONS + 1):
            if abs(log_rounding - point.log_rounding) > FARTHEST:
                break
            size, step, slope = self._linear(d_hat, log_rounding)
            if size <= NEAR:
                cosine = (self._inner(along, slope) + along_log) / np.sqrt(self._inner(slope, slope) + 1)
                if abs(cosine) < STRAIGHT:
                    break
                return Point(
                    d_hat=d_hat, log_rounding=log_rounding, slope=slope, forward=1.0 if cosine > 0 else -1.0
                ), correction
            if size > 10 * before or self._room <= 0:
                break
            before = size
            change = -self._inner(along, step) / (self._inner(along, slope) + along_log)
            d_hat, log_rounding = d_hat + step + change * slope, log_rounding + change
        return None, MAX_CORRECTIONS

    def _inner(self, a: np.ndarray, b: np.ndarray) -> float:
        """Of two changes of d̂, in units of F/k̄."""
        return float(np.vdot(a, b).real) / self._unit**2
