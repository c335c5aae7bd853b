"""Steady states behind contact loss: found along a branch, and kept only where a machine would keep them."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.linalg import expm

from tests.dynamics_cases import PRIOR, TEN, contacts, lines_of_last, model, relative, steady, worn
from twin.compiled import monodromy
from twin.dynamics.contact_loss import Branch, solve_through_contact_loss
from twin.dynamics.harmonic_balance import TOLERANCE, Contacts, solve
from twin.dynamics.integrator import integrate, steady_start
from twin.dynamics.stability import floquet_multipliers, largest_multiplier
from twin.model import Condition
from twin.wear.curve import MasterCurve
from twin.wear.evolution import LAST_STEPS
from twin.wear.profile import WornProfile

FAST = Condition(speed_hz=40.0, torque=10.0)
LIGHT = Condition(speed_hz=60.0, torque=5.0)
STRUCTURE = model().structure


@lru_cache(maxsize=1)
def beyond_the_last(condition: Condition) -> WornProfile:
    """Flanks a little deeper than the deepest with a steady state on the way from new."""
    curve = MasterCurve.build(model(), condition, model().unworn, 200e-6)
    assert not curve.complete
    return curve.profile(curve.valid_to + LAST_STEPS)


# -- multipliers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("square", [0.3, 0.9])
@pytest.mark.parametrize("period", [1.0, 3.0, 3.5])
def test_multipliers_of_meissners_equation(square, period):
    """x'' + (1 ± κ)·x = 0, the sign changing after half a period: closed form of the trace (E. Meissner, 1918)."""
    n = 4096
    impulses = square * period / n * np.where(np.arange(n) < n / 2, 1.0, -1.0)
    step = expm(period / n * np.array([[0.0, 1.0], [-1.0, 0.0]]))
    found = monodromy(step[None], np.ones((1, 1)), impulses[None], 0.0)
    a, b, half = np.sqrt(1 + square), np.sqrt(1 - square), period / 2
    expected = 2 * np.cos(a * half) * np.cos(b * half) - (a / b + b / a) * np.sin(a * half) * np.sin(b * half)
    assert np.trace(found) == pytest.approx(expected, abs=5 * (period / n) * period)  # the jumps are off by half a step
    assert np.linalg.det(found) == pytest.approx(1.0, abs=1e-9)


def test_multipliers_under_a_constant_stiffness_are_those_of_its_modes():
    """The error of the splitting falls with the square of the step."""
    k, τ, period = 3e8, PRIOR.damping_time, 1 / 190
    ω, Φ = STRUCTURE.modes
    g = Φ.T @ STRUCTURE.mesh
    A = np.zeros((42, 42))
    A[:21, 21:] = np.eye(21)
    A[21:, :21] = -np.diag(ω**2) - k * np.outer(g, g)
    A[21:, 21:] = -np.diag(STRUCTURE.modal_damping_terms) - k * τ * np.outer(g, g)
    expected = np.linalg.eigvals(expm(period * A))
    errors = []
    for n in (1024, 4096):
        one = np.ones((1, n))
        table = Contacts(stiffness=k * one, separation=0 * one, separation_rate=0 * one, side=np.ones(1),
                         damping_time=τ, period=period)  # fmt: skip
        state = solve(STRUCTURE, table, 500.0)
        found = floquet_multipliers(STRUCTURE, table, state)
        errors.append(max(np.abs(found - multiplier).min() for multiplier in expected))
        assert largest_multiplier(STRUCTURE, table, state) < 1
    assert errors[1] < errors[0] / 8


def departure(state, table, condition, periods):
    """How far d is from a steady state after so many periods, begun 1e-4 beside it, in the sample at t = 0."""
    load = model().mean_force(condition) * STRUCTURE.mesh
    displacement, rate = steady_start(STRUCTURE, state, load)
    seen, length = STRUCTURE.mesh[None, :], periods * table.period
    first, beside = (
        integrate(STRUCTURE, table, load, length, seen, start=(displacement, share * rate)).deflection
        for share in (1.0, 1.0 + 1e-4)
    )
    return np.abs(beside - first)[:: table.samples // 2]


@pytest.mark.slow
def test_departures_grow_or_die_away_as_the_largest_multiplier_says():
    """By time integration of the unreduced contacts, which knows nothing of multipliers."""
    lasting = contacts(worn(FAST, 40e-6), FAST, 1024)
    state = solve_through_contact_loss(STRUCTURE, lasting, model().mean_force(FAST)).require_converged()
    assert state.contact_loss > 0
    away = departure(state, lasting, FAST, 3000)
    assert largest_multiplier(STRUCTURE, lasting, state) < 1
    assert away[-100:].max() < 0.1 * away[:100].max()

    table = contacts(beyond_the_last(FAST), FAST, 1024)
    other = Branch(STRUCTURE, table, model().mean_force(FAST), (), TOLERANCE, None).sharp()
    assert other is not None and other.converged
    largest = largest_multiplier(STRUCTURE, table, other)
    assert largest > 1.5
    away = departure(other, table, FAST, 8)
    assert away[3] > 10 * away[1]  # a multiplier of about 7 a period, until the contacts bound it


# -- the branch ----------------------------------------------------------------------------------------


def test_the_branch_leads_to_the_state_that_newtons_method_finds():
    table, force = contacts(worn(TEN, 50e-6), TEN, 512), model().mean_force(TEN)
    expected = solve(STRUCTURE, table, force)
    found = Branch(STRUCTURE, table, force, (), TOLERANCE, None).sharp()
    assert found is not None
    assert relative(found.deflection, expected.deflection) < 1e-7


@pytest.mark.slow
def test_states_that_newtons_method_does_not_find_are_those_of_time_integration():
    """The gears part for a large share of the mesh; of the solutions there the machine keeps one."""
    condition = LIGHT
    table = contacts(worn(condition, 30e-6), condition, 1024)
    assert not solve(STRUCTURE, table, model().mean_force(condition)).converged
    found = steady(table, condition)
    assert found.contact_loss > 0.2
    load = model().mean_force(condition) * STRUCTURE.mesh
    motion = integrate(STRUCTURE, table, load, 6000 * table.period, model().accelerometer[None, :])
    integrated = lines_of_last(motion, table.samples // 2, 10)
    assert relative(model().acceleration_lines(found)[:10], integrated) < 1e-3


@pytest.mark.slow
def test_a_motion_that_does_not_last_is_no_steady_state():
    table = contacts(beyond_the_last(FAST), FAST, 1024)
    assert not solve_through_contact_loss(STRUCTURE, table, model().mean_force(FAST)).converged
    load = model().mean_force(FAST) * STRUCTURE.mesh
    motion = integrate(STRUCTURE, table, load, 6000 * table.period, STRUCTURE.mesh[None, :])
    seen = motion.deflection[:: table.samples // 2][-300:]
    assert np.ptp(seen) > 1e-6  # d at the same phase of the mesh differs from period to period


@pytest.mark.slow
def test_less_damping_is_no_obstacle():
    table = replace(contacts(worn(FAST, 60e-6), FAST, 1024), damping_time=0.1 * PRIOR.damping_time)
    found = Branch(STRUCTURE, table, model().mean_force(FAST), (), TOLERANCE, None).sharp()
    assert found is not None and found.converged
