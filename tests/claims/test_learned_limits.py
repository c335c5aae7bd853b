"""Limits learned from healthy windows are exceeded by healthy windows as rarely as they say."""

import numpy as np
import pytest

from twin.learned_limits import DEFAULT, LearnedLimits, OperatingPoint, deviations, learned

RNG = np.random.default_rng(13)


@pytest.mark.parametrize("windows", [10, 15, 30])
@pytest.mark.parametrize("rate", [1e-2, 1e-3])
def test_rate_of_false_alarms_is_at_most_the_stated_one_and_not_far_below(windows, rate):
    healthy = RNG.standard_normal((200_000, windows))
    middle = np.median(healthy, axis=1)
    scatter = 1.4826 * np.median(np.abs(healthy - middle[:, None]), axis=1)
    next_one = RNG.standard_normal(len(healthy))
    found = np.mean(next_one > middle + deviations(windows, rate) * scatter)
    assert 0.3 * rate < found < 1.1 * rate


def test_one_spike_among_the_healthy_windows_hardly_moves_the_limits():
    values = list(np.exp(0.03 * RNG.standard_normal(10)))
    spiked = [*values[:-1], 50.0]
    assert learned(spiked).watch < 1.5 * learned(values).watch


def test_limits_scale_with_the_quantity_and_lie_a_quarter_and_a_doubling_above_it_at_least():
    steady = learned([2.0] * 10)
    assert steady.watch == pytest.approx(2.5) and steady.alarm == pytest.approx(4.0)
    values = np.exp(0.2 * RNG.standard_normal(12))
    one, ten = learned(values), learned(10 * values)
    assert (ten.watch, ten.alarm) == (pytest.approx(10 * one.watch), pytest.approx(10 * one.alarm))
    assert one.alarm > one.watch > one.median


def test_too_few_or_impossible_values_give_no_limit():
    assert learned([1.0] * (DEFAULT.windows - 1)) is None
    assert learned([0.0] * 10) is None and learned([1.0] * 9 + [np.nan]) is None
    assert learned([1.0] * 5, LearnedLimits(windows=5)) is not None


def test_operating_points_match_within_their_tolerances_only():
    at = OperatingPoint(speed=10.0, torque=10.0)
    assert at.matches(OperatingPoint(speed=10.9, torque=9.0))
    assert not at.matches(OperatingPoint(speed=12.0, torque=10.0))
    assert not at.matches(OperatingPoint(speed=10.0, torque=13.0))
    assert not at.matches(OperatingPoint(speed=10.0, torque=None))
