"""What each effect on the mesh does by theory: eccentricity, misalignment, friction, errors, cracks, stiffness."""

from dataclasses import replace

import numpy as np
import pytest

from tests.dynamics_cases import TEN, model, relative, worn
from tests.effects_cases import TEETH, action_power, solved, with_instance
from twin.dynamics.harmonic_balance import solve
from twin.dynamics.structure import direction
from twin.effects import EFFECTS, solve_with
from twin.effects.setup import contacts_of, setup_of
from twin.errors import ParameterError
from twin.model import Condition
from twin.rig_schema import DEGREES_OF_FREEDOM
from twin.wear.profile import WornProfile

Z1, Z2 = TEETH
PINION, GEAR = EFFECTS["pinion_eccentricity"], EFFECTS["gear_eccentricity"]
MISALIGNMENT, FRICTION = EFFECTS["misalignment"], EFFECTS["tooth_friction"]
CRACK, PITCH = EFFECTS["tooth_crack"], EFFECTS["pitch_error"]
MESH_ORDERS = 19.0 * np.arange(1, 6)
TWELVE = Condition(speed_hz=12.0, torque=10.0)


def magnitudes(found):
    return np.abs(np.concatenate((found.transmission_error_lines * 1e6, found.acceleration_lines)))


def hunting_setup():
    return setup_of(model(), TEN, "hunting")


# --- eccentricity


@pytest.mark.parametrize(("kind", "order"), [(PINION, 1.0), (GEAR, Z1 / Z2)])
def test_eccentricity_is_the_transmission_error_at_its_own_order(kind, order):
    found = solved(kind(eccentricity=30e-6))
    assert abs(found.transmission_error([order])[0]) == pytest.approx(30e-6, rel=5e-3)


@pytest.mark.parametrize(("kind", "order"), [(PINION, 1.0), (GEAR, Z1 / Z2)])
def test_eccentricity_makes_sidebands_at_its_own_distance_and_keeps_the_mesh_orders(kind, order):
    found = solved(kind(eccentricity=20e-6), depth=50e-6, period="hunting")
    healthy = solved(depth=50e-6, period="hunting")
    sidebands = np.abs(found.acceleration(np.concatenate((MESH_ORDERS - order, MESH_ORDERS + order))))
    assert sidebands.max() > 5e-3 * np.abs(healthy.acceleration(MESH_ORDERS)).max()
    assert np.abs(healthy.acceleration(MESH_ORDERS + order)).max() < 1e-9
    changes = [
        relative(other.acceleration(MESH_ORDERS), healthy.acceleration(MESH_ORDERS))
        for other in (found, solved(kind(eccentricity=10e-6), depth=50e-6, period="hunting"))
    ]
    assert changes[0] < 1e-2 and changes[1] < 0.45 * changes[0]  # more than in proportion


def tangent(gear_centre, pair):
    """Unwound lengths to the pitch point's contact at unchanged rotations, and L, of two base circles (exact)."""
    rb1, rb2 = pair.base_radius
    distance, bearing = np.hypot(*gear_centre), np.arctan2(gear_centre[1], gear_centre[0])
    ψ = bearing - np.arccos((rb1 + rb2) / distance)  # of the radius at which the internal tangent touches
    return ψ, np.sqrt(distance**2 - (rb1 + rb2) ** 2)


@pytest.mark.parametrize("along", [0.0, 1.0])
@pytest.mark.parametrize("across", [0.0, 1.0])
def test_shift_and_separation_are_those_of_the_internal_tangent_of_two_base_circles(along, across):
    pair, tiny = model().mesh.pair, 1e-6
    rb1, rb2 = pair.base_radius
    L = (rb1 + rb2) * np.tan(pair.pressure_angle)
    centre = np.array([rb1 + rb2, L])  # n is the first axis, t the second
    ψ0, L0 = tangent(centre, pair)
    ψ, L1 = tangent(centre + tiny * np.array([across, along]), pair)
    assert (ψ0, L0) == pytest.approx((0.0, L), abs=1e-12)
    grown1, grown2 = -rb1 * (ψ - ψ0), -rb2 * (ψ - ψ0)  # the pinion turns with the angle, the gear against it
    assert L1 - L0 - grown1 - grown2 == pytest.approx(tiny * along, abs=1e-3 * tiny)  # the gap
    assert grown1 == pytest.approx(tiny * across * rb1 / L, abs=1e-3 * tiny)


