"""Level against wear depth: curves against steady states and limits, the relation against data of known making."""

from dataclasses import replace

import numpy as np
import pytest

from tests.dynamics_cases import RIG, model
from twin.dynamics.hunting import HuntingPeriod
from twin.errors import ParameterError
from twin.levels.curve import LevelCurve, level_curve, linear_curve, uneven
from twin.levels.left_out import of_curve, of_twin, spline, straight_line
from twin.levels.relation import Cases, Form, Relation, falling_region, fit
from twin.levels.trials import Choice, choose, drawn, halves, judge
from twin.levels.wear import by_load_sharing, by_sliding, quasi_static_state, with_even_part
from twin.model import Condition
from twin.wear.curve import MasterCurve

SLOW = Condition(speed_hz=1.0, torque=10.0)
TEN = Condition(speed_hz=10.0, torque=10.0)
BAND = RIG.band


@pytest.fixture(scope="module")
def worn():
    return by_load_sharing(model(), TEN, 60e-6)


def test_quasi_static_teeth_carry_the_mean_force_at_every_instant():
    contacts = model().mesh.contacts(model().unworn, 10.0)
    state = quasi_static_state(contacts, 560.0)
    np.testing.assert_allclose(state.mesh_force, 560.0, rtol=1e-9)
    assert np.all(state.contact_forces[contacts.side < 0] == 0)


def test_slow_gears_wear_as_the_quasi_static_mesh_does(worn):
    """Wear without inertia is the limit of the dynamic law at low speed."""
    dynamic = MasterCurve.build(model(), SLOW, model().unworn, 50e-6)
    here, there = worn(50e-6), dynamic.profile(50e-6)
    s = np.linspace(*here.active, 200)
    np.testing.assert_allclose(here.at(s)[0], there.at(s)[0], atol=0.02 * 50e-6)


@pytest.mark.parametrize("depth", [10e-6, 35e-6, 60e-6])
def test_profile_has_the_largest_depth_asked_for(worn, depth):
    assert worn(depth).max_depth == pytest.approx(depth, rel=1e-3)
    assert by_sliding(model())(depth).max_depth == pytest.approx(depth, rel=1e-3)
    assert with_even_part(worn, 0.3)(depth).max_depth == pytest.approx(depth, rel=1e-3)


def test_depth_beyond_what_was_worn_is_refused(worn):
    with pytest.raises(ParameterError, match="outside 0 …"):
        worn(100e-6)


def test_level_is_that_of_the_steady_state_where_there_is_one(worn):
    depths = [0.0, 20e-6, 50e-6]
    found = level_curve(model(), TEN, worn, depths, band=BAND, duration=1.0)
    steady = [model().acceleration_rms(model().steady(worn(d), TEN).require_converged(), BAND) for d in depths]
    np.testing.assert_allclose(found.level, steady, rtol=0.01)
    np.testing.assert_allclose(found.scatter / found.level, 0, atol=0.005)
    assert not found.apart.any() and not found.back.any()


def test_evenly_deeper_flanks_sound_like_the_shape_alone(worn):
    """What is gone everywhere alike moves the gears, not the vibration."""
    plain = level_curve(model(), TEN, worn, [20e-6], band=BAND, duration=0.6)
    even = level_curve(model(), TEN, with_even_part(worn, 0.5), [40e-6], band=BAND, duration=0.6)
    assert even.level[0] == pytest.approx(plain.level[0], rel=0.01)


def test_linear_response_is_near_the_whole_one_while_no_contact_is_lost(worn):
    """What is left between them is the stiffness's variation over the mesh, some tenths of its mean."""
    depths = [20e-6, 50e-6]
    whole = level_curve(model(), TEN, worn, depths, band=BAND, duration=0.6)
    linear = linear_curve(model(), TEN, worn, depths, band=BAND)
    np.testing.assert_allclose(linear.level, whole.level, rtol=0.25)
    assert not linear.apart.any()


def test_teeth_part_when_light_gears_run_fast_on_deep_wear(worn):
    fast = Condition(speed_hz=40.0, torque=1.0)
    found = level_curve(model(), fast, worn, [20e-6, 60e-6], band=BAND, duration=0.3)
    linear = linear_curve(model(), fast, worn, [20e-6, 60e-6], band=BAND)
    assert found.apart[1] > 0.2
    assert found.level[1] / found.level[0] < linear.level[1] / linear.level[0]


def test_rising_depths_are_asked_for(worn):
    with pytest.raises(ParameterError, match="must rise"):
        level_curve(model(), TEN, worn, [20e-6, 10e-6], band=BAND)


