"""The harmonic balance and the time integration are two ways to the same motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.dynamics_cases import (
    FOURTEEN,
    PRIOR,
    TEN,
    contacts,
    lines_of_last,
    model,
    relative,
    steady,
    torques,
    worn,
)
from twin.dynamics.contact_loss import solve_through_contact_loss
from twin.dynamics.harmonic_balance import Action, Contacts, solve
from twin.dynamics.hunting import HuntingPeriod
from twin.dynamics.integrator import integrate, modal_start, steady_start
from twin.dynamics.mesh import PairMesh
from twin.errors import ParameterError
from twin.model import Condition

STRUCTURE = model().structure
Y6 = model().accelerometer[None, :]
DEEP = 270e-6


def run_from_rest(table: Contacts, condition: Condition, seconds: float):
    """A motion that starts at rest and has had time to settle: the mode at 21.77 Hz is hardly damped."""
    return integrate(STRUCTURE, table, torques(condition), round(seconds / table.period) * table.period, Y6)


def assert_same_acceleration(table: Contacts, condition: Condition, seconds: float, count: int = 10):
    """First harmonics of y6 within 1e-4 of the largest, from rest; returns the steady state."""
    found = steady(table, condition)
    steps = table.samples // 2
    motion = run_from_rest(table, condition, seconds)
    integrated = lines_of_last(motion, steps, count)
    a_period_before = 2 * np.fft.rfft(motion.acceleration[-2 * steps - 1 : -steps - 1, 0])[1 : count + 1] / steps
    assert relative(a_period_before, integrated) < 1e-6, "not settled"
    assert relative(model().acceleration_lines(found)[:count], integrated) < 1e-4
    return found


@pytest.mark.slow
def test_worn_smooth_profile_at_10_hz():
    assert_same_acceleration(contacts(worn(TEN, 50e-6), TEN, 1024), TEN, 25)


@pytest.mark.slow
def test_contact_loss_after_deep_wear():
    found = assert_same_acceleration(contacts(worn(FOURTEEN, DEEP), FOURTEEN, 2048), FOURTEEN, 12)
    assert found.contact_loss > 0.15


@pytest.mark.slow
@pytest.mark.parametrize("condition", [TEN, FOURTEEN])
@pytest.mark.parametrize("depth", [0.0, 50e-6])
def test_unworn_and_worn_at_two_conditions(condition, depth):
    assert_same_acceleration(contacts(worn(condition, depth), condition, 2048), condition, 25)


@pytest.mark.slow
def test_contact_loss_at_a_low_torque():
    condition = Condition(speed_hz=20.0, torque=1.0)
    found = assert_same_acceleration(contacts(worn(FOURTEEN, 20e-6), condition, 2048), condition, 15)
    assert found.contact_loss > 0.04


@pytest.mark.slow
def test_back_flanks_that_hit_after_contact_loss():
    condition = Condition(speed_hz=60.0, torque=1.0)
    mesh = PairMesh.of(replace(model().mesh.pair, backlash=2e-6), 2048)
    table = mesh.contacts(worn(FOURTEEN, 20e-6), condition.speed_hz, damping_time=PRIOR.damping_time)
    found = assert_same_acceleration(table, condition, 4)
    assert found.contact_forces[3:].max() > 100.0
    assert found.mesh_force.min() < -100.0
    assert found.contact_loss > 0.4


@pytest.mark.slow
def test_motion_that_the_harmonic_balance_does_not_find_does_not_repeat():
    """Rattle at a small torque far above resonance; the integration from rest says the same."""
    condition = Condition(speed_hz=40.0, torque=0.3)
    table = contacts(worn(FOURTEEN, 20e-6), condition, 1024)
    assert not solve_through_contact_loss(STRUCTURE, table, model().mean_force(condition)).converged
    motion = run_from_rest(table, condition, 10)
    deflection = motion.deflection[:-1].reshape(-1, 512)[-400:, 0]
    assert np.ptp(deflection) > 1e-6


@pytest.mark.slow
def test_forces_that_also_act_along_another_direction():
    """Friction is of this kind: a share of each contact's force that changes its sign at the pitch point."""
    mesh = model(1024).mesh
    plain = contacts(worn(TEN, 50e-6), TEN, 1024)
    weight = np.concatenate((0.1 * np.sign(mesh.positions), np.zeros_like(mesh.positions)))
    across = np.zeros(21)
    across[[10, 16]] = (-1.0, 1.0)
    table = replace(plain, actions=(Action(direction=across, weight=weight),))
    found = assert_same_acceleration(table, TEN, 25)
    without = steady(plain, TEN)
    assert relative(model().acceleration_lines(found)[:10], model().acceleration_lines(without)[:10]) > 1e-3