def test_contact_wanders_outward_on_both_flanks_as_the_centres_draw_apart():
    setup = GEAR(eccentricity=20e-6).apply(hunting_setup())
    pair = setup.pair
    rb1, rb2 = pair.base_radius
    L = (rb1 + rb2) * np.tan(pair.pressure_angle)
    apart = -20e-6 * np.sin(setup.passages.gear_angle)  # δ·n
    np.testing.assert_allclose(setup.shift.pinion, apart * rb1 / L, atol=1e-15)
    np.testing.assert_allclose(setup.shift.gear, -apart * rb2 / L, atol=1e-15)
    z1, z2 = pair.teeth  # shares of the wear: what worn flanks add cancels to first order
    np.testing.assert_allclose(z2 * setup.shift.pinion + z1 * setup.shift.gear, 0.0, atol=1e-15)


@pytest.mark.parametrize("depth", [0.0, 50e-6])
@pytest.mark.parametrize("kind", [PINION, GEAR])
def test_turning_the_high_point_by_a_tooth_only_delays_the_response(kind, depth):
    z = Z1 if kind is PINION else Z2
    one = solved(kind(eccentricity=20e-6, high_point=0.4), depth=depth)
    other = solved(kind(eccentricity=20e-6, high_point=0.4 + 2 * np.pi * 3 / z), depth=depth)
    assert relative(magnitudes(one), magnitudes(other)) < 1e-6


@pytest.mark.parametrize(("kind", "ratio"), [(PINION, 1.0), (GEAR, Z1 / Z2)])
def test_moment_of_an_eccentric_gear_does_the_work_of_its_displacement(kind, ratio):
    setup = kind(eccentricity=20e-6, high_point=0.4).apply(hunting_setup())
    later = kind(eccentricity=20e-6, high_point=0.4 + 1e-6).apply(hunting_setup())
    by_angle = (later.separation - setup.separation) / 1e-6  # ∂e/∂θ of its own shaft, both sides of the teeth
    ((along, weight),) = setup.actions
    np.testing.assert_allclose(setup.passages.side * weight, by_angle, atol=1e-10)
    np.testing.assert_allclose(setup.slope, ratio * by_angle, atol=1e-10)
    assert np.count_nonzero(along) == 1


def test_shift_and_its_slopes_belong_together():
    setup = GEAR(eccentricity=20e-6).apply(hunting_setup())
    step = setup.passages.pinion_angle[1]
    for shift, slope in ((setup.shift.pinion, setup.shift.pinion_slope), (setup.shift.gear, setup.shift.gear_slope)):
        assert np.abs(np.gradient(shift, step) - slope)[1:-1].max() < 1e-5 * np.abs(slope).max()


# --- misalignment


def test_mirrored_misalignment_gives_the_same_response_and_the_opposite_moment():
    one, other = solved(MISALIGNMENT(lead_gap=20e-6)), solved(MISALIGNMENT(lead_gap=-20e-6))
    assert relative(one.acceleration_lines, other.acceleration_lines) < 1e-6
    assert one.face_moment == pytest.approx(-other.face_moment, rel=1e-6)
    assert one.face_moment.min() > 0


def test_slices_without_a_gap_are_the_whole_face():
    unworn = model().unworn
    sliced = solve_with(model(), (), [unworn] * 13, TEN)
    assert relative(sliced.acceleration_lines, solved().acceleration_lines) < 1e-9
    assert np.abs(sliced.face_moment).max() < 1e-9


def test_edge_moment_is_bounded_by_the_whole_load_at_the_edge():
    found = solved(MISALIGNMENT(lead_gap=150e-6))
    load = model().mean_force(TEN)
    assert 0.3 * load * 0.01 < found.face_moment.mean() < load * 0.01  # half of a 20 mm face


def test_misaligned_mesh_deflects_as_slices_under_a_wedge():
    """d = √(2F·λ/k) where the face is partly open, from the edge that touches first."""
    λ, found = 60e-6, solved(MISALIGNMENT(lead_gap=60e-6))
    single = np.abs(model().mesh.phase) < 0.2e-3  # one pair about the pitch point
    k = 13 * found.contacts.stiffness[1, single].mean()
    expected = np.sqrt(2 * model().mean_force(TEN) * λ / k)
    assert found.steady.quasi_static[single].mean() == pytest.approx(expected, rel=0.03)


def test_worn_in_edges_carry_the_load_again():
    """Wear that follows the gap leaves the response of aligned gears, further back by the gap."""
    λ, s = 30e-6, model().unworn
    setup = MISALIGNMENT(lead_gap=λ).apply(setup_of(model(), TEN, "mesh"))
    depths = λ * (0.5 + setup.face_position[:, 0, 0]) + 0.0
    profiles = [
        WornProfile(positions=s.positions, depth=np.full_like(s.depth, depth), active=s.active) for depth in depths
    ]
    found = solve_with(model(), (MISALIGNMENT(lead_gap=λ),), profiles, TEN)
    aligned = solved()
    assert relative(found.acceleration_lines, aligned.acceleration_lines) < 1e-6
    assert found.mean_transmission_error - aligned.mean_transmission_error == pytest.approx(λ, rel=1e-6)
    assert np.abs(found.face_moment).max() < 1e-6


