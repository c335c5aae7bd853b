"""A factor over frequency, learned from lines, with a prior of one."""

import numpy as np
import pytest

from twin.updating.frequency_correction import FrequencyCorrection

PRIOR = FrequencyCorrection(spread=0.5, reach=0.03, memory=12.0)
FAR = 190.0


def test_factor_is_one_where_nothing_was_learned():
    factor = PRIOR.predict([], np.array([190.0, 760.0]), 3)
    assert factor == pytest.approx(np.ones(2))


def test_factor_stays_at_the_prior_far_from_what_was_learned():
    factor = PRIOR.predict([(3.0, 760.0, 1.4 - 0.3j, 0.01)], np.array([FAR]), 3)
    assert factor == pytest.approx([1.0], abs=1e-9)


def test_learned_line_is_given_back_at_its_own_frequency():
    factor = PRIOR.predict([(3.0, 760.0, 1.4 - 0.3j, 0.01)], np.array([760.0]), 3)
    assert factor[0] == pytest.approx(1.4 - 0.3j, abs=1e-3)


def test_factor_between_two_learned_lines_lies_between_them():
    learned = [(3.0, 760.0, 1.2 + 0j, 0.01), (3.0, 780.0, 1.4 + 0j, 0.01)]
    factor = PRIOR.predict(learned, np.array([770.0]), 3)
    assert 1.2 < factor[0].real < 1.4


def test_what_was_learned_long_ago_counts_less():
    learned = [(0.0, 760.0, 1.4 + 0j, 0.01)]
    departures = [abs(PRIOR.predict(learned, np.array([760.0]), j)[0] - 1) for j in (0, 6, 12, 48)]
    assert departures[0] > departures[1] > departures[2] > departures[3]
    assert departures[2] == pytest.approx(0.4 * np.exp(-1), rel=1e-3)
    assert departures[3] < 0.01


def test_later_line_outweighs_an_earlier_one_that_contradicts_it():
    learned = [(0.0, 760.0, 0.8 + 0j, 0.02), (10.0, 760.0, 1.2 + 0j, 0.02)]
    factor = PRIOR.predict(learned, np.array([760.0]), 11)
    assert 1.1 < factor[0].real < 1.2


def test_many_noisy_lines_average():
    random = np.random.default_rng(5)
    learned = [(3.0, 760.0, 1.3 + 0.2 * random.normal() + 0.2j * random.normal(), 0.2) for _ in range(50)]
    factor = PRIOR.predict(learned, np.array([760.0]), 3)
    assert abs(factor[0] - 1.3) < 3 * np.sqrt(2) * 0.2 / np.sqrt(50)