@pytest.mark.slow
def test_hunting_period_with_an_eccentric_gear():
    hunting = HuntingPeriod.of(model().mesh, samples=1024)

    def eccentric_gear(passages):
        e, θ = 20e-6, passages.gear_angle
        return passages.side * e * np.cos(θ), -passages.side * e * np.sin(θ) * 19 / 52

    table = hunting.contacts(worn(TEN, 50e-6), TEN.speed_hz, (eccentric_gear,), damping_time=PRIOR.damping_time)
    found = steady(table, TEN)
    motion = run_from_rest(table, TEN, 5 * table.period)
    k = np.array([19, 988 - 19, 988, 988 + 19, 2 * 988, 3 * 988 - 19, 3 * 988, 4 * 988, 5 * 988, 10 * 988])
    integrated = lines_of_last(motion, table.samples // 2, k.max())[k - 1]
    assert relative(model().acceleration_lines(found)[k - 1], integrated) < 1e-4
    errors = np.diff(motion.deflection[-table.samples // 2 - 1 :: table.samples // 2])
    assert np.abs(errors).max() < 1e-9


@pytest.mark.slow
def test_integrator_follows_lsoda_on_equations_in_physical_coordinates():
    """A mesh period of a transient; M, C, K, and contacts from the geometry at every instant."""
    n, condition = 4096, FOURTEEN
    profile = worn(condition, 50e-6)
    table, twin = contacts(profile, condition, n), model(n)
    mesh, s, τ = twin.mesh, twin.structure, PRIOR.damping_time
    speed = mesh.pair.base_pitch / table.period
    inverse = 1 / np.diag(s.mass)
    load = torques(condition)

    def derivative(t, state):
        q, v = state[:21], state[21:]
        position = (speed * t + mesh.pair.base_pitch / 2) % mesh.pair.base_pitch - mesh.pair.base_pitch / 2
        position = position + mesh.pair.base_pitch * np.array([-1.0, 0.0, 1.0])
        gap, gap_slope = mesh.corner(position)
        depth, depth_slope = profile.at(position)
        δ = s.mesh @ q - gap - depth
        δ_rate = s.mesh @ v - speed * (gap_slope + depth_slope)
        force = np.sum(mesh.stiffness(position) * np.maximum(0.0, δ + τ * δ_rate))
        return np.concatenate((v, inverse * (load - s.mesh * force - s.damping @ v - s.stiffness @ q)))

    η, rate = steady_start(s, steady(table, condition), load)
    η = modal_start(s, float(s.mesh @ s.modes[1] @ η) * 0.3)[0] + η * 0.7  # a good way off the steady state
    Φ = s.modes[1]
    duration = table.period
    motion = integrate(s, table, load, duration, Y6, start=(η, rate))
    times = motion.time[::64]
    lsoda = solve_ivp(
        derivative, (0, times[-1]), np.concatenate((Φ @ η, Φ @ rate)), "LSODA", times, rtol=1e-8, atol=1e-13
    )
    expected = np.array([Y6[0] @ derivative(t, x)[21:] for t, x in zip(times, lsoda.y.T, strict=True)])
    assert np.ptp(expected) > 5.0
    assert np.abs(motion.acceleration[::64, 0] - expected).max() < 1e-3 * np.abs(expected).max()
    assert np.abs(motion.deflection[::64] - s.mesh @ lsoda.y[:21]).max() < 1e-4 * np.ptp(motion.deflection)


def test_runge_kutta_converges_with_order_four_where_the_contact_is_smooth():
    def end(n: int) -> float:
        x = 2 * np.pi * np.arange(n) / n
        table = Contacts(
            stiffness=2.7e8 * (1 + 0.2 * np.cos(x))[None, :],
            separation=1e-7 * np.sin(x)[None, :],
            separation_rate=1e-7 * 2 * np.pi * 190 * np.cos(x)[None, :],
            side=np.array([1.0]),
            damping_time=PRIOR.damping_time,
            period=1 / 190,
        )
        η, rate = steady_start(STRUCTURE, solve(STRUCTURE, table, 560.0), torques(TEN))
        start = 1.001 * η, 1.1 * rate
        return integrate(STRUCTURE, table, torques(TEN), 3 / 190, Y6, start=start).deflection[-1]

    samples = np.array([512, 1024, 2048])
    reference = end(8192)
    errors = [abs(end(n) - reference) for n in samples]
    assert -np.polyfit(np.log(samples), np.log(errors), 1)[0] == pytest.approx(4, abs=0.2)


def test_step_that_cannot_be_stable_is_refused():
    table = contacts(model(64).unworn, TEN, 64)
    with pytest.raises(ParameterError, match=r"too long for the fastest mode at \d+ Hz"):
        integrate(STRUCTURE, table, torques(TEN), 0.01, Y6)


def test_transient_from_a_steady_state_stays_there():
    table = contacts(worn(TEN, 50e-6), TEN, 1024)
    found = steady(table, TEN)
    start = steady_start(STRUCTURE, found, torques(TEN))
    motion = integrate(STRUCTURE, table, torques(TEN), 20 * table.period, Y6, start=start)
    expected = found.deflection[::2]
    assert np.abs(motion.deflection[:-1].reshape(20, -1) - expected).max() < 1e-3 * np.ptp(expected)


def test_slow_run_up_passes_through_the_steady_states():
    table = contacts(worn(TEN, 50e-6), TEN, 512)
    start = steady_start(STRUCTURE, steady(table, TEN), torques(TEN))
    rate, seconds = 0.01, 4.0  # 1 % a second
    motion = integrate(
        STRUCTURE, table, torques(TEN), seconds, Y6, samples_per_step=1.0, speed_change=rate, start=start
    )
    reached = replace(TEN, speed_hz=TEN.speed_hz * (1 + rate * 3.9))
    expected = steady(contacts(worn(TEN, 50e-6), reached, 512), reached)
    last = motion.acceleration[motion.time > 3.8, 0]
    everywhere = (0.0, 1e5)
    assert np.std(last) == pytest.approx(model().acceleration_rms(expected, everywhere), rel=0.02)