def test_misalignment_multiplies_the_mesh_orders_of_unworn_gears():
    """Seen on campaigns at 32 µm, 12 Hz, 12 N·m: orders 19, 38, 57 doubled to trebled."""
    condition = Condition(speed_hz=12.0, torque=12.0)
    orders = [19.0, 38.0, 57.0]
    found, healthy = solved(MISALIGNMENT(lead_gap=32e-6), condition=condition), solved(condition=condition)
    growth = np.abs(found.transmission_error(orders)) / np.abs(healthy.transmission_error(orders))
    assert (growth > 1.8).all() and (growth < 4.6).all()


def test_strong_misalignment_of_unworn_teeth_raises_the_second_mesh_order_most_of_the_first_two():
    """5 mrad over 20 mm: the prototype had ×4.4 at the second."""
    found, healthy = solved(MISALIGNMENT(lead_gap=5e-3 * 20e-3)), solved()
    growth = np.abs(found.acceleration([19.0, 38.0])) / np.abs(healthy.acceleration([19.0, 38.0]))
    assert growth[1] == pytest.approx(4.4, rel=0.1)
    assert growth[1] > growth[0]


def test_misalignment_that_sets_in_pushes_the_mean_transmission_error_up():
    """Seen on a campaign at its onset, 38 µm, 15 Hz, 12 N·m: +12 µm."""
    condition = Condition(speed_hz=15.0, torque=12.0)
    found, healthy = solved(MISALIGNMENT(lead_gap=38e-6), condition=condition), solved(condition=condition)
    assert found.mean_transmission_error - healthy.mean_transmission_error == pytest.approx(12e-6, rel=0.15)


# --- friction


def test_friction_takes_power_at_every_instant_and_as_much_as_it_slides():
    μ, found = 0.1, solved(FRICTION(coefficient=0.1))
    forces = found.steady.contact_forces[:3]
    sliding = np.abs(found.setup.passages.position[:3]) * sum(found.setup.omega)
    assert action_power(found).min() >= 0
    assert action_power(found) == pytest.approx((μ * forces * sliding).sum(axis=0), rel=1e-9, abs=1e-12)


def test_loss_of_a_gear_pair_is_about_a_percent_at_a_tenth_of_friction():
    found = solved(FRICTION(coefficient=0.1))
    share = action_power(found).mean() / (TEN.torque * found.setup.omega[0])
    assert 0.01 < share < 0.02  # π·μ·(1/z1 + 1/z2)·ε-factor ≈ 1.5 %


def test_friction_pulls_both_gears_equally_and_does_no_work_at_the_pitch_point():
    setup = FRICTION(coefficient=0.1).apply(setup_of(model(), TEN, "mesh"))
    (along, weight), (beyond, further) = setup.actions
    for axis in "xy":
        one, other = (along @ direction({f"{axis}{n}": 1.0}) for n in (5, 10))
        assert one == -other
    ω1, ω2 = setup.omega
    turning = direction({"th5": ω1, "th10": ω2})
    assert along @ turning == pytest.approx(0.0, abs=1e-12)
    assert (further * (beyond @ turning)).min() >= 0
    assert weight[1, 0] == 0 and weight[1, 1] > 0 > weight[1, -1]


def test_stribeck_friction_falls_from_the_static_to_the_sliding_coefficient():
    friction = FRICTION(coefficient=0.08, static_ratio=1.25, stribeck_speed=0.005)
    μ = friction.coefficient_at(np.array([0.0, 0.001, 0.01, 1.0]))
    assert μ[0] == pytest.approx(0.1) and μ[-1] == pytest.approx(0.08)
    assert (np.diff(μ) < 0).all()


def test_friction_shows_at_the_orders_seen_on_a_campaign():
    """Unworn, 12 Hz, 10 N·m, friction 0.09: about 1.85, 1.76, 0.37 µm, by a simulator that perturbs the machine."""
    found = solved(FRICTION(coefficient=0.09), condition=TWELVE)
    lines = np.abs(found.transmission_error([19.0, 38.0, 57.0])) * 1e6
    assert lines == pytest.approx([1.85, 1.76, 0.37], rel=0.15)


def test_friction_with_its_force_reversed_against_its_moment_would_show_four_times_as_much_at_order_38():
    """Why force and moment must come from one displacement."""
    setup = FRICTION(coefficient=0.09).apply(setup_of(model(), TWELVE, "mesh"))
    reversed_force = np.ones(21)
    reversed_force[[DEGREES_OF_FREEDOM.index(name) for name in ("x5", "y5", "x10", "y10")]] = -1
    lines = []
    for actions in (setup.actions, tuple((along * reversed_force, weight) for along, weight in setup.actions)):
        contacts = contacts_of(replace(setup, actions=actions), [model().unworn])
        steady = solve(setup.structure, contacts, model().mean_force(TWELVE)).require_converged()
        lines.append(abs(steady.lines(setup.structure, setup.structure.transmission_error)[1]))
    assert 3.5 < lines[1] / lines[0] < 5.5