def test_draw_stays_within_its_factors_and_leaves_the_rig_alone():
    rng = np.random.default_rng(1)
    spreads = {"masses.m4": 3.0, "damping.modal_ratio": 2.0}
    ratios = np.array([[drawn(RIG, spreads, rng).get(k) / RIG.get(k) for k in spreads] for _ in range(50)])
    assert np.all(ratios < [3, 2]) and np.all(ratios > [1 / 3, 1 / 2]) and np.all(ratios.std(axis=0) > 0.2)
    with pytest.raises(ParameterError, match="gives no such number"):
        drawn(RIG, {"masses.m99": 2.0}, rng)


# the relation, on data made by a formula


def made_curve(speed, power, bend=1e9):
    """A curve that rises by a power of the depth and levels off at `bend` [m]."""
    d = np.linspace(0, 900e-6, 30)
    zero = np.zeros_like(d)
    level = 1.0 + 1e3 * (d * 1e3) ** power / (1 + d / bend)
    return LevelCurve(
        teeth=(18, 35), condition=Condition(speed_hz=speed, torque=5.0), depth=d, level=level, scatter=zero,
        apart=zero, back=zero,
    )  # fmt: skip


CURVES = {"fast": made_curve(45.0, 1.2), "slow": made_curve(15.0, 1.0)}
OTHER = {"fast": made_curve(45.0, 0.4), "slow": made_curve(15.0, 2.0)}
GAIN, BACKGROUND = {"fast": 0.02, "slow": 0.01}, {"fast": 4.0, "slow": 1.0}


def made(n=40, assembly=0.1, rest=0.03, seed=1):
    rng = np.random.default_rng(seed)
    depth = np.concatenate((np.zeros(4), np.linspace(40e-6, 800e-6, n - 4)))
    a = assembly * rng.standard_normal(n)
    level = {
        k: np.hypot(BACKGROUND[k], GAIN[k] * c.at(depth)) * np.exp(a + rest * rng.standard_normal(n))
        for k, c in CURVES.items()
    }
    return Cases(
        name=tuple(map(str, range(n))), depth=depth, level=level, scatter={k: 0.01 * v for k, v in level.items()}
    )


def test_relation_finds_what_the_cases_were_made_of():
    found = fit(made(n=200), CURVES)
    for k in CURVES:
        assert found.gain[k] == pytest.approx(GAIN[k], rel=0.05)
        assert found.background[k] == pytest.approx(BACKGROUND[k], rel=0.1)
        assert found.rest_std[k] == pytest.approx(0.03, abs=0.02)
    assert found.assembly_std == pytest.approx(0.1, rel=0.25)


def test_relation_comes_back_from_its_data_whole():
    found = fit(made(), CURVES)
    again = Relation.from_dict(found.to_dict())
    for k in CURVES:
        np.testing.assert_array_equal(again.level(k, [0, 3e-4]), found.level(k, [0, 3e-4]))
    assert again.depth({"fast": 10.0}) == found.depth({"fast": 10.0})
    assert again.teeth == (18, 35)


def test_band_of_the_depth_covers_nine_in_ten():
    relation, inside, total = fit(made(n=200), CURVES), 0, 0
    new = made(n=200, seed=7)
    for i in np.flatnonzero(new.worn & (new.depth < 600e-6)):
        found = relation.depth({k: float(v[i]) for k, v in new.level.items()})
        inside += found.p05 <= new.depth[i] <= found.p95
        total += 1
    assert 0.84 <= inside / total <= 0.96  # 90 %, three deviations of 150 draws


def test_level_that_does_not_rise_any_more_gives_a_lower_bound():
    flat = {"fast": replace(CURVES["fast"], level=np.minimum(CURVES["fast"].level, 300.0))}
    cases = made()
    level = (
        np.hypot(4.0, 0.02 * flat["fast"].at(cases.depth))
        * cases.level["fast"]
        / np.hypot(4.0, 0.02 * CURVES["fast"].at(cases.depth))
    )
    relation = fit(replace(cases, level={"fast": level}, scatter={"fast": 0.01 * level}), flat)
    deep = relation.depth({"fast": float(relation.level("fast", 700e-6))})
    assert not deep.bounded and deep.p05 > 150e-6
    assert relation.depth({"fast": float(relation.level("fast", 100e-6))}).bounded
    assert relation.told_to("fast") < 450e-6


def test_condition_is_told_by_speed_and_load():
    relation = fit(made(), CURVES)
    assert relation.condition_of(44.8, 5.2) == "fast" and relation.condition_of(15.1, None) == "slow"
    assert relation.condition_of(30.0, 5.0) is None and relation.condition_of(45.0, 10.0) is None


