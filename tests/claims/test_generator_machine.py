"""The simulated machine against closed forms: structure, statics, forces, step, effects."""

from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np
import pytest

from recordings.generator.contact import back_force, forces, static_approach, work_space
from recordings.generator.effects import EFFECTS
from recordings.generator.sensors import rms_below
from recordings.generator.structure import INDEX, build, natural_frequencies
from tests.generator_instances import (
    EFFECT_INSTANCES,
    RATED,
    knobs,
    machine,
    order_amplitude,
    pair,
    rig,
    steady,
    transmission_error,
)

INSTRUMENTS = (  # shown by the tests of the sensors and of what is foreign to the gears
    "sensor_gain", "sensor_resonance", "mains_interference",
    "order_tone", "level_modulation", "random_impacts", "rub", "drifting_tone", "second_mesh", "loose_foot",
    "loose_accelerometer", "time_shift", "wrong_polarity", "lost_encoder_line", "doubled_encoder_line",
)  # fmt: skip


def test_natural_frequencies_are_those_that_the_rig_file_states():
    structure = build(rig(), np.random.default_rng(0))
    reference = rig()["reference"]["natural_frequencies_hz"]
    found = natural_frequencies(structure, rig()["mesh"]["mean_stiffness"])
    assert found[0] == pytest.approx(0, abs=1e-3)  # the one rigid rotation
    assert found[1:9] == pytest.approx(reference["this_model"], abs=0.01)
    assert found[9:] == pytest.approx(reference["next_above"], rel=1e-4)


def test_modes_are_orthonormal_and_carry_the_stiffness():
    S = build(rig(), np.random.default_rng(3), 0.03, 0.01, 0.2)
    assert np.allclose(S.modes.T @ S.mass @ S.modes, np.eye(21), atol=1e-9)
    scale = S.frequency.max() ** 2
    assert np.allclose(S.modes.T @ S.stiffness @ S.modes, np.diag(S.frequency**2), atol=1e-9 * scale)


def test_perturbation_stays_within_its_spread_and_depends_on_the_seed():
    plain, one, two = (
        build(rig(), np.random.default_rng(seed), spread, spread, spread)
        for seed, spread in ((0, 0.0), (1, 0.03), (2, 0.03))
    )
    mass = np.diag(one.mass) / np.diag(plain.mass)
    assert np.all(np.abs(mass - 1) <= 0.03) and mass.std() > 0.005
    assert np.all(np.abs(one.damping_ratio[2:] / 0.05 - 1) <= 0.03)
    assert not np.allclose(one.frequency, two.frequency, rtol=1e-4)


def test_the_contact_of_a_single_pair_deflects_by_its_hardening_law():
    """F = κ·δ·(δ/δ0)^(1/9) turned round, where one pair alone carries."""
    m = machine(slices=5)
    mesh, force = m.mesh(knobs()), 400.0
    s = -0.3e-3
    angle = (s - m.phase) / mesh.base_radius[0]
    κ = np.interp(s, pair().points, mesh.κ)
    expected = mesh.δ0 * (force / (κ * mesh.δ0)) ** 0.9
    assert static_approach(mesh, angle, force) == pytest.approx(expected, rel=1e-6)


def test_two_pairs_share_the_load_as_their_stiffness():
    m = machine(slices=1)
    mesh, slices, out = m.mesh(knobs()), None, np.zeros(4)
    slices = work_space(mesh)
    s = 2.5e-3
    forces(mesh, (s - m.phase) / mesh.base_radius[0], 2e-6, 0.0, 0.0, out, slices)
    carried = np.sort(slices[:, 0])[::-1][:2]
    κ = np.sort(np.interp([s, s - pair().base_pitch], pair().points, mesh.κ))[::-1]
    assert carried[0] / carried[1] == pytest.approx(κ[0] / κ[1], rel=1e-3)
    assert out[0] == pytest.approx(slices.sum(), rel=1e-12)


