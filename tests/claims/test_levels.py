"""Level against wear depth: curves against steady states and limits, the relation against data of known making."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from tests.dynamics_cases import RIG, model
from twin.dynamics.hunting import HuntingPeriod
from twin.errors import ParameterError
from twin.levels.causes import drawn
from twin.levels.curve import LevelCurve, level_curve, linear_curve, uneven
from twin.levels.left_out import (
    each_without,
    leave_out,
    monotone_cubic,
    of_curve,
    of_twin,
    spline,
    straight_line,
)
from twin.levels.relation import Cases, Form, Origin, Relation, falling_region, fit
from twin.levels.trials import LEAST_GAIN, Choice, Fits, choose, choose_without_each, halves, judge, kept
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
    assert not found.apart.any()


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
        apart=zero,
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
    found = replace(fit(made(), CURVES), origin=Origin(asset="rig", causes=("run-in",), sensor="a2", band=(0.0, 2e3)))
    again = Relation.from_dict(found.to_dict())
    assert again.origin == found.origin
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


@pytest.mark.slow
def test_case_left_out_takes_no_part_in_its_own_prediction():
    cases = made()
    i = 20
    spoiled = replace(cases, level={k: np.where(np.arange(v.size) == i, 3 * v, v) for k, v in cases.level.items()})
    at = i - 4  # of the worn ones
    plain, other = (of_twin(c, CURVES).relative["fast"][at] + 1 for c in (cases, spoiled))
    assert other == pytest.approx(plain / 3, rel=1e-9)
    plain, other = (of_curve(c, straight_line)[0].relative["fast"][at] + 1 for c in (cases, spoiled))
    assert other == pytest.approx(plain / 3, rel=1e-9)


def test_what_all_speeds_of_an_assembly_share_is_seen_from_the_other_speed():
    alone, known = (of_twin(made(), CURVES, assembly=a) for a in (False, True))
    assert known.mean("fast") < 0.7 * alone.mean("fast")
    nothing = made(assembly=0.0)
    alone, known = (of_twin(nothing, CURVES, assembly=a) for a in (False, True))
    assert known.mean("fast") < 1.1 * alone.mean("fast")


def test_assembly_earns_the_density_of_all_speeds_over_that_of_each_and_no_more():
    cases, joint, each = made(), 0.0, 0.0
    for i, (depth, others) in zip(np.flatnonzero(cases.worn), each_without(cases), strict=True):
        relation = fit(others, CURVES)
        off = [np.log(v[i] / float(relation.level(k, depth))) for k, v in cases.level.items()]
        rest, common = [relation.rest_std[k] ** 2 for k in CURVES], relation.assembly_std**2
        joint += multivariate_normal.logpdf(off, cov=np.diag(rest) + common)
        each += sum(norm.logpdf(off, scale=np.sqrt(np.array(rest) + common)))
    alone, known = (of_twin(cases, CURVES, assembly=a).log_density for a in (False, True))
    assert alone == pytest.approx(each, rel=1e-9) and known == pytest.approx(joint, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("of", ["twin", "curve"])
def test_speeds_that_scatter_together_earn_what_their_correlation_is_worth(of):
    """Of ρ the density of two normals together is −½·ln(1 − ρ²) a case above that of each by itself."""
    cases = made(n=200)
    worth = -0.5 * np.log(1 - (0.1**2 / (0.1**2 + 0.03**2)) ** 2)
    twin = [of_twin(cases, CURVES, assembly=a) for a in (False, True)]
    alone, known = twin if of == "twin" else of_curve(cases, cube)
    # the worth scatters by ρ over the root of the cases, 0.07; estimating S costs as much
    assert (known.log_density - alone.log_density) / cases.worn.sum() == pytest.approx(worth, abs=0.2)


def cube(depth, level, at):
    return float(np.exp(np.polyval(np.polyfit(depth, np.log(level), 3), at)))


def test_curve_is_given_the_other_speed_as_the_twin_is():
    cases = made(assembly=0.3)
    alone, known = of_curve(cases, cube)
    assert known.mean("fast") < 0.5 * alone.mean("fast")


@pytest.mark.slow
@pytest.mark.parametrize(("assembly", "expected"), [(0.1, ("assembly",)), (0.0, ())])
def test_cause_is_chosen_where_it_is_there_and_only_there(assembly, expected):
    assert choose(made(assembly=assembly), Fits({"twin": CURVES, "other": OTHER})).causes == expected
    turned = choose(made(assembly=assembly), Fits({"twin": OTHER, "other": CURVES}))
    assert turned.causes == ("other", *expected)


@pytest.mark.slow
def test_case_left_out_has_no_say_in_what_is_chosen_for_it():
    """Its level, eight times as high, changes neither the choice nor what is predicted."""
    cases = made(n=18, assembly=0.0)
    i = 10
    spoiled = replace(cases, level={k: np.where(np.arange(v.size) == i, 8 * v, v) for k, v in cases.level.items()})
    found = [choose_without_each(c, Fits({"twin": OTHER, "other": CURVES})) for c in (cases, spoiled)]
    assert found[0][0][i - 4] == found[1][0][i - 4] == Choice(curves="other")
    plain, other = (errors.relative["fast"][i - 4] + 1 for _, _, errors in found)
    assert other == pytest.approx(plain / 8, rel=1e-9)
    assert choose(spoiled, Fits({"twin": OTHER, "other": CURVES})) != Choice(curves="other")


@pytest.mark.slow
def test_best_of_many_curves_that_fit_by_chance_is_not_kept():
    """Twelve curves with random bends: one of them fits best, but choosing so predicts the case left out no better."""
    rng, at = np.random.default_rng(0), np.linspace(0, 900e-6, 12)
    curves = {"twin": CURVES}
    for i in range(12):
        bends = {k: np.exp(np.interp(c.depth, at, 0.3 * rng.standard_normal(12))) for k, c in CURVES.items()}
        curves[f"bends {i}"] = {k: replace(c, level=c.level * bends[k]) for k, c in CURVES.items()}
    cases, fits = made(n=18, assembly=0.0, rest=0.2, seed=0), Fits(curves)
    best, (_, _, errors) = choose(cases, fits), choose_without_each(cases, fits)
    base = leave_out(cases, lambda others: fits.of(others, "twin", Form()), assembly=False)
    assert best.causes and kept(best, errors.log_density - base.log_density) == Choice()


def test_combination_is_kept_where_choosing_it_gained_enough():
    other = Choice(curves="other")
    assert kept(other, LEAST_GAIN) == other and kept(other, LEAST_GAIN - 0.1) == Choice()


@pytest.mark.slow
def test_halves_share_no_worn_case_and_judge_every_one():
    cases = made()
    first, second = halves(cases)
    assert not np.any(first & second & cases.worn) and np.all(first | second)
    errors = judge(cases, Fits({"twin": CURVES}))
    assert all(e.relative["fast"].size == cases.worn.sum() for e in errors.values())
    assert errors["background"].mean("fast") < 0.12
    assert errors["background + assembly"].mean("fast") < 0.7 * errors["background"].mean("fast")


def test_value_of_a_cause_comes_from_the_cases_that_are_known():
    """Of several curves those that fit; a case left out has no say in which, and the same fit is made once."""
    wrong = {k: replace(c, level=c.level**1.5) for k, c in CURVES.items()}
    fits = Fits({"twin": OTHER, "values #1": CURVES, "values #2": wrong})
    assert fits.causes() == ("twin", "values")
    cases = made()
    assert fits.of(cases, "values", Form()).curves is CURVES
    spoiled = replace(cases, level={k: np.where(cases.depth > 790e-6, 9 * v, v) for k, v in cases.level.items()})
    (_, known), (_, other) = each_without(cases)[-1], each_without(spoiled)[-1]
    assert fits.of(other, "values", Form()) is fits.of(known, "values", Form())


def test_run_in_leaves_the_unworn_level_to_itself():
    cases = made(assembly=0.0)
    louder = replace(cases, level={k: np.where(cases.worn, v, 3 * v) for k, v in cases.level.items()})
    assert fit(louder, CURVES, Form(run_in=True)).background["fast"] == pytest.approx(4.0, rel=0.05)
    assert choose(louder, Fits({"twin": CURVES})) == Choice(form=Form(run_in=True))


def test_straight_line_and_spline_give_back_what_they_can_hold():
    x = np.linspace(50e-6, 800e-6, 30)
    assert straight_line(x, 2.0 + 1e4 * x, 333e-6) == pytest.approx(2.0 + 1e4 * 333e-6)
    twice = np.concatenate((x, x[5:9]))  # cases that share a depth
    for curve in (spline, monotone_cubic):
        for d in (x, twice, x[::10]):
            assert curve(d, np.exp(3e3 * d), 333e-6) == pytest.approx(np.exp(3e3 * 333e-6), rel=1e-3)


def test_region_in_which_the_level_falls_is_found_and_a_rising_one_is_not():
    d = np.linspace(1e-4, 8e-4, 23)
    assert falling_region(d, d) is None
    found = falling_region(d, np.where(d < 6e-4, d, 1.2e-3 - d))
    assert found.start < 6.1e-4 and found.spearman <= 0 and found.p <= 0.05


SERIES = 300


@pytest.mark.slow
@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("scatter", [0.06, 0.13])
def test_level_that_goes_on_rising_is_seldom_said_not_to(power, scatter):
    """As many cases, as far apart and as noisy as those of the measured series."""
    rng = np.random.default_rng(1)
    d = np.linspace(40e-6, 825e-6, 23)
    level = (1.0 + 4.0 * (d / d[-1]) ** power) * np.exp(scatter * rng.standard_normal((SERIES, d.size)))
    false = sum(falling_region(d, r, draws=200) is not None for r in level)
    assert false / SERIES <= 0.05 + 2 * np.sqrt(0.05 * 0.95 / SERIES)


@pytest.mark.slow
@pytest.mark.parametrize(("falls_to", "found"), [(1.0, 0.5), (0.85, 0.9)])
def test_level_that_levels_off_halfway_is_said_to_as_often_as_its_ranks_allow(falls_to, found):
    """Ranks of a level that stays where it is fall as often as they rise: half of such series at least are told."""
    rng = np.random.default_rng(1)
    d = np.linspace(40e-6, 825e-6, 23)
    level = 1.0 + 4.0 * np.minimum(d / 400e-6, 1.0)
    level = level * np.interp(d, [400e-6, 825e-6], [1.0, falls_to])
    told = [falling_region(d, level * np.exp(0.06 * rng.standard_normal(d.size)), draws=200) for _ in range(100)]
    assert np.mean([t is not None for t in told]) >= found - 2 * np.sqrt(found * (1 - found) / 100)
    starts = [t.start for t in told if t is not None]
    assert np.median(starts) == pytest.approx(400e-6, abs=150e-6)


def test_depths_that_are_told_apart_have_levels_in_their_order_19_times_of_20():
    relation = fit(made(n=200), CURVES)
    depth, std = relation.told_to("fast"), relation.std("fast")
    rng = np.random.default_rng(1)
    here, there = (
        float(np.log(relation.level("fast", d))) + std * rng.standard_normal(20000) for d in (depth, relation.deepest)
    )
    assert np.mean(there > here) == pytest.approx(0.95, abs=0.01)  # the grid of depths, 1/400, moves it by some 0.005


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
