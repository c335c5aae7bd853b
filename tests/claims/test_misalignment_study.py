"""The pair as bodies on shafts: contact law, balance, friction, tilts, and an integration that another one confirms."""

from dataclasses import replace
from math import cos, pi, radians, sin, tan

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from studies.misalignment import motion
from studies.misalignment.bands import band_rms, derivative, shaft_lines, sideband_ratio, whole_turn
from studies.misalignment.dabrowski_2012 import ESTIMATES, READINGS, TEETH, TILT_ANGLE, drawn, system
from studies.misalignment.impact_law import friction, impact
from studies.misalignment.motion import Case, contact_forces, integrate
from studies.misalignment.system import FREEDOMS, Shafts, Tilt
from twin.effects.misalignment import Misalignment, face_separation
from twin.effects.setup import setup_of
from twin.errors import NotConverged, ParameterError
from twin.mesh.corner_contact import corner_gap

RIGID = system()
BOTH = RIGID.giving(bearings=True, shafts=True)
ALL = RIGID.giving(bearings=True, shafts=True, teeth=True)
DRY = replace(RIGID, law=RIGID.law.without_friction())
ALIGNED, OUT, IN_PLANE = Tilt(), Tilt(angle=TILT_ANGLE), Tilt(angle=TILT_ANGLE, direction="in_plane")
TURNING, AT_AN_END = Tilt(angle=TILT_ANGLE, turning=True), Tilt(angle=TILT_ANGLE, turning=True, pivot=-0.5)
K, E, C, D = RIGID.law.normal
COARSE = {"steps": 128, "slices": 11}
θ2 = FREEDOMS.index("theta2")


def undamped(made):
    return replace(made, law=replace(made.law, damping=0.0))


def case(made=RIGID, tilt=ALIGNED, speed_rpm=800.0, torque=200.0):
    return Case(system=made, speed_rpm=speed_rpm, torque=torque, tilt=tilt)


def pressed(depth, tilt=ALIGNED, made=DRY, slices=401):
    """Contacts at the pitch point, one pair in contact, the driven held back by a depth along the line of action."""
    q = np.zeros(10)
    q[θ2] = -depth / made.pair.base_radius[1]
    return contact_forces(case(undamped(made), tilt), q, np.zeros(10), 0.0, slices)


# the law


def test_stiffness_is_read_in_millimetres_to_the_exponent_of_the_law():
    assert impact(1e-3, 0.0, K, E, C, D)[0] == pytest.approx(2.9852e5, rel=1e-12)
    assert impact(2e-3, 0.0, K, E, C, D)[0] == pytest.approx(2.9852e5 * 2**1.3, rel=1e-12)


@pytest.mark.parametrize(("share", "step"), [(0.25, 0.15625), (0.5, 0.5), (1.0, 1.0), (3.0, 1.0)])
def test_damping_grows_as_a_cubic_step_to_its_full_depth(share, step):
    x, rate = share * D, 1e-3
    damped = impact(x, rate, K, E, C, D)[0] - impact(x, 0.0, K, E, C, D)[0]
    assert damped == pytest.approx(C * step * rate, rel=1e-9)


def test_contact_never_pulls():
    assert impact(1e-5, -1.0, K, E, C, D) == (0.0, 0.0, 0.0)
    assert impact(-1e-9, 1.0, K, E, C, D) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("x", [3e-6, 4e-5, 0.99e-4, 1.4e-4])
@pytest.mark.parametrize("rate", [-1e-4, 0.0, 0.02])
def test_slopes_of_the_law_are_its_differences(x, rate):
    _, by_depth, by_rate = impact(x, rate, K, E, C, D)
    h = 1e-10
    assert by_depth == pytest.approx(
        (impact(x + h, rate, K, E, C, D)[0] - impact(x - h, rate, K, E, C, D)[0]) / 2 / h, rel=1e-4
    )
    assert by_rate == pytest.approx(
        (impact(x, rate + h, K, E, C, D)[0] - impact(x, rate - h, K, E, C, D)[0]) / 2 / h, rel=1e-3
    )