def test_back_flanks_carry_as_the_drive_flanks_do_behind_the_backlash():
    """The back of the mesh is its mirror image: over a mesh cycle the same forces, in another order."""
    m = machine()
    mesh, out = m.mesh(knobs()), np.zeros(4)
    slices, δ = work_space(mesh), 2e-6
    angles = np.arange(400) / 400 * 2 * pi / 19
    drive = []
    for angle in angles:
        forces(mesh, angle, δ, 0.0, 0.0, out, slices)
        drive.append(out[0])
    back = [back_force(mesh, angle, δ + mesh.backlash, 0.0) for angle in angles]
    assert np.mean(back) == pytest.approx(np.mean(drive), rel=2e-3)
    assert np.sort(back) == pytest.approx(np.sort(drive), rel=0.05)  # sampled where they rise steeply
    assert back_force(mesh, 0.1, mesh.backlash, 0.0) == 0.0


@pytest.mark.slow
def test_the_mean_transmission_error_is_the_static_deflection_under_load():
    """Springs in series from encoder to encoder: K q = f with the approach given."""
    m = machine()
    record = steady(m, knobs(), 0.5)
    S, force = m.structure, RATED.torque / pair().base_radius[0]
    f = -force * S.mesh_direction
    f[INDEX["th1"]] += RATED.torque
    f[INDEX["th13"]] -= RATED.torque * 52 / 19
    q = np.linalg.lstsq(S.stiffness, f, rcond=1e-12)[0]
    rb = pair().base_radius
    ends = rb[0] * q[INDEX["th7"]] - rb[1] * q[INDEX["th8"]] - S.mesh_direction @ q
    expected = ends + record[:, 6].mean()  # the mean approach is the mesh's own deflection
    assert transmission_error(record).mean() == pytest.approx(expected, rel=1e-3)
    stiffness = RATED.torque / rb[0] / record[:, 6].mean()
    assert stiffness == pytest.approx(rig()["mesh"]["mean_stiffness"], rel=0.05)  # at the rated load


@pytest.mark.slow
def test_the_mean_mesh_force_carries_the_torque():
    record = steady(machine(), knobs(), 1.0)
    assert record[:, 4].mean() == pytest.approx(RATED.torque / pair().base_radius[0], rel=1e-4)
    assert record[:, 1].mean() == pytest.approx(RATED.torque, rel=1e-4)
    assert record[:, 7].mean() == pytest.approx(RATED.speed, rel=1e-5)