def test_case_left_out_takes_no_part_in_its_own_prediction():
    cases = made()
    i = 20
    spoiled = replace(cases, level={k: np.where(np.arange(v.size) == i, 3 * v, v) for k, v in cases.level.items()})
    at = i - 4  # of the worn ones
    plain, other = (of_twin(c, CURVES).relative["fast"][at] + 1 for c in (cases, spoiled))
    assert other == pytest.approx(plain / 3, rel=1e-9)
    plain, other = (of_curve(c, straight_line).relative["fast"][at] + 1 for c in (cases, spoiled))
    assert other == pytest.approx(plain / 3, rel=1e-9)


def test_what_all_speeds_of_an_assembly_share_is_seen_from_the_other_speed():
    alone, known = (of_twin(made(), CURVES, assembly=a) for a in (False, True))
    assert known.mean("fast") < 0.7 * alone.mean("fast")
    nothing = made(assembly=0.0)
    alone, known = (of_twin(nothing, CURVES, assembly=a) for a in (False, True))
    assert known.mean("fast") < 1.1 * alone.mean("fast")


@pytest.mark.parametrize(("assembly", "expected"), [(0.1, ("assembly",)), (0.0, ())])
def test_cause_is_chosen_where_it_is_there_and_only_there(assembly, expected):
    assert choose(made(assembly=assembly), {"twin": CURVES, "other": OTHER}).causes == expected
    turned = choose(made(assembly=assembly), {"twin": OTHER, "other": CURVES})
    assert turned.causes == ("other", *expected)


def test_halves_share_no_worn_case_and_judge_every_one():
    cases = made()
    first, second = halves(cases)
    assert not np.any(first & second & cases.worn) and np.all(first | second)
    errors = judge(cases, {"twin": CURVES})
    assert errors["chosen"].relative["fast"].size == cases.worn.sum()
    assert errors["background"].mean("fast") < 0.12


def test_run_in_leaves_the_unworn_level_to_itself():
    cases = made(assembly=0.0)
    louder = replace(cases, level={k: np.where(cases.worn, v, 3 * v) for k, v in cases.level.items()})
    assert fit(louder, CURVES, Form(run_in=True)).background["fast"] == pytest.approx(4.0, rel=0.05)
    assert choose(louder, {"twin": CURVES}) == Choice(form=Form(run_in=True))


def test_straight_line_and_spline_give_back_what_they_can_hold():
    x = np.linspace(50e-6, 800e-6, 30)
    assert straight_line(x, 2.0 + 1e4 * x, 333e-6) == pytest.approx(2.0 + 1e4 * 333e-6)
    assert spline(x, np.exp(3e3 * x), 333e-6) == pytest.approx(np.exp(3e3 * 333e-6), rel=1e-3)


def test_region_in_which_the_level_falls_is_found_and_a_rising_one_is_not():
    d = np.linspace(1e-4, 8e-4, 15)
    assert falling_region(d, d) is None
    start, ρ = falling_region(d, np.where(d < 6e-4, d, 1.2e-3 - d))
    assert start < 6.1e-4 and ρ <= 0
    assert falling_region(d, np.minimum(d, 6e-4) - 0.1 * np.maximum(d - 6e-4, 0))[0] <= 6.1e-4


def test_too_few_cases_and_levels_that_are_not_positive_are_refused():
    with pytest.raises(ParameterError, match="too few"):
        fit(made(n=6).only(np.arange(6) < 2), CURVES)
    bad = made()
    with pytest.raises(ParameterError, match="positive level"):
        replace(bad, level={k: -v for k, v in bad.level.items()})


def test_uneven_teeth_take_their_share_off_the_drive_flanks_alone_with_its_slope(worn):
    profile, mesh = worn(50e-6), model(256).mesh
    at = HuntingPeriod(mesh=mesh).first_passages(20)
    base = mesh.pair.base_radius[0]
    added, slope = uneven(profile, 0.2, 52, base, 1)(at)
    assert not added[at.side[:, 0] < 0].any() and not slope[at.side[:, 0] < 0].any()
    h = profile.at(at.position)[0]
    for tooth in (3, 4):  # one factor a gear tooth, deeper wear takes material away
        own = (at.gear_tooth == tooth) & (at.side > 0) & (h > 1e-6)
        factor = -added[own] / h[own]
        np.testing.assert_allclose(factor, factor[0])
    step = 1e-9
    moved = replace(at, position=at.position + step * base)  # θ1 further by `step`
    rise = (uneven(profile, 0.2, 52, base, 1)(moved)[0] - added) / step
    np.testing.assert_allclose(rise, slope, atol=1e-3 * np.abs(slope).max())
