"""Remaining life on the master curve."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri

from tests.updating_cases import curve
from twin.quantiles import Z95
from twin.updating.remaining_life import remaining_life
from twin.updating.tracker import WearTrack

CURVE = curve()
RATE = 2e-3 * CURVE.work_at(60e-6)  # the curve's end in 500 revolutions


def track(share=0.5, rate=RATE, spread=0.02):
    """A track at a share of the curve's work."""
    work = share * CURVE.work_at(60e-6)
    return WearTrack(
        revolutions=work / rate, work=work, rate=rate, var_work=(spread * work) ** 2, cov=0.0,
        var_rate=(spread * rate) ** 2, windows=4,
    )  # fmt: skip


def life(of, end=55e-6, base=0.0):
    return remaining_life(of, CURVE, base, end)


def test_life_is_work_to_go_over_rate_and_the_band_holds_it():
    found = life(track())
    assert found.median == pytest.approx((CURVE.work_at(55e-6) - track().work) / RATE)
    assert found.p05 < found.median < found.p95
    assert not found.reached


def test_half_the_wear_coefficient_doubles_the_life_of_the_same_flanks():
    assert life(track(rate=RATE / 2)).median == pytest.approx(2 * life(track()).median)


def test_life_is_nothing_once_the_criterion_is_reached():
    found = life(track(share=1.0))
    assert (found.median, found.p05, found.p95, found.reached) == (0.0, 0.0, 0.0, True)


def test_uncertain_rate_widens_the_band_and_leaves_the_median():
    sure, unsure = life(track()), life(track(spread=0.3))
    assert unsure.median == pytest.approx(sure.median)
    assert unsure.p95 - unsure.p05 > 1.5 * (sure.p95 - sure.p05)


def test_life_beyond_the_curve_is_less_certain():
    within, beyond = life(track(), 59e-6), life(track(), 120e-6)
    assert beyond.p95 / beyond.median > within.p95 / within.median


def test_uncertain_present_depth_matters_most_near_the_end():
    near_end = track(share=0.88)
    sure = life(replace(near_end, var_work=0.0))
    unsure = life(near_end)
    assert unsure.p95 / unsure.median > 1.1 * sure.p95 / sure.median


def test_work_of_earlier_conditions_is_counted_once():
    base = 3.0 * CURVE.work_at(60e-6)
    later = replace(track(), work=track().work + base)
    assert life(later, base=base).median == pytest.approx(life(track()).median)


def test_depths_that_are_off_together_matter_most_near_the_end():
    def widening(share):
        sure = remaining_life(track(share), CURVE, 0.0, 55e-6)
        unsure = remaining_life(track(share), CURVE, 0.0, 55e-6, 0.03)
        assert unsure.median == sure.median
        return (unsure.p95 / unsure.median) / (sure.p95 / sure.median)

    assert widening(0.85) > widening(0.2) > 1.0


def test_end_that_is_only_just_reached_may_not_be():
    found = remaining_life(track(share=0.93), CURVE, 0.0, 55e-6, 0.03)
    assert found.reached and found.median == 0.0 and found.p05 == 0.0
    assert 0 < found.p95 < 100


def test_a_machine_that_does_not_wear_has_no_upper_bound_of_its_life_but_a_lower_one():
    """It was said to live 6.9e14 revolutions, 1.8e19 at most."""
    idle = track(share=1e-6, rate=1e-9 * RATE, spread=0.0)
    idle = replace(idle, var_work=(0.01 * RATE) ** 2, var_rate=(1e-3 * RATE) ** 2)
    found = life(idle)
    assert not found.measurable and not found.reached
    assert found.median == found.p95 == float("inf")
    fastest = idle.rate + 1.6449 * idle.rate_std
    assert found.p05 == pytest.approx((CURVE.work_at(55e-6) - idle.work) / fastest)


def test_a_life_is_stated_once_the_wear_rate_is_above_its_uncertainty():
    assert life(track(spread=0.6)).measurable and not life(track(spread=0.62)).measurable


def test_quantiles_and_probabilities_are_of_one_distribution():
    found = life(track())
    probabilities = np.array([0.01, 0.2, 0.5, 0.8, 0.99])
    assert [1 - found.beyond(n) for n in found.at(ndtri(probabilities))] == pytest.approx(probabilities)
    assert found.at(np.array([0.0, -Z95])) == pytest.approx([found.median, found.p05])
    assert found.beyond(0.0) == 1.0 and found.beyond(1e9) == pytest.approx(0.0, abs=1e-6)


def test_reached_end_leaves_the_chance_that_it_is_not():
    found = remaining_life(track(share=0.93), CURVE, 0.0, 55e-6, 0.03)
    assert 0 < found.beyond(0.0) < 0.5
    assert 1 - found.beyond(found.p95) == pytest.approx(0.95, abs=1e-3)


def test_life_without_an_upper_bound_states_a_probability_up_to_its_lower_bound_only():
    idle = replace(track(share=0.01), var_rate=(10 * RATE) ** 2)
    found = life(idle)
    assert found.beyond(0.5 * found.p05) == 0.95 and found.beyond(2 * found.p05) is None
    assert found.at(ndtri([0.05, 0.1])) == pytest.approx([found.p05, float("inf")], rel=1e-3)
