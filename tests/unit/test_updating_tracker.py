"""The wear coefficient as the slope of work over revolutions."""

import numpy as np
import pytest

from twin.updating.tracker import WearTrack

RATE = 4.0
STD = 0.01  # relative, of one window's work


def tracked(works, counts, std=STD, rate=RATE):
    """Tracks after each window."""
    track, out = WearTrack.unworn(rate), []
    for n, x in zip(counts, works, strict=True):
        track = track.followed(n, x, std * x)
        out.append(track)
    return out


COUNTS = np.arange(1, 11) * 1000.0


def test_constant_rate_is_recovered_from_a_prior_three_times_off():
    random = np.random.default_rng(2)
    works = 3 * RATE * COUNTS * (1 + STD * random.normal(size=COUNTS.size))
    last = tracked(works, COUNTS)[-1]
    assert last.rate == pytest.approx(3 * RATE, rel=0.05)
    assert abs(last.rate - 3 * RATE) < 3 * last.rate_std
    assert last.work == pytest.approx(3 * RATE * COUNTS[-1], rel=2 * STD)


def test_prior_rate_ten_times_off_is_left_with_the_first_window():
    first = tracked([10 * RATE * 1000.0], [1000.0])[0]
    assert first.rate == pytest.approx(10 * RATE, rel=0.02)


def test_std_of_the_rate_covers_its_error_over_many_campaigns():
    inside = 0
    for seed in range(200):
        random = np.random.default_rng(seed)
        works = RATE * COUNTS * (1 + STD * random.normal(size=COUNTS.size))
        last = tracked(works, COUNTS)[-1]
        inside += abs(last.rate - RATE) < 1.6449 * last.rate_std
    assert inside / 200 > 0.9  # a constant rate wanders less than the filter allows for


def test_running_in_is_followed():
    """The rate falls to two fifths with 2000 revolutions' decay; at the end the track goes at the late rate."""
    counts = np.arange(1, 13) * 1500.0
    works = RATE * (counts + 1.5 * 2000 * (1 - np.exp(-counts / 2000)))
    last = tracked(works, counts, std=0.005)[-1]
    assert last.rate == pytest.approx(RATE, rel=0.06)
    assert works[-1] / counts[-1] > 1.15 * RATE, "total work over total revolutions would not do"


def test_covariance_stays_positive_and_correlated_within_bounds():
    random = np.random.default_rng(3)
    counts = np.cumsum(random.uniform(1, 3000, 60))
    works = RATE * counts * np.exp(0.3 * random.normal(size=60))
    for track in tracked(np.maximum.accumulate(works), counts):
        assert track.var_work > 0 and track.var_rate > 0
        assert track.cov**2 <= track.var_work * track.var_rate * (1 + 1e-9)
        assert track.rate > 0


def test_prediction_spreads_with_revolutions():
    track = tracked(RATE * COUNTS, COUNTS)[-1]
    stds = [track.predicted(COUNTS[-1] + n).work_std for n in (0.0, 1000.0, 5000.0)]
    assert stds[0] < stds[1] < stds[2]


def test_window_without_revolutions_between_only_sharpens_the_work():
    track = tracked(RATE * COUNTS, COUNTS)[-1]
    again = track.followed(COUNTS[-1], track.work, STD * track.work)
    assert again.work == pytest.approx(track.work)
    assert again.work_std < track.work_std


def test_rescaled_track_has_the_same_relative_uncertainty():
    track = tracked(RATE * COUNTS, COUNTS)[-1]
    other = track.rescaled(1.7)
    assert other.rate / track.rate == pytest.approx(1.7)
    assert other.rate_std / other.rate == pytest.approx(track.rate_std / track.rate)
    assert other.work_std / other.work == pytest.approx(track.work_std / track.work)