def test_friction_grows_the_first_mesh_order_of_the_torque_most():
    found, healthy = solved(FRICTION(coefficient=0.09), condition=TWELVE), solved(condition=TWELVE)
    growth = np.abs(found.torque([19.0, 38.0])) / np.abs(healthy.torque([19.0, 38.0]))
    assert growth[0] > 10 and growth[0] > 3 * growth[1]


# --- errors of the teeth


def test_moved_teeth_only_delay_the_response_to_pitch_errors():
    errors = PITCH.drawn(TEETH, 4e-6, 0.0, seed=5)
    moved = PITCH(pinion=tuple(np.roll(errors.pinion, 4)))
    assert relative(magnitudes(solved(errors)), magnitudes(solved(moved))) < 1e-6


def test_small_pitch_errors_show_their_own_spectrum_in_the_transmission_error():
    """Errors well below the deflection: every pair keeps its load, and the mean of the pairs in contact shows."""
    errors = PITCH.drawn(TEETH, 0.2e-6, 0.0, seed=2)
    expected = 2 * np.abs(np.fft.fft(errors.pinion))[1:4] / Z1
    found = np.abs(solved(errors).transmission_error([1.0, 2.0, 3.0]))
    assert found == pytest.approx(expected, rel=0.15)


def test_large_pitch_errors_leave_the_contact_to_the_foremost_teeth():
    errors = PITCH.drawn(TEETH, 30e-6, 0.0, seed=2)
    forward = solved(errors).mean_transmission_error
    backward = solved(PITCH(pinion=tuple(-np.array(errors.pinion)))).mean_transmission_error
    assert max(forward, backward) < solved().mean_transmission_error - 5e-6


def test_pitch_errors_for_another_number_of_teeth_are_refused():
    with pytest.raises(ParameterError, match="3 pitch errors for 52 teeth of the gear"):
        solved(PITCH(gear=(1e-6, 0.0, -1e-6)))


def test_relief_is_missing_at_the_tips_alone():
    pair = model().mesh.pair
    error = EFFECTS["profile_error"](pinion_relief=10e-6, gear_relief=20e-6, relief_length=1e-3)
    s = np.array([pair.path_start, 0.0, pair.path_end])
    missing, slope = error.missing(s, pair.path_start, pair.path_end)
    assert missing == pytest.approx([20e-6, 0.0, 10e-6])
    assert slope == pytest.approx([-0.04, 0.0, 0.02])


# --- stiffness and damping


def test_crack_shows_within_two_pitches_of_its_tooth():
    found, healthy = solved(CRACK(stiffness_loss=0.4, tooth=12)), with_instance("none", "pinion")
    change = found.steady.quasi_static - healthy.steady.quasi_static
    teeth_away = np.abs((found.setup.passages.pinion_angle * Z1 / (2 * np.pi) - 12 + Z1 / 2) % Z1 - Z1 / 2)
    assert np.abs(change[teeth_away > 1]).max() < 1e-3 * change.max()
    assert change[teeth_away < 0.1].min() > 0.3 * change.max()


def test_crack_on_another_tooth_only_delays_the_response():
    one, other = solved(CRACK(stiffness_loss=0.3, tooth=2)), solved(CRACK(stiffness_loss=0.3, tooth=9))
    assert relative(magnitudes(one), magnitudes(other)) < 1e-6


@pytest.mark.parametrize("on", ["pinion", "gear"])
def test_cracked_tooth_must_exist(on):
    with pytest.raises(ParameterError, match=rf"tooth = 52 must be below the {on}'s"):
        solved(CRACK(stiffness_loss=0.3, tooth=52, on=on))


def test_lost_stiffness_is_a_smaller_stiffness_scale():
    found = solved(EFFECTS["mesh_stiffness_loss"](loss=0.2), depth=20e-6)
    softer = solve_with(model().calibrated(stiffness_scale=0.8), (), worn(TEN, 20e-6), TEN)
    assert relative(found.acceleration_lines, softer.acceleration_lines) < 1e-9


def test_mesh_damping_is_another_damping_time():
    found = solved(EFFECTS["mesh_damping"](factor=3.0), depth=20e-6)
    τ = model().calibration.damping_time
    damped = solve_with(model().calibrated(damping_time=3 * τ), (), worn(TEN, 20e-6), TEN)
    assert relative(found.acceleration_lines, damped.acceleration_lines) < 1e-9
