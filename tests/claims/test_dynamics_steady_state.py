"""What any steady state of the gearbox must keep: forces, energy, the equation of motion, simple limits."""

from dataclasses import replace

import numpy as np
import pytest

from tests.dynamics_cases import FOURTEEN, PRIOR, TEN, contacts, model, relative, steady, torques, wear_path, worn
from twin.dynamics.harmonic_balance import Action, Contacts, Load, quasi_static_deflection, solve
from twin.dynamics.integrator import steady_start
from twin.dynamics.structure import direction
from twin.effects import EFFECTS
from twin.effects.response import solve_with
from twin.errors import NotConverged, ParameterError
from twin.model import Condition

DEEP = 270e-6  # contact is lost for a fifth of the mesh period
STATES = [(TEN, 0.0), (TEN, 50e-6), (FOURTEEN, 50e-6), (FOURTEEN, DEEP)]
STRUCTURE = model().structure


def lines(values: np.ndarray) -> np.ndarray:
    return np.fft.rfft(values) / values.size


def one_contact(n: int, stiffness: np.ndarray, separation: np.ndarray, **more) -> Contacts:
    """A single pair, 190 times a second."""
    ω = 2 * np.pi * 190
    rate = np.fft.irfft(1j * ω * np.arange(n // 2 + 1) * np.fft.rfft(separation), n)
    return Contacts(
        stiffness=np.broadcast_to(stiffness, (1, n)).copy(),
        separation=separation[None, :],
        separation_rate=rate[None, :],
        side=np.array([1.0]),
        damping_time=PRIOR.damping_time,
        period=1 / 190,
        **more,
    )


@pytest.mark.parametrize(("condition", "depth"), STATES)
def test_mean_mesh_force_is_the_torque_over_the_base_radius(condition, depth):
    found = steady(contacts(worn(condition, depth), condition, 1024), condition)
    expected = condition.torque / model().mesh.pair.base_radius[0]
    assert found.mesh_force.mean() == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("condition", "depth"), STATES)
def test_solution_obeys_the_equation_of_motion_in_physical_coordinates(condition, depth):
    found = steady(contacts(worn(condition, depth), condition, 1024), condition)
    s, F, d = STRUCTURE, lines(found.mesh_force), lines(found.deflection)
    for k in (1, 2, 3, 4, 7, 10, 40, 200):
        ω = found.omega[k]
        q = np.linalg.solve(-(ω**2) * s.mass + 1j * ω * s.damping + s.stiffness, -s.mesh * F[k])
        G = s.receptance(found.omega[k : k + 1], s.mesh, s.mesh)[0]
        assert abs((s.mesh @ q - d[k]) / G) <= 1e-8 * F[0].real, f"harmonic {k}, as a force"


@pytest.mark.parametrize(("condition", "depth"), STATES)
def test_power_that_the_structure_takes_from_the_mesh_is_what_its_damping_dissipates(condition, depth):
    found = steady(contacts(worn(condition, depth), condition, 1024), condition)
    rate = np.fft.irfft(1j * found.omega * np.fft.rfft(found.deflection), found.deflection.size)
    taken = -np.mean(found.mesh_force * rate)
    ω = found.omega[1:]
    velocities = np.array([1j * ω * found.lines(STRUCTURE, e) for e in np.eye(21)])
    dissipated = 0.5 * np.einsum("ik,ij,jk->", velocities.conj(), STRUCTURE.damping, velocities).real
    assert taken == pytest.approx(dissipated, rel=1e-6)
    assert dissipated > 0


@pytest.mark.parametrize(("condition", "depth"), [(TEN, 50e-6), (FOURTEEN, 50e-6)])
def test_power_from_the_rotation_is_dissipated_by_modes_and_contacts_together(condition, depth):
    """Σ F·e' + ½Σ k'·δ² comes in through the flanks' shape and the changing stiffness, nothing is left over."""
    n = 4096
    table = contacts(worn(condition, depth), condition, n)
    found = steady(table, condition)
    along_s = np.argsort(model(n).mesh.phase, kind="stable")  # then the rows follow each other as one pair

    def passage(rows: np.ndarray) -> np.ndarray:
        return rows[:3, along_s].ravel()

    rate = np.fft.irfft(1j * found.omega * np.fft.rfft(found.deflection), n)
    k, F = passage(table.stiffness), passage(found.contact_forces)
    δ = passage(found.deflection + table.separation[:3])
    e_rate = passage(table.separation_rate)
    δ_rate = passage(rate + table.separation_rate[:3])
    k_rate = np.gradient(k, table.period / n)
    closed = F > 0
    came_in = (F * e_rate + closed * 0.5 * k_rate * δ**2).sum() / n
    in_modes = -np.mean(found.mesh_force * rate)
    in_contacts = (closed * k * table.damping_time * δ_rate**2).sum() / n
    changes = np.diff(closed.astype(int))
    opened, shut = np.flatnonzero(changes < 0), np.flatnonzero(changes > 0) + 1
    stored = 0.5 * k * δ**2  # a damped contact opens before it is slack, and shuts before it is tight
    in_contacts += (stored[opened].sum() - stored[shut].sum()) / table.period
    assert found.contact_forces[3:].max() == 0
    assert came_in == pytest.approx(in_modes + in_contacts, rel=5e-3)
    assert in_contacts > 0


def test_rate_of_separation_is_the_derivative_of_separation_on_both_flanks():
    n = 8192
    table = contacts(worn(TEN, 50e-6), TEN, n)
    e, step = table.separation, table.period / n
    slope = (e[:, 2:] - e[:, :-2]) / (2 * step)
    mesh = model(n).mesh
    s = np.concatenate((mesh.positions, mesh.back_positions))
    same_pair = np.abs(s[:, 2:] - s[:, :-2]) < 0.5 * mesh.pair.base_pitch
    smooth = same_pair & (e[:, 2:] > -5e-4) & (e[:, :-2] > -5e-4)
    assert smooth[:3].mean() > 0.5 and smooth[3:].mean() > 0.5
    rate = table.separation_rate[:, 1:-1]
    assert np.abs(slope - rate)[smooth].max() < 2e-3 * np.abs(rate[smooth]).max()


def test_deflection_of_even_stiffness_without_error_is_constant_and_nothing_vibrates():
    found = solve(STRUCTURE, one_contact(256, np.array(2.7e8), np.zeros(256)), 560.0)
    assert found.converged
    assert found.deflection == pytest.approx(560.0 / 2.7e8, rel=1e-9)
    assert np.abs(found.lines(STRUCTURE, direction({"y6": 1.0}))).max() < 1e-15


def test_error_on_even_stiffness_moves_the_gears_as_linear_theory_says():
    """F_k = k(1 + iωτ)(d_k + e_k) and d_k = −G·F_k together, in closed form."""
    n, k = 256, 2.7e8
    e = 0.3e-6 * np.cos(2 * np.pi * np.arange(n) / n) + 0.1e-6 * np.sin(6 * np.pi * np.arange(n) / n)
    found = solve(STRUCTURE, one_contact(n, np.array(k), e), 560.0)
    ω = found.omega[1:8]
    G = STRUCTURE.receptance(ω, STRUCTURE.mesh, STRUCTURE.mesh)
    complex_stiffness = k * (1 + 1j * ω * PRIOR.damping_time)
    expected = complex_stiffness * lines(e)[1:8] / (1 + complex_stiffness * G)
    assert lines(found.mesh_force)[1:8] == pytest.approx(expected, abs=1e-7 * np.abs(expected).max())


def test_load_beside_a_closed_mesh_moves_the_gears_as_the_closed_structure_does():
    n, k = 256, 2.7e8
    torque = np.zeros(n // 2 + 1, dtype=complex)
    torque[2] = 0.05 - 0.02j
    load = Load(direction=direction({"th1": 1.0}), lines=torque)
    found = solve(STRUCTURE, one_contact(n, np.array(k), np.zeros(n)), 560.0, loads=(load,))
    s, ω = STRUCTURE, found.omega[2]
    gg = np.outer(s.mesh, s.mesh) * k * (1 + 1j * ω * PRIOR.damping_time)
    q = np.linalg.solve(-(ω**2) * s.mass + 1j * ω * s.damping + s.stiffness + gg, load.direction * 2 * torque[2])
    response = direction({"th8": 1.0})
    assert found.lines(s, response)[1] == pytest.approx(response @ q, rel=1e-7)


def test_action_along_the_mesh_direction_adds_to_the_mesh_force():
    """Contacts that act on the structure by another tenth of their force stiffen it as a tenth more would."""
    n = 256
    weight = np.full((1, n), 0.1)
    e = 0.3e-6 * np.cos(2 * np.pi * np.arange(n) / n)
    plain = one_contact(n, np.array(2.7e8), e)
    acting = replace(plain, actions=(Action(direction=STRUCTURE.mesh, weight=weight),))
    stiffer = replace(plain, stiffness=1.1 * plain.stiffness)
    response = direction({"y6": 1.0})
    found, expected = solve(STRUCTURE, acting, 560.0), solve(STRUCTURE, stiffer, 616.0)
    assert relative(found.lines(STRUCTURE, response), expected.lines(STRUCTURE, response)) < 1e-9


def test_slow_gears_move_as_without_inertia():
    slow = replace(TEN, speed_hz=0.01)
    table = contacts(worn(TEN, 50e-6), slow, 1024)
    found = steady(table, slow)
    expected = quasi_static_deflection(table, model().mean_force(slow))
    assert np.abs(found.deflection - expected).max() < 2e-3 * np.ptp(expected)


@pytest.mark.parametrize(("condition", "depth"), STATES)
def test_quasi_static_deflection_balances_the_force_at_every_instant(condition, depth):
    table = contacts(worn(condition, depth), condition, 256)
    d = quasi_static_deflection(table, 500.0)
    drive = table.side > 0
    force = (table.stiffness[drive] * np.maximum(0, d + table.separation[drive])).sum(axis=0)
    assert force == pytest.approx(500.0, rel=1e-9)


def test_acceleration_converges_with_the_samples_of_a_mesh_period():
    profile = worn(TEN, 50e-6)

    def acceleration(n: int) -> np.ndarray:
        return model(n).acceleration_lines(steady(contacts(profile, TEN, n), TEN))[:10]

    reference = acceleration(16384)
    samples = [256, 512, 1024, 2048, 4096]
    errors = [relative(acceleration(n), reference) for n in samples]
    assert -np.polyfit(np.log(samples), np.log(errors), 1)[0] > 1.3
    assert errors[2] < 1e-4


def test_deep_contact_loss_is_solved_from_a_cold_start_and_from_a_neighbour_alike():
    twin, (before, deep) = model(), wear_path(FOURTEEN, DEEP)[-2:]
    cold = twin.steady(deep.profile, FOURTEEN).require_converged()
    warm = twin.steady(deep.profile, FOURTEEN, before.steady).require_converged()
    assert cold.contact_loss > 0.15
    assert np.abs(warm.deflection - cold.deflection).max() < 1e-5 * np.ptp(cold.deflection)


def test_what_did_not_converge_is_not_used():
    found = steady(contacts(worn(TEN, 0.0), TEN, 256), TEN)
    with pytest.raises(NotConverged, match=r"residual of 2\.00e-04 of the mean force after \d+ iterations"):
        replace(found, converged=False, residual=2e-4).require_converged()


def test_solution_may_be_given_up_after_so_many_products_and_tells_how_many_it_took():
    table, force = contacts(worn(TEN, 50e-6), TEN, 256), model().mean_force(TEN)
    whole = solve(STRUCTURE, table, force)
    assert whole.converged and whole.products > whole.iterations
    cut = solve(STRUCTURE, table, force, most=1)
    assert cut.iterations == 1 and not cut.converged
    assert cut.products < whole.products


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 13])
def test_lightly_loaded_teeth_that_differ_are_solved_over_the_hunting_period_on_finer_samples(seed):
    rng = np.random.default_rng(seed)
    errors = EFFECTS["pitch_error"](pinion=tuple(8e-6 * rng.normal(size=19)), gear=tuple(5e-6 * rng.normal(size=52)))
    light, orders = Condition(speed_hz=14.0, torque=3.0), 19 * np.arange(1, 6)
    found = solve_with(model(), (errors,), model().unworn, light)
    assert found.steady.converged
    finer = solve_with(model(), (errors,), model().unworn, light, samples=256)
    assert finer.steady.converged
    assert relative(found.transmission_error(orders), finer.transmission_error(orders)) < 0.02


def test_braked_pinion_is_refused():
    table = one_contact(256, np.array(2.7e8), np.zeros(256))
    with pytest.raises(ParameterError, match=r"mean_force = -1 N must be positive"):
        solve(STRUCTURE, table, -1.0)


def test_steady_start_has_the_deflection_and_its_rate():
    condition = TEN
    found = steady(contacts(worn(condition, 50e-6), condition, 1024), condition)
    rate = np.fft.irfft(1j * found.omega * np.fft.rfft(found.deflection), 1024)
    g = STRUCTURE.mesh @ STRUCTURE.modes[1]
    for sample in (0, 300):
        η, η_rate = steady_start(STRUCTURE, found, torques(condition), sample)
        assert g @ η == pytest.approx(found.deflection[sample], rel=1e-9)
        assert g @ η_rate == pytest.approx(rate[sample], abs=1e-6 * np.abs(rate).max())
