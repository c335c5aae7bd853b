"""The relation of level and depth by the cases alone: order, bounds, unworn gears, and indicators without a model."""

from dataclasses import replace

import numpy as np
import pytest

from tests.claims.test_levels import CURVES, made
from twin.errors import ParameterError
from twin.levels.basis import by_cases
from twin.levels.monotone import fit_monotone, monotone
from twin.levels.relation import INDICATOR, Quantity, Relation
from twin.levels.wear_by_level import bounds_reason, stated

CONDITIONS = {k: c.condition for k, c in CURVES.items()}
TEETH = (18, 35)


def relation(cases=None):
    return fit_monotone(made(n=60) if cases is None else cases, CONDITIONS, TEETH)


def test_cubic_passes_through_cases_that_rise_and_never_falls():
    depth = np.linspace(50e-6, 800e-6, 30)
    level = 1.0 + 40 * (depth / 800e-6) ** 1.5
    np.testing.assert_allclose(monotone(depth, level, depth), level, rtol=1e-12)
    rng = np.random.default_rng(3)
    noisy = level * np.exp(0.3 * rng.standard_normal(depth.size))
    at = np.linspace(0, 1e-3, 500)
    assert np.all(np.diff(monotone(depth, noisy, at)) >= 0)


def test_level_beyond_the_outermost_cases_is_theirs():
    depth, level = np.array([100e-6, 200e-6, 300e-6]), np.array([1.0, 2.0, 4.0])
    np.testing.assert_allclose(monotone(depth, level, np.array([0.0, 1e-3])), [1.0, 4.0])


def test_scatter_is_that_of_cases_left_out():
    found = relation(made(n=200, assembly=0.1, rest=0.03))
    S = found.covariance(list(CONDITIONS))
    assert np.sqrt(S[0, 1]) == pytest.approx(0.1, rel=0.3)  # what the conditions of an assembly share
    assert np.sqrt(S[0, 0] - S[0, 1]) == pytest.approx(0.03, abs=0.02)
    assert found.std("fast") == pytest.approx(np.sqrt(S[0, 0]))


def test_correlation_of_few_cases_that_share_nothing_is_shrunk():
    sizes = []
    for seed in range(20):
        S = relation(made(n=20, assembly=0.0, rest=0.05, seed=seed)).covariance(list(CONDITIONS))
        sizes.append(abs(S[0, 1]) / np.sqrt(S[0, 0] * S[1, 1]))
    assert np.median(sizes) < 0.1  # unshrunk it would be some 0.15


def test_band_covers_nine_in_ten_of_new_assemblies():
    known, new = relation(made(n=200)), made(n=200, seed=7)
    inside = []
    for i in np.flatnonzero(new.worn & (new.depth < 600e-6) & (new.depth > 100e-6)):
        found = known.depth({k: float(v[i]) for k, v in new.level.items()})
        inside.append(found.p05 <= new.depth[i] <= (found.p95 if found.bounded else np.inf))
    assert 0.82 <= np.mean(inside) <= 0.98  # 90 %, three deviations of some 130 draws


def test_too_few_depths_are_refused():
    cases = made()
    few = cases.only((cases.depth == 0) | (cases.depth < 50e-6))
    with pytest.raises(ParameterError, match="worn depths are too few for a relation: at least 3"):
        relation(few)


# unworn gears


def test_unworn_gears_are_not_ruled_out_at_their_own_level_and_are_far_above_it():
    cases = made(n=60)
    found = relation(cases)
    unworn = {k: float(np.exp(np.log(v[~cases.worn]).mean())) for k, v in cases.level.items()}
    low = found.depth(unworn)
    assert low.unworn and low.p05 == 0 and "the levels may be those of unworn gears" in bounds_reason(low)
    assert stated(low).median is None and stated(low).p95 > 0
    high = found.depth({k: 3 * v for k, v in unworn.items()})
    assert not high.unworn and high.p05 > 0 and bounds_reason(high) is None
    assert stated(high).median == high.median


def test_run_in_gears_quieter_than_new_ones_do_not_hide_that_these_are_louder():
    """New gears at the level of some worn depth: that depth is not told from none."""
    cases = made(n=60, assembly=0.02)
    worn_level = {k: float(relation(cases).level(k, 200e-6)) for k in CONDITIONS}
    louder = replace(cases, level={k: np.where(cases.worn, v, worn_level[k]) for k, v in cases.level.items()})
    found = relation(louder).depth(worn_level)
    assert found.unworn and found.p05 == 0 and found.p95 > 200e-6


def test_no_unworn_assembly_says_nothing_of_unworn_gears():
    cases = made()
    found = relation(cases.only(cases.worn))
    assert found.unworn is None
    assert not found.depth({k: float(v[4]) for k, v in cases.level.items()}).unworn


# a level that no longer rises


def test_depth_on_a_plateau_has_no_upper_bound_though_the_deepest_case_dips():
    cases = made(n=60, assembly=0.02)
    stop = {k: float(relation(cases).level(k, 500e-6)) for k in CONDITIONS}
    level = {k: np.where(cases.depth > 500e-6, stop[k], v) for k, v in cases.level.items()}
    for v in level.values():
        v[-1] *= 0.7
    found = relation(replace(cases, level=level)).depth(stop)
    assert not found.bounded and 350e-6 < found.p05 < 500e-6
    assert "an upper bound is not known" in bounds_reason(found)


# indicators


def with_indicator(value):
    cases = made(n=24, assembly=0.2, rest=0.1)
    number = {"number": value(cases.depth)}
    every = replace(cases, level=cases.level | number, scatter=cases.scatter | {"number": np.zeros(cases.depth.size)})
    return every, CONDITIONS | {"number": CONDITIONS["fast"]}


@pytest.mark.slow
def test_indicator_joins_where_it_tells_depths_and_only_there():
    rng = np.random.default_rng(5)
    clear, conditions = with_indicator(lambda d: np.exp(d / 100e-6 + 0.1 * rng.standard_normal(d.size)))
    found = by_cases(clear, conditions, CONDITIONS, TEETH, 3.0)
    assert found.indicators["number"] > 3 and set(found.relation.curves) == set(conditions)
    noise, _ = with_indicator(lambda d: np.exp(rng.standard_normal(d.size)))
    found = by_cases(noise, conditions, CONDITIONS, TEETH, 3.0)
    assert not found.indicators and set(found.relation.curves) == set(CONDITIONS)
    assert len(found.relations) == noise.worn.sum()


def test_relation_with_an_indicator_comes_back_whole_and_takes_no_window_for_it():
    rng = np.random.default_rng(5)
    clear, conditions = with_indicator(lambda d: np.exp(d / 100e-6 + 0.1 * rng.standard_normal(d.size)))
    slow_first = {"number": conditions["number"]} | CONDITIONS
    units = {"number": INDICATOR, "fast": "g", "slow": "m/s2"}
    found = replace(
        fit_monotone(clear, slow_first, TEETH),
        quantities={k: Quantity(column=f"of {k}", unit=units[k]) for k in slow_first},
    )
    again = Relation.from_dict(found.to_dict())
    assert again.quantities == found.quantities and again.unworn.assemblies == 4
    levels = {k: float(v[10]) for k, v in clear.level.items()}
    assert again.depth(levels) == found.depth(levels)
    assert again.condition_of(45.0, 5.0) == "fast"