def test_friction_reaches_its_coefficients_at_the_transition_speeds_and_is_odd():
    rub = RIGID.law.tangential
    assert friction(0.0, *rub)[0] == 0.0
    assert friction(1e-3, *rub)[0] == pytest.approx(0.1)
    assert friction(10e-3, *rub)[0] == friction(2.0, *rub)[0] == pytest.approx(0.08)
    for v in (2e-4, 7e-4, 4e-3, 9.9e-3, 0.3):
        assert friction(-v, *rub)[0] == pytest.approx(-friction(v, *rub)[0], rel=1e-12)
        slope = (friction(v + 1e-9, *rub)[0] - friction(v - 1e-9, *rub)[0]) / 2e-9
        assert friction(v, *rub)[1] == pytest.approx(slope, rel=1e-4, abs=1e-6)


def test_wrong_parameters_are_refused_by_name():
    with pytest.raises(ParameterError, match="full_damping_depth = 0"):
        replace(RIGID.law, full_damping_depth=0.0)
    with pytest.raises(ParameterError, match="dynamic_speed"):
        replace(RIGID.law, dynamic_speed=1e-4)
    with pytest.raises(ParameterError, match="degrees"):
        Tilt(angle=1.0)
    with pytest.raises(ParameterError, match="pivot"):
        Tilt(pivot=0.6)
    with pytest.raises(ParameterError, match="place = 1"):
        replace(RIGID.shafts, place=1.0)
    with pytest.raises(ParameterError, match="teeth"):
        replace(RIGID, pair=replace(RIGID.pair, teeth=(19, 52)))
    with pytest.raises(ParameterError, match="steps"):
        integrate(case(), settle=0, keep=1, steps=8)


# at rest


