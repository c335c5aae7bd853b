"""Play, couplings, rubs and loose feet of the simulated machine against closed forms."""

from dataclasses import replace
from math import pi, tan

import numpy as np
import pytest

from recordings.generator.housing import LooseFoot, bilinear
from recordings.generator.integrate import loose_force
from recordings.generator.turning import BINS, Coupling, ShaftRub, angles
from tests.generator_instances import RATED, knobs, machine, order_amplitude, steady

ALIKE = (5e5, 5e5, 5e5)
UNLIKE = (5.4e5, 4.7e5, 5.1e5)


def line(values, k):
    """Complex amplitude at k cycles a turn of a table over one turn."""
    return 2 * np.mean(values[:-1] * np.exp(-1j * k * angles()[:-1]))


def test_a_bearing_with_play_yields_by_the_play_and_by_its_hardening_law():
    """F = s·k·δ0·(δ/δ0)^n beyond the play, found again from the force that is taken off the linear one."""
    k, play, δ0, n, share = 2e7, 30e-6, 20e-6, 1.5, 0.4
    loose = np.array([1e8, k, play, δ0, n - 1, share])
    for force in (50.0, 400.0, 900.0):
        y = play + δ0 * (force / (share * k * δ0)) ** (1 / n)
        assert k * y - loose_force(0.0, y, loose)[1] == pytest.approx(force, rel=1e-9)
    assert k * 20e-6 - loose_force(0.0, 20e-6, loose)[1] == pytest.approx(0.0, abs=1e-9)  # within the play


@pytest.mark.slow
def test_without_play_and_with_exponent_one_the_machine_is_the_linear_one():
    m, sound = machine(), knobs("loose_bearing", play_um=0.0, exponent=1.0, stiffness=1.0)
    plain, loose = (steady(m, k, 0.2) for k in (knobs(), sound))
    assert np.allclose(loose[:, 0], plain[:, 0], atol=1e-6 * plain[:, 0].std())


@pytest.mark.slow
def test_what_play_does_to_the_path_depends_on_the_load():
    m, changes = machine(), []
    loose = knobs("loose_bearing", play_um=60.0, exponent=2.0, stiffness=0.3)
    for torque in (4.0, 16.0):
        run_at = replace(RATED, torque=torque)
        levels = [steady(m, k, 0.5, run_at)[:, 0].std() for k in (knobs(), loose)]
        changes.append(levels[1] / levels[0])
    assert abs(np.log(changes[0] / changes[1])) > 0.05


def test_like_jaws_of_parallel_axes_push_with_a_steady_force():
    """n/2·k·e at rest in space: with three like jaws nothing turns."""
    e = 0.05e-3
    x, y = Coupling(e, 0.0, ALIKE, 0.025).push(10.0, angles())
    assert np.hypot(x.mean(), y.mean()) == pytest.approx(1.5 * 5e5 * e, rel=1e-6)
    assert np.ptp(x) < 1e-6 and np.ptp(y) < 1e-6


def test_unlike_jaws_push_once_a_turn_by_the_torque_and_twice_by_the_offset():
    k, R = np.array(UNLIKE), 0.025
    ψ = 2 * pi * np.arange(3) / 3
    unlike = abs(k @ np.exp(1j * ψ))
    for torque, e in ((10.0, 0.0), (20.0, 0.0), (20.0, 0.03e-3)):
        x, _ = Coupling(e, 0.0, UNLIKE, R).push(torque, angles())
        if e == 0:
            assert abs(line(x, 1)) == pytest.approx(torque / R * unlike / k.sum(), rel=1e-6)
            assert abs(line(x, 2)) < 1e-6
        else:  # Σ k·e·cos(a)·sin(a), and the same of the twist by which the jaws share: e·Σk·cos/Σk
            assert 0.3 * e * unlike < abs(line(x, 2)) < 1.2 * e * unlike


def test_a_light_load_lets_jaws_open_and_brings_as_many_cycles_a_turn_as_there_are_jaws():
    third = [abs(line(Coupling(0.2e-3, 0.0, ALIKE, 0.025).push(t, angles())[0], 3)) for t in (2.0, 40.0)]
    assert third[0] > 3.0 and third[1] < 1e-6


