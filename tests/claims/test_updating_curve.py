"""The master curve as data: depth, work and profile name the same state."""

import numpy as np
import pytest

from tests.dynamics_cases import FOURTEEN, RIG
from tests.updating_cases import TEN, curve, model
from twin.errors import NotConverged, ParameterError
from twin.updating.memory import Memory, Segment, StoredProfile
from twin.updating.model_cache import curve_of
from twin.updating.update import reference_rate
from twin.wear.curve import MasterCurve

CURVE = curve()


@pytest.mark.parametrize("depth", [0.0, 0.13e-6, 7.77e-6, 31.3e-6, 60e-6, 90e-6])
def test_work_and_depth_are_each_others_inverse(depth):
    assert CURVE.depth_at(CURVE.work_at(depth)) == pytest.approx(depth, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("depth", [0.1e-6, 5e-6, 31.3e-6, 59e-6, 90e-6])
def test_profile_of_a_depth_is_that_deep(depth):
    assert CURVE.profile(depth).max_depth == pytest.approx(depth, rel=2e-3)


def test_work_rises_with_depth_and_its_slope_with_it():
    depths = np.linspace(0, 100e-6, 300)
    works = np.array([CURVE.work_at(d) for d in depths])
    assert np.all(np.diff(works) > 0)
    for depth in (10e-6, 40e-6, 80e-6):
        slope = (CURVE.work_at(depth + 1e-6) - CURVE.work_at(depth)) / 1e-6
        assert CURVE.work_per_depth(depth) == pytest.approx(slope, rel=1e-9)


def test_wear_coefficient_is_a_rescale_of_revolutions_not_another_curve():
    """Twice K: the same depth in half the revolutions, the same profile."""
    κ = reference_rate(RIG) * RIG.get("wear.K")
    depth = CURVE.depth_at(κ * 2000)
    assert CURVE.depth_at(2 * κ * 1000) == depth
    assert np.array_equal(CURVE.profile(depth).depth, CURVE.profile(CURVE.depth_at(2 * κ * 1000)).depth)


def test_curve_follows_on_smoothly_beyond_its_last_steady_state():
    end, step = CURVE.valid_to, 1e-9
    before, after = CURVE.work_at(end) - CURVE.work_at(end - 1e-6), CURVE.work_at(end + 1e-6) - CURVE.work_at(end)
    assert after == pytest.approx(before, rel=0.05)
    assert CURVE.profile(end + step).depth == pytest.approx(CURVE.profile(end).depth, abs=1e-8)
    assert CURVE.lines_at(2 * end).acceleration == pytest.approx(CURVE.acceleration[-1])


def test_lines_pass_through_the_curves_own_points():
    i = CURVE.depth.size // 2
    lines = CURVE.lines_at(float(CURVE.depth[i]))
    assert lines.transmission_error == pytest.approx(CURVE.transmission_error[i])
    assert lines.mean == pytest.approx(CURVE.mean_transmission_error[i])


def test_depth_before_the_start_is_refused_with_both_depths():
    later = MasterCurve.build(model(), TEN, CURVE.profile(30e-6), 32e-6)
    with pytest.raises(ParameterError, match=r"10\.00 µm lies before the curve's start at 30\.00 µm"):
        later.profile(10e-6)


def test_new_segment_continues_from_the_present_profile():
    first = Segment(speed_hz=10.0, torque=10.0, start_depth=0.0, start_work=0.0)
    one = curve_of(RIG, Memory(segments=(first,)))
    profile = StoredProfile.of(one.profile(12e-6))
    then = Segment(speed_hz=14.0, torque=9.0, start_depth=12e-6, start_work=CURVE.work_at(12e-6), start_profile=profile)
    two = curve_of(RIG, Memory(segments=(first, then)))
    assert two.condition == FOURTEEN
    assert two.depth[0] == pytest.approx(12e-6, rel=2e-3)
    assert two.work[0] == 0.0
    assert two.profiles[0] == pytest.approx(one.profile(12e-6).depth)
    assert two.profile(15e-6).depth.min() >= -1e-12
    assert np.all(two.profile(15e-6).depth >= one.profile(12e-6).depth - 1e-9), "no material grows back"


def test_segment_under_the_same_condition_is_the_same_curve():
    again = MasterCurve.build(model(), TEN, CURVE.profile(20e-6), 30e-6)
    grown = again.work_at(29e-6)
    assert grown == pytest.approx(CURVE.work_at(29e-6) - CURVE.work_at(20e-6), rel=5e-3)
    assert again.profile(29e-6).depth == pytest.approx(CURVE.profile(29e-6).depth, abs=0.05e-6)


def test_deeper_curve_of_the_same_machine_begins_with_the_shallower_one():
    short, longer = curve(20e-6), CURVE
    n = short.depth.size - 1
    assert np.array_equal(short.depth[:n], longer.depth[:n])
    assert np.array_equal(short.work[:n], longer.work[:n])


def test_curve_without_a_steady_state_to_start_from_is_refused(monkeypatch):
    def none(*arguments, **options):
        raise NotConverged("no steady state")
        yield

    monkeypatch.setattr("twin.wear.path.evolve", none)
    with pytest.raises(NotConverged, match="no steady state at the start of wear"):
        MasterCurve.build(model(), TEN, model().unworn, 1e-6)
