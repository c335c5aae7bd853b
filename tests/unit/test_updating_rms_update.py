"""The paper's update: K ← K/D until the twin's RMS is within 5 % of the measured (section 4.2)."""

import pytest

from twin.updating.rms_update import MAX_ITERATIONS, RmsTrack, update

TRACK = RmsTrack(revolutions=0.0, work=0.0, rate=1e-3)


def linear(work):
    """A level in proportion to the work."""
    return 2.0 * work


def test_level_in_proportion_to_work_needs_one_division():
    found = update(TRACK, 1000.0, measured=3.0, level=linear, threshold=0.05)
    assert found.updated and found.converged and found.iterations == 1
    assert found.track.rate == pytest.approx(1.5e-3)  # K/D with D = 2/3
    assert found.rms_predicted == pytest.approx(2.0)
    assert found.rms_after == pytest.approx(3.0)


def test_error_below_the_threshold_leaves_the_coefficient_alone():
    found = update(TRACK, 1000.0, measured=2.08, level=linear, threshold=0.05)
    assert not found.updated and found.iterations == 0
    assert found.track.rate == TRACK.rate
    assert found.track.work == pytest.approx(1.0)


def test_iteration_stops_as_soon_as_the_error_is_below_the_threshold():
    found = update(TRACK, 1000.0, measured=3.0, level=lambda x: 2.0 * x**0.5, threshold=0.05)
    assert found.converged
    assert abs(found.rms_after / 3.0 - 1) < 0.05
    assert 1 < found.iterations < 10


def test_only_the_wear_since_the_last_window_is_rescaled():
    worn = RmsTrack(revolutions=1000.0, work=1.0, rate=1e-3)
    found = update(worn, 2000.0, measured=5.0, level=linear, threshold=0.01)
    assert found.track.work == pytest.approx(2.5, rel=0.01)
    assert found.track.work == pytest.approx(1.0 + 1000 * found.track.rate)


def test_level_that_falls_before_it_rises_does_not_loop():
    def dipping(work):
        return 2.0 - work if work < 1.5 else 0.5 + (work - 1.5)

    found = update(TRACK, 1000.0, measured=0.3, level=dipping, threshold=0.05)
    assert found.iterations <= MAX_ITERATIONS
    assert not found.converged
    assert found.track.rate > 0


def test_level_that_nothing_reaches_says_that_it_did_not_converge():
    found = update(TRACK, 1000.0, measured=50.0, level=lambda x: min(x, 2.0), threshold=0.05)
    assert found.updated and not found.converged
    assert found.iterations == MAX_ITERATIONS


def test_nothing_is_updated_where_it_is_not_allowed_or_nothing_turned():
    assert not update(TRACK, 1000.0, measured=3.0, level=linear, threshold=0.05, allowed=False).updated
    standing = RmsTrack(revolutions=1000.0, work=1.0, rate=1e-3)
    found = update(standing, 1000.0, measured=3.0, level=linear, threshold=0.05)
    assert not found.updated and found.track.work == 1.0