def test_an_angle_turns_the_shaft_as_a_hooke_joint_does():
    β = 0.05
    turning = Coupling(0.0, β, ALIKE, 0.025).turning(10.0, 0.15)
    assert abs(line(turning.twist, 2)) == pytest.approx(tan(β / 2) ** 2, rel=1e-6)
    assert abs(line(turning.forces["y4"], 2)) == pytest.approx(10.0 * tan(β) / 2 / 0.15, rel=1e-6)


@pytest.mark.slow
def test_a_misaligned_coupling_bends_the_shaft_once_and_twice_a_turn_in_the_machine():
    m = machine()
    plain = steady(m, knobs(), 0.5)
    bent = steady(m, knobs("coupling_misalignment", offset_mm=0.15, angle_deg=2.0), 0.5)
    for order in (1, 2):
        assert order_amplitude(bent, bent[:, 0], order) > 10 * order_amplitude(plain, plain[:, 0], order)
    assert bent[:, 1].mean() == pytest.approx(plain[:, 1].mean(), rel=2e-3)


@pytest.mark.slow
def test_a_rub_touches_over_its_share_of_the_turn_and_brakes_by_its_friction():
    rub = ShaftRub(40.0, 0.25, 0.0, 0.2, 0.01, 0.0).turning(10.0, 0.15)
    normal = -rub.forces["y5"]
    assert normal.max() == pytest.approx(40.0, rel=1e-4)
    assert np.mean(normal[:BINS] > 0) == pytest.approx(0.25, abs=2 / BINS)
    assert np.allclose(rub.forces["th5"], -0.2 * 0.01 * normal)
    m = machine()
    plain = steady(m, knobs(), 0.5)
    rubbed = steady(m, knobs("shaft_rub", force_n=200.0, share=0.25, roughness=0.0, friction=0.3), 0.5)
    drag = 0.3 * 0.01 * ShaftRub(200.0, 0.25, 0.0, 0.3, 0.01, 0.0).turning(10.0, 0.15).forces["y5"][:BINS].mean()
    assert rubbed[:, 4].mean() == pytest.approx(plain[:, 4].mean(), rel=0.01)  # the brake still takes its load
    assert rubbed[:, 1].mean() - plain[:, 1].mean() == pytest.approx(-drag, rel=0.15)


def test_a_bilinear_oscillator_swings_half_a_period_at_either_stiffness():
    mass, frequency, share, dt = 10.0, 40.0, 0.09, 1e-5
    k = mass * (2 * pi * frequency) ** 2
    out = bilinear(np.zeros(60000), dt, mass, k, 0.0, share, 0.0, 0.0, 1.0)
    rising = np.flatnonzero((out[:-1] < 0) & (out[1:] >= 0))
    found = 1 / (np.diff(rising).mean() * dt)
    soft = frequency * np.sqrt(share)
    assert found == pytest.approx(2 * frequency * soft / (frequency + soft), rel=2e-3)


def shaken(load, torque=10.0, unbalance=0.004):
    dt, speed = 1 / 51200, 14.0
    record = np.zeros((4 * 51200, 8))
    record[:, 2] = 2 * pi * speed * dt * np.arange(len(record))
    foot = LooseFoot(15.0, 45.0, 0.05, load, 0.15, unbalance, 0.0, 0.3)
    return record, foot(record, dt, torque, 10.0, 52 / 19)


def test_a_foot_that_stays_down_is_an_oscillator_of_one_degree_of_freedom():
    record, out = shaken(load=1e4)
    ω, ω0 = 2 * pi * 14.0, 2 * pi * 45.0
    expected = 0.004 * ω**2 / 15.0 * ω**2 / np.hypot(ω0**2 - ω**2, 2 * 0.05 * ω0 * ω)
    assert order_amplitude(record, out, 1) == pytest.approx(expected, rel=2e-3)
    assert order_amplitude(record, out, 2) < 1e-3 * expected


def test_a_foot_that_lifts_off_adds_harmonics_and_a_heavier_torque_more_of_them():
    record, down = shaken(load=80.0, torque=10.0)
    _, lifted = shaken(load=80.0, torque=15.0)
    second = [order_amplitude(record, out, 2) for out in (down, lifted)]
    assert second[0] < 0.02 < 0.3 * order_amplitude(record, lifted, 1) < 10 * second[1]
    assert second[1] > 5 * second[0]