@pytest.mark.slow
def test_one_pair_at_rest_bears_the_closed_form_of_the_law():
    F = RIGID.static_force(200.0)
    x = RIGID.law.penetration(F)
    force, (drive, back, power, _) = pressed(x)
    assert drive == pytest.approx(F, rel=1e-9) and back == 0 and power == 0
    rb, α = RIGID.pair.base_radius[0], RIGID.pair.pressure_angle
    along = np.array([sin(α), -cos(α), 0, 0, rb])
    assert force == pytest.approx(np.concatenate((-F * along, F * along)), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("tilt", [ALIGNED, OUT])
def test_every_pair_that_touches_is_counted_at_every_place_of_the_mesh(tilt):
    """Beside the sum over nine pairs, written out; the axis is tilted so that no shift of the contact matters."""
    made, δ, z = undamped(DRY), 90e-6, (np.arange(11) + 0.5) / 11 - 0.5
    pair, λ = made.pair, tilt.lead_gap(made.pair)
    q = np.zeros(10)
    q[θ2] = -δ / pair.base_radius[1]
    arm = z * pair.face_width * np.tan(tilt.angle)  # the gear's teeth stand off by it across the line of centres
    σ1 = σ2 = 0.5 * cos(pair.pressure_angle) * arm
    for time in np.linspace(0, case().mesh_period, 37):
        s = case().omega * pair.base_radius[0] * time + pair.base_pitch * np.arange(-4, 5)[:, None]
        gap = corner_gap(pair, s + np.where(s < 0, σ2, σ1))
        x = np.maximum(δ + λ * z - gap, 0)
        drive = contact_forces(case(made, tilt), q, np.zeros(10), time, 11)[1][0]
        assert drive == pytest.approx((K * x**E).sum() / 11, rel=1e-3)


def test_the_edge_contact_of_a_tilted_axis_is_the_integral_of_the_law_over_the_lead_gap():
    F, λ = 200.0, OUT.lead_gap(RIGID.pair)  # so little that the next pair's corners do not touch, too
    assert λ == pytest.approx(20e-3 * tan(radians(1)) * cos(radians(20)))
    x = ((E + 1) * λ * F / K) ** (1 / (E + 1))  # of the end that carries: F = (K/λ)·∫_0^x u^e du
    assert x < λ
    force, (drive, *_) = pressed(x - λ / 2, OUT, slices=4001)
    assert drive == pytest.approx(F, rel=2e-3)
    centre = (0.5 - x / λ / (E + 2)) * RIGID.pair.face_width  # of the force, from the middle of the face
    assert force[8] / (F * sin(RIGID.pair.pressure_angle)) == pytest.approx(centre, rel=2e-3)


def test_the_lead_gap_is_that_of_the_misalignment_effect():
    from tests.dynamics_cases import TEN, model

    setup = setup_of(model(), TEN, "mesh")
    gapped = Misalignment(lead_gap=40e-6).apply(setup)
    expected = gapped.drive * face_separation(40e-6, gapped.face_position)
    assert np.array_equal(np.broadcast_to(gapped.separation, expected.shape), expected)
    z = np.linspace(-0.5, 0.5, 11)
    assert face_separation(3e-4, z).max() == face_separation(-3e-4, z).max() == 0
    assert face_separation(3e-4, z)[::-1] == pytest.approx(face_separation(-3e-4, z))


@pytest.mark.parametrize("direction", ["normal", "in_plane"])
def test_a_tilt_opens_the_flanks_by_the_cosine_or_the_sine_of_the_pressure_angle(direction):
    pair = RIGID.pair
    part = {"normal": cos, "in_plane": sin}[direction](pair.pressure_angle)
    gap = Tilt(angle=TILT_ANGLE, direction=direction).lead_gap(pair)
    assert gap == pytest.approx(pair.face_width * tan(TILT_ANGLE) * part)


def test_force_and_moments_are_the_same_mirrored_where_the_tilt_is():
    x = 60e-6
    one, other = pressed(x, OUT)[0], pressed(x, replace(OUT, angle=-TILT_ANGLE))[0]
    tilts = np.isin(np.arange(10), (2, 3, 7, 8))
    assert other == pytest.approx(np.where(tilts, -one, one), rel=1e-9, abs=1e-9)


# friction


@pytest.mark.parametrize("tilt", [ALIGNED, OUT, IN_PLANE, TURNING, AT_AN_END])
@pytest.mark.parametrize("time", [0.0, 0.3e-3, 1.1e-3, 2.3e-3])
@pytest.mark.parametrize("made", [RIGID, BOTH])
def test_friction_takes_from_the_motion_what_its_forces_do_on_it(made, time, tilt):
    made = undamped(made)
    random = np.random.default_rng(2)
    q, v = np.zeros(10), random.normal(scale=1e-3, size=10)
    q[θ2] = -60e-6 / made.pair.base_radius[1]
    rubbed, sums = contact_forces(case(made, tilt), q, v, time)
    smooth, _ = contact_forces(case(replace(made, law=made.law.without_friction()), tilt), q, v, time)
    whole = v.copy()
    whole[[4, 9]] += case().omega
    assert sums[2] < 0
    assert (rubbed - smooth) @ whole == pytest.approx(sums[2], rel=1e-9)


@pytest.mark.parametrize("made", [RIGID, BOTH, ALL])
def test_friction_only_takes_power_and_the_driven_feels_the_torque_in_the_mean(made):
    found = integrate(case(made, OUT), settle=28, keep=1, **COARSE)
    assert found.friction_power.max() <= 1e-9
    assert found.contact[:, θ2].mean() == pytest.approx(200.0, rel=1e-3)
    brought = -found.contact[:, 4].mean() - found.contact[:, θ2].mean()  # by the driver's rotation, over the torque
    assert brought * case().omega >= -found.friction_power.mean() * 0.99


# motion


def test_supports_give_way_by_their_closed_forms_and_ring_at_them():
    s, E_steel = RIGID.shafts, RIGID.pair.youngs_modulus
    bending = s.span**3 / (48 * E_steel * pi * s.diameter**4 / 64)
    carried = 1 / (2 * s.bearing_stiffness)
    assert BOTH.support_compliance[0, 0] == pytest.approx(bending + carried)
    assert BOTH.support_compliance[1, 1] == pytest.approx(
        s.span / (12 * E_steel * pi * s.diameter**4 / 64) + 2 / (s.bearing_stiffness * s.span**2)
    )
    k, m = 1 / (bending + carried), BOTH.mass[0]
    assert np.isclose(BOTH.natural_frequencies, np.sqrt(k / m) / 2 / pi).sum() == 4
    assert not RIGID.stiffness.any() and not RIGID.damping.any()


def test_damping_is_the_same_ratio_of_every_mode():
    root = np.sqrt(BOTH.mass)
    λ, V = np.linalg.eigh(BOTH.stiffness / np.outer(root, root))
    modal = V.T @ (BOTH.damping / np.outer(root, root)) @ V
    assert modal == pytest.approx(np.diag(2 * 0.03 * np.sqrt(np.maximum(λ, 0))), abs=1e-6 * np.abs(modal).max())


def test_an_off_middle_place_couples_displacement_and_slope_and_is_mirrored():
    one = replace(BOTH, shafts=replace(BOTH.shafts, place=0.35)).support_compliance
    other = replace(BOTH, shafts=replace(BOTH.shafts, place=0.65)).support_compliance
    assert one[0, 1] != 0 and BOTH.support_compliance[0, 1] == pytest.approx(0, abs=1e-20)
    assert other == pytest.approx(one * np.array([[1, -1], [-1, 1]]))


@pytest.mark.slow
def test_another_method_finds_the_same_motion():
    """Radau's method of order five, with tolerances of its own, over a mesh period from the same start."""
    made = case(DRY, OUT)
    begun = motion.start(made, 5)
    arguments = motion._arguments(made, 5)
    J, rest = made.system.mass[θ2], np.zeros((2, 8, 5))

    def rate(t, y):
        q, v, force = begun.copy(), np.zeros(10), np.zeros(10)
        q[θ2], v[θ2] = y
        motion._contacts(q, v, t, *arguments, 0.0, False, force, np.zeros((1, 1)), np.zeros(4), rest, rest)
        return [y[1], (force[θ2] - made.torque) / J]

    found = integrate(made, settle=0, keep=1, steps=1024, slices=5)
    solved = solve_ivp(
        rate, (0, found.time[-1]), [begun[θ2], 0.0], method="Radau", rtol=1e-7, atol=1e-5, t_eval=found.time
    )
    moved = np.ptp(solved.y[0])
    assert found.position[:, θ2] == pytest.approx(solved.y[0], abs=2e-3 * moved)


@pytest.mark.parametrize("tilt", [ALIGNED, OUT, IN_PLANE, TURNING, AT_AN_END])
def test_newtons_jacobian_is_the_differences_of_the_forces(tilt):
    turns = FREEDOMS.index("phix1"), FREEDOMS.index("phiy1"), 4, FREEDOMS.index("phix2"), FREEDOMS.index("phiy2"), θ2
    arguments, rest, c_new = motion._arguments(case(BOTH, tilt), 15), np.zeros((2, 8, 15)), 1e-6
    q, v = np.zeros(10), np.random.default_rng(3).normal(scale=1e-3, size=10)
    q[θ2] = -60e-6 / BOTH.pair.base_radius[1]

    def forces(by):
        force, jacobian = np.zeros(10), np.zeros((10, 10))
        motion._contacts(
            q + c_new * by, v + by, 0.3e-3, *arguments, c_new, True, force, jacobian, np.zeros(4), rest, rest.copy()
        )
        return force, jacobian

    steps = np.full(10, 1e-5)  # [m/s], at the base radius where it turns
    steps[list(turns)] /= BOTH.pair.base_radius[0]
    differences = [(forces(-d)[0] - forces(d)[0]) / (2 * d.max()) for d in np.diag(steps)]
    jacobian = forces(np.zeros(10))[1]
    assert np.transpose(differences) == pytest.approx(jacobian, abs=1e-6 * np.abs(jacobian).max())


@pytest.mark.parametrize("made", [RIGID, BOTH, ALL])
def test_half_the_step_gives_the_same_level(made):
    coarse, fine = (
        band_rms(
            whole_turn(integrate(case(made, OUT), settle=28, keep=1, steps=n, slices=11).shaft[:, 0, 1], TEETH, 1),
            TEETH,
        )
        for n in (256, 512)
    )
    assert np.linalg.norm(coarse) == pytest.approx(np.linalg.norm(fine), rel=0.05)


def test_stiff_supports_and_stiff_teeth_are_rigid_ones():
    stiff = replace(
        RIGID.giving(bearings=True),
        shafts=replace(RIGID.shafts, bearing_stiffness=1e13, damping_ratio=0.9),
    )
    rigid, held = (integrate(case(s, OUT), settle=6, keep=1, **COARSE) for s in (RIGID, stiff))
    assert held.mesh_force == pytest.approx(rigid.mesh_force, abs=0.02 * np.ptp(rigid.mesh_force))


def test_a_tooth_bends_by_the_force_that_its_contact_bears():
    k, x, h = 2e8, 60e-6, 1e-5
    F, u, slope = motion._through_tooth(x, 0.0, k, 0.0, 1e12, K, E, C, D)  # a slow step: at rest
    assert pytest.approx(k * u) == F
    assert impact(x - u, 0.0, K, E, C, D)[0] == pytest.approx(F, rel=1e-6)
    F, u, slope = motion._through_tooth(x, 0.01, k, 1e-5, h, K, E, C, D)
    more = motion._through_tooth(x + h * 1e-6, 0.01 + 1e-6, k, 1e-5, h, K, E, C, D)[0]
    assert slope == pytest.approx((more - F) / 1e-6, rel=1e-3)


def test_back_flanks_touch_where_the_backlash_is_less_than_the_tilt_needs():
    tight = replace(RIGID, pair=replace(RIGID.pair, backlash=0.1e-3))
    assert integrate(case(tight, OUT), settle=2, keep=1, **COARSE).back_force.max() > 100
    assert not integrate(case(RIGID, OUT), settle=2, keep=1, **COARSE).back_force.any()


def test_a_step_that_newton_leaves_is_an_error_not_a_number(monkeypatch):
    monkeypatch.setattr(motion, "_run", lambda *arguments: 3)
    with pytest.raises(NotConverged, match="3 of"):
        integrate(case(), settle=0, keep=1)


# tilts that stand still and tilts that turn


def turn_of(tilt, made=RIGID):
    return integrate(case(made, tilt), settle=10, keep=TEETH, **COARSE).shaft[:, 0, 1]


@pytest.mark.parametrize("made", [RIGID, BOTH])
def test_an_axis_out_of_line_makes_no_sidebands(made):
    settled = integrate(case(made, OUT), settle=40, keep=TEETH, **COARSE).shaft[:, 0, 1]
    assert sideband_ratio(settled, TEETH, 1).max() < 1e-3
    assert sideband_ratio(settled, TEETH, 2).max() < 1e-3


def test_a_gear_crooked_about_its_middle_makes_sidebands_at_twice_the_shafts_speed():
    turn = turn_of(TURNING)
    assert np.median(sideband_ratio(turn, TEETH, 2)) > 0.2
    assert np.median(sideband_ratio(turn, TEETH, 1)) < 0.01


def test_a_gear_crooked_about_an_end_makes_sidebands_at_the_shafts_speed_too():
    turn = turn_of(AT_AN_END)
    assert np.median(sideband_ratio(turn, TEETH, 1)) > 0.1


# bands


def test_bands_hold_the_mesh_lines_with_two_sidebands_and_nothing_beyond():
    θ = 2 * pi * np.arange(29 * 128) / (29 * 128)
    x = 7 + 3 * np.cos(58 * θ + 0.4) + 2 * np.cos(60 * θ) + 5 * np.cos(61 * θ) + np.cos(29 * θ)
    assert band_rms(x, 29) == pytest.approx([np.sqrt(0.5), np.sqrt(4.5 + 2), 0, 0, 0], abs=1e-3)
    assert np.abs(shaft_lines(x))[[0, 29, 58, 60]] == pytest.approx([7, 1, 3, 2])
    assert sideband_ratio(x, 29, 2)[1] == pytest.approx(2 / 3)
    assert derivative(np.cos(29 * θ), 10.0, 2) == pytest.approx(-(290.0**2) * np.cos(29 * θ), abs=1e-3)
    with pytest.raises(ParameterError, match="turn"):
        whole_turn(x, 29, 3)


# what is estimated


def test_every_estimate_lies_in_its_range_and_changes_the_system():
    for e in ESTIMATES:
        assert e.low <= e.value <= e.high and e.reason
        assert e.at(system(), e.low) != system() != e.at(system(), e.high)
    by_name = {e.name: e for e in ESTIMATES}
    for name in ("face width", "bearing stiffness", "place of the gears in the span"):
        assert by_name[name].at(system(), by_name[name].value).mass == pytest.approx(system().mass)
    assert all(change(system()).law.exponent == 1.5 for change in READINGS.values())
    assert len(drawn(1, 3)) == 3 and drawn(1, 2) == drawn(1, 3)[:2]


def test_every_estimate_is_drawn_and_the_backlash_lets_the_drawn_face_turn_free():
    sets = drawn(1, 12)
    for read in (
        *(lambda s, n=n: getattr(s.shafts, n) for n in Shafts.__slots__),
        lambda s: s.pair.backlash, lambda s: s.pair.face_width, lambda s: s.density, lambda s: s.law.full_damping_depth,
    ):  # fmt: skip
        assert len({read(s) for s in sets}) == len(sets)
    for s in sets:
        assert s.pair.face_width * tan(TILT_ANGLE) < s.pair.backlash <= 0.6e-3
        assert not integrate(case(s, OUT), settle=2, keep=1, **COARSE).back_force.any()


def test_shafts_say_what_they_are_made_of():
    with pytest.raises(ParameterError, match="damping_ratio"):
        Shafts(diameter=0.03, span=0.1, place=0.5, bearing_stiffness=1e8, damping_ratio=3.0)