def test_halving_the_step_converges_with_order_two():
    """The corners and kinks of the contact bound the order of Runge-Kutta's four."""
    runs = []
    for factor in (1, 2, 4, 8):
        m = machine(step_rate=102400.0 * factor)
        runs.append(steady(m, knobs(), 0.02, settle=0.01)[::factor, 0])
    errors = [np.std(a - b) for a, b in pairwise(runs)]
    order = -np.polyfit(np.arange(3), np.log2(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.4)
    assert errors[0] < 1e-3 * runs[-1].std()


@pytest.mark.slow
def test_friction_costs_the_power_of_the_gear_loss_factor():
    """P_loss/P = μ·π·(1/z1 + 1/z2)·(1 − ε + ε1² + ε2²), Niemann and Winter, Maschinenelemente II, 21.4.

    The formula shares the load evenly between two pairs; here the stiffer one carries more.
    """
    μ, p = 0.05, pair()
    ε1, ε2 = p.end / p.base_pitch, -p.start / p.base_pitch
    loss = μ * pi * (1 / 19 + 1 / 52) * (1 - ε1 - ε2 + ε1**2 + ε2**2)
    record = steady(machine(), knobs("tooth_friction", mu=μ), 1.0)
    assert record[:, 1].mean() / RATED.torque - 1 == pytest.approx(loss, rel=0.08)


def stepped_away(m, cracked) -> np.ndarray:
    """Largest change of the transmission error within each tooth of the gear's turn [m]; (52,)."""
    record, healthy = (steady(m, k, 0.4) for k in (cracked, knobs()))
    passed = (record[:, 2] * pair().base_radius[0] + m.phase) / pair().base_pitch
    change = abs(transmission_error(record) - transmission_error(healthy))
    change -= np.median(change)
    return np.array([change[np.floor(passed).astype(int) % 52 == tooth].max() for tooth in range(52)])


@pytest.mark.slow
def test_a_cracked_gear_tooth_yields_once_a_gear_turn_where_it_carries():
    tooth = 31
    away = stepped_away(machine(), knobs("tooth_crack", tooth=tooth, remaining_stiffness=0.5, shaft="gear"))
    near = [(tooth + shift) % 52 for shift in (-1, 0, 1, 2)]
    assert away[near].max() > 4 * np.delete(away, near).max()


def test_the_gears_relief_is_the_pinions_unless_it_is_given():
    alike, own, none = (
        knobs("profile_error", tip_relief_um=8.0, **more)
        for more in ({}, {"gear_tip_relief_um": 4.0}, {"gear_tip_relief_um": 0.0})
    )
    assert np.array_equal(own.pinion_form, alike.pinion_form)
    assert np.allclose(2 * own.gear_form, alike.gear_form) and not np.any(none.gear_form)


@pytest.mark.slow
def test_an_eccentric_gear_moves_the_transmission_error_once_a_turn_by_its_eccentricity():
    m = machine()
    record = steady(m, knobs("pinion_eccentricity", e_um=20.0), 0.6)
    assert order_amplitude(record, transmission_error(record), 1.0) == pytest.approx(20e-6, rel=0.02)
    healthy = steady(m, knobs(), 0.6)
    assert order_amplitude(healthy, transmission_error(healthy), 1.0) < 0.05e-6


def test_the_unworn_machine_repeats_every_mesh_and_reaches_no_back_flank():
    record = steady(machine(), knobs(), 0.6)
    acceleration = record[:, 0]
    mesh_lines = sum(order_amplitude(record, acceleration, 19.0 * k) ** 2 / 2 for k in range(1, 40))
    assert mesh_lines / acceleration.var() > 0.98
    assert record[:, 5].max() == 0.0 and record[:, 4].min() > 0.0


def test_a_pulsating_load_under_low_torque_rattles_between_both_flanks():
    light = replace(RATED, torque=0.3)
    record = steady(machine(), knobs("backlash_rattle", load_ripple_nm=3.0, order=2.0), 0.5, light)
    drive, back = record[:, 4], record[:, 5]
    assert (drive == 0).mean() > 0.1 and (back > 0).mean() > 0.1
    assert not np.any((drive > 0) & (back > 0))  # never pressed from both sides
    backlash = rig()["gears"]["backlash"]
    assert backlash < np.ptp(record[:, 6]) < 1.5 * backlash  # the shafts' bending adds to the backlash


def test_unworn_levels_are_of_the_order_of_the_reference_campaigns():
    """0–2 kHz RMS of the reference campaigns at 10 Hz, 10 N·m, new gears: 3.3 m/s²."""
    record = steady(machine(), knobs(), 1.0)
    assert 1.5 < rms_below(record[:, 0], 102400.0, 2000.0) < 7


@pytest.mark.parametrize("name", EFFECT_INSTANCES)
def test_every_effect_leaves_a_trace_where_it_acts(name):
    effect = knobs(name, **EFFECT_INSTANCES[name])
    if name in INSTRUMENTS:
        assert effect != knobs()
        return
    m = machine(slices=5)
    with_it, without = (steady(m, k, 0.12, settle=0.1) for k in (effect, knobs()))
    assert np.all(np.isfinite(with_it))
    assert np.std(with_it[:, 0] - without[:, 0]) > 1e-4 * without[:, 0].std()


def test_there_is_an_instance_of_every_effect():
    assert set(EFFECT_INSTANCES) == set(EFFECTS)
