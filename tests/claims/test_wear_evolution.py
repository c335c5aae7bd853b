"""Wear: what a passage takes away, and how the profile grows."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.dynamics_cases import FOURTEEN, PRIOR, TEN, contacts, model, steady, wear_path, worn
from twin.errors import NotConverged, ParameterError
from twin.model import Condition
from twin.wear.archard import pinion_share, specific_wear_rate, wear_per_revolution
from twin.wear.chebyshev import scheme, stable_to, stages_for
from twin.wear.curve import MasterCurve
from twin.wear.evolution import evolve
from twin.wear.profile import WornProfile

MESH = model().mesh
PAIR = MESH.pair
HALF_WIDTH = PRIOR.contact_half_width
POINT = 1e-7  # a contact narrower than the grid: no smoothing [m]


def evolved(until, condition=TEN, start=None, **options):
    twin = model()

    def solver(profile, near):
        return twin.steady(profile, condition, near)

    return list(evolve(twin.mesh, solver, start or twin.unworn, HALF_WIDTH, until, **options))


def rate(condition, profile=None, half_width=HALF_WIDTH):
    found = steady(contacts(profile or model().unworn, condition, 1024), condition)
    return wear_per_revolution(MESH, found.contact_forces, half_width)


def test_unworn_profile_separates_nothing_to_the_bit():
    table = contacts(WornProfile.unworn(PAIR), TEN, 1024)
    on_path = (MESH.positions >= PAIR.path_start) & (MESH.positions <= PAIR.path_end)
    assert np.all(table.separation[:3][on_path] == 0.0)
    assert np.all(table.separation_rate[:3][on_path] == 0.0)


def test_passage_of_a_point_contact_wears_by_force_times_sliding_velocity():
    found = steady(contacts(model().unworn, TEN, 1024), TEN)
    worn_off = wear_per_revolution(MESH, found.contact_forces, POINT)
    at = np.flatnonzero(MESH.phase == PAIR.base_pitch / 4)[0]
    ω1 = 2 * np.pi * TEN.speed_hz
    v = PAIR.sliding_velocity(PAIR.base_pitch / 4, ω1)
    expected = found.contact_forces[1, at] * v * (1 + 19 / 52) / ω1
    place = np.argmin(np.abs(model().unworn.positions - PAIR.base_pitch / 4))
    assert worn_off[place] == pytest.approx(expected, rel=1e-12)


def test_nothing_wears_at_the_pitch_point_of_a_point_contact():
    worn_off = rate(TEN, half_width=POINT)
    assert worn_off[model().unworn.positions == 0.0] == 0.0


def test_smoothing_conserves_the_worn_volume():
    point, wide, wider = (rate(TEN, half_width=a).sum() for a in (POINT, 1e-4, 3e-4))
    assert [wide, wider] == pytest.approx([point, point], rel=5e-3)
    fine = steady(contacts(model().unworn, TEN, 256), TEN)  # one sample a grid point: exact
    sums = [wear_per_revolution(model(256).mesh, fine.contact_forces, a).sum() for a in (POINT, 1e-4, 3e-4)]
    assert sums == pytest.approx([sums[0]] * 3, rel=1e-12)


def test_wear_per_revolution_does_not_depend_on_the_speed_of_slow_gears():
    slow, slower = (rate(replace(TEN, speed_hz=f)) for f in (0.02, 0.01))
    assert slow == pytest.approx(slower, abs=2e-3 * slower.max())


def test_wear_is_linear_in_the_torque_of_slow_gears_where_no_corner_touches():
    light, heavy = (rate(replace(TEN, speed_hz=0.01, torque=T), half_width=POINT) for T in (5.0, 10.0))
    s = model().unworn.positions
    inner = np.abs(s) < 0.3e-3  # one pair alone carries the force
    assert heavy[inner] == pytest.approx(2 * light[inner], rel=1e-3)
    assert heavy.sum() == pytest.approx(2 * light.sum(), rel=0.02)  # corner contact reaches farther under load


def test_elliptic_weight_taken_twice_has_no_negative_wavelength():
    """Else a corrugation of that wavelength feeds itself."""
    n = MESH.samples
    forces = np.zeros((6, n))
    forces[1, np.flatnonzero(MESH.phase == PAIR.base_pitch / 4)] = 1.0
    response = np.zeros(3 * 256)
    for shift in range(4):  # an impulse seen at every sample of the fine grid
        moved = np.roll(forces, shift, axis=1)
        response += wear_per_revolution(MESH, moved, HALF_WIDTH)[: 3 * 256]
    spectrum = np.fft.rfft(np.roll(response, -int(np.argmax(response))))
    assert spectrum.real.min() > -2e-3 * spectrum.real.max()


def test_what_wore_off_never_grows_back():
    path = wear_path(TEN, 400e-6)
    for before, after in pairwise(path):
        assert np.all(after.profile.depth >= before.profile.depth)
        assert after.profile.max_depth > before.profile.max_depth
        assert after.work > before.work


def test_default_steps_follow_fine_ones_within_a_thousandth():
    coarse = evolved(150e-6)
    fine = evolved(150e-6, largest_step=0.5e-6)
    curve = CubicSpline([p.work for p in fine], [p.profile.depth for p in fine])
    for point in coarse[1:]:
        if point.work < fine[-1].work:
            assert np.abs(point.profile.depth - curve(point.work)).max() < 1e-3 * point.profile.max_depth
    response = CubicSpline([p.work for p in fine], [model().acceleration_rms(p.steady) for p in fine])
    checked = coarse[10::10]
    found = [model().acceleration_rms(p.steady) for p in checked]
    assert found == pytest.approx(response([p.work for p in checked]), rel=1e-3)


def test_light_torque_does_not_make_the_steps_unstable():
    """The stable step shrinks with the load; a wave from step to step would stand out against fine steps."""
    light = replace(TEN, torque=3.0)
    coarse, fine = evolved(40e-6, light), evolved(40e-6, light, largest_step=0.2e-6)
    curve = CubicSpline([p.work for p in fine], [p.profile.depth for p in fine])
    last = [p for p in coarse if p.work < fine[-1].work][-1]
    assert np.abs(last.profile.depth - curve(last.work)).max() < 1e-3 * last.profile.max_depth


def test_wear_steps_converge_with_order_two():
    work = evolved(2e-6, step=lambda depth, largest: 0.02e-6)
    reference = CubicSpline([p.work for p in work], [p.profile.depth for p in work])
    steps = np.array([0.4e-6, 0.2e-6, 0.1e-6])
    errors = []
    for size in steps:
        end = evolved(1.5e-6, step=lambda depth, largest, size=size: size)[-1]
        errors.append(np.abs(end.profile.depth - reference(end.work)).max() / end.profile.max_depth)
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2, abs=0.35)


@pytest.mark.slow
def test_wear_under_a_light_load_ends_where_no_steady_state_lasts():
    """In short steps; the search along the branch of solutions once left the range of numbers there."""
    light = Condition(speed_hz=25.0, torque=3.0)
    with pytest.raises(NotConverged):
        evolved(100e-6, light, largest_step=0.5e-6)


def test_profiles_between_two_points_are_those_of_fine_steps():
    """The cubic with the depths and rates at both; the largest depth is that which is asked for."""
    curve = MasterCurve.build(model(), TEN, model().unworn, 150e-6)
    fine = evolved(150e-6, largest_step=0.5e-6)
    true = CubicSpline([p.profile.max_depth for p in fine], [p.profile.depth for p in fine])
    for depth in np.linspace(1e-6, 145e-6, 97):
        found = curve.profile(depth)
        assert found.max_depth == pytest.approx(depth, rel=2e-5)
        assert np.abs(found.depth - true(depth)).max() < 1e-3 * depth


def test_profiles_are_sound_where_the_deepest_place_no_longer_touches():
    start = worn(TEN, 20e-6)
    pit = np.exp(-((start.positions / 0.15e-3) ** 2))  # at the pitch point, where nothing slides
    pitted = replace(start, depth=np.maximum(start.depth, 22e-6 * pit))
    curve = MasterCurve.build(model(), TEN, pitted, 40e-6)
    for depth in np.linspace(curve.start_depth + 1e-9, 39e-6, 60):
        found = curve.profile(depth)
        assert found.max_depth == pytest.approx(depth, rel=5e-3)
        assert np.all(found.depth >= pitted.depth - 0.2e-6)


# -- the method ----------------------------------------------------------------------------------------


def decayed(decay: float, stages: int, steps: int = 1, forced: bool = False) -> float:
    """y after so many steps of y' = −decay·(y − x) + 1 or y' = −decay·y, y(0) = 1, over x from 0 to 1."""
    by, h, y = scheme(stages), 1 / steps, 1.0
    for n in range(steps):

        def rate(value, at, x=n * h):
            return -decay * (value - x - at * h) + 1 if forced else -decay * value

        first = rate(y, 0.0)
        last, between = y, y + by.rate[1] * h * first
        for j in range(2, stages + 1):
            there = rate(between, by.at[j - 1])
            further = (
                (1 - by.own[j] - by.before[j]) * y + by.own[j] * between + by.before[j] * last
                + h * (by.rate[j] * there + by.first_rate[j] * first)
            )  # fmt: skip
            last, between = between, further
        y = between
    return y


@pytest.mark.parametrize("stages", [2, 3, 5, 9, 40])
def test_chebyshev_steps_are_stable_as_far_as_they_say(stages):
    reach = stable_to(stages)
    assert all(abs(decayed(z, stages)) < 1 + 1e-9 for z in np.linspace(0, reach, 400))
    assert abs(decayed(1.3 * reach, stages)) > 1
    assert stages_for(reach) == stages


@pytest.mark.parametrize("stages", [2, 3, 5, 9])
@pytest.mark.parametrize("forced", [False, True])
def test_chebyshev_steps_are_of_second_order(stages, forced):
    """Against y = e^{−2x}, and x + e^{−2x}, whose rate depends on where in the step each stage lies."""
    exact = np.exp(-2.0) + forced
    coarse, fine = (abs(decayed(2.0, stages, steps, forced) - exact) for steps in (20, 40))
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.15)


@pytest.mark.parametrize("coefficient", [2.7e-6, 5.4e-6])
def test_master_curve_is_a_direct_simulation_in_revolutions_at_any_wear_coefficient(coefficient):
    """dh/dN = K·τ·ω1·(…) marched in revolutions, midpoint steps of 20 turns at K = 2.7e-6 /N."""
    τ, ω1 = 9.6049e-05, 2 * np.pi * TEN.speed_hz
    turns = 20 * 2.7e-6 / coefficient
    factor = coefficient * τ * ω1
    profile, near, revolutions = model().unworn, None, 0.0
    while profile.max_depth < 25e-6:
        # the first turns are the fastest to change
        dN = turns if revolutions > 5 * turns else turns / 4
        near = model().steady(profile, TEN, near)
        half = profile.worn_by(0.5 * dN * factor * wear_per_revolution(MESH, near.contact_forces, HALF_WIDTH))
        near = model().steady(half, TEN, near)
        profile = profile.worn_by(dN * factor * wear_per_revolution(MESH, near.contact_forces, HALF_WIDTH))
        revolutions += dN
    path = evolved(30e-6)
    master = CubicSpline([p.work for p in path], [p.profile.depth for p in path])
    expected = master(factor * revolutions)
    assert np.abs(profile.depth - expected).max() < 1e-3 * profile.max_depth


def test_going_on_from_a_worn_profile_is_the_same_as_going_through():
    path = wear_path(TEN, 50e-6)
    half = path[len(path) // 2]
    rest = evolved(50e-6, start=half.profile)
    through = CubicSpline([p.work for p in path], [p.profile.depth for p in path])
    work = min(half.work + rest[-1].work, path[-1].work)
    last = CubicSpline([p.work for p in rest], [p.profile.depth for p in rest])(work - half.work)
    assert np.abs(last - through(work)).max() < 1e-3 * last.max()


def test_k_keeps_its_value_where_the_dwell_time_is_inverse_to_the_speed():
    at_10 = specific_wear_rate(PAIR, 2.7e-6, 9.6049e-5, 10.0)
    at_14 = specific_wear_rate(PAIR, 2.7e-6, 9.6049e-5 * 10.0 / 14.0, 14.0)
    assert at_14 == pytest.approx(at_10, rel=1e-12)


def test_pinion_has_73_percent_of_the_depth():
    assert pinion_share(PAIR) == pytest.approx(0.7324, abs=5e-5)


def test_step_in_micrometres_is_refused():
    with pytest.raises(ParameterError, match=r"largest_step = 2 m is outside \(0, 1e-4\); micrometres"):
        evolved(1e-5, largest_step=2.0)


def test_evolution_stops_with_its_reason_where_no_steady_state_is_found():
    twin = model()

    def solver(profile, near):
        found = twin.steady(profile, FOURTEEN, near)
        return found if profile.max_depth < 10e-6 else replace(found, converged=False)

    reached = []
    with pytest.raises(NotConverged):
        for point in evolve(twin.mesh, solver, twin.unworn, HALF_WIDTH, 20e-6):
            reached.append(point.profile.max_depth)
    assert 7e-6 < reached[-1] < 10e-6


def test_profile_is_smooth_between_its_points():
    profile = worn(TEN, 50e-6)
    s = np.linspace(-5e-3, 4.4e-3, 777)
    depth, slope = profile.at(s)
    ahead, _ = profile.at(s + 1e-8)
    behind, _ = profile.at(s - 1e-8)
    assert (ahead - behind) / 2e-8 == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())
    assert depth.max() <= profile.max_depth * (1 + 1e-4)
