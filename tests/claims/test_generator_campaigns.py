"""Whole small campaigns: uneven wear, growth, ramps, and faults of instruments as they arrive in a recording."""

from __future__ import annotations

import numpy as np
import pytest

from recordings.generator import SimulationError, SpecError, simulate
from tests.generator_instances import SPEC, rig

SHORT = {
    **SPEC,
    "calibration": [],
    "solver": {"step_rate_hz": 51200.0},
    "windows": {"seconds": 0.25, "at_revolutions": [20, 400]},
}
PLAIN = {"k_m2_per_n": 6e-12, "tooth_scatter": 0.0}


def made(**more):
    return simulate({**SHORT, **more}, rig())


def depth(**wear):
    campaign = made(wear={**PLAIN, **wear})
    return campaign.truth["final"], campaign


@pytest.mark.slow
def test_wear_of_one_gear_leaves_the_other_and_even_wear_shares_by_the_tooth_counts():
    even, _ = depth()
    assert even["pinion_um"] / even["gear_um"] == pytest.approx(52 / 19, rel=0.02)
    pinion, _ = depth(gear_factor=0.0)
    assert pinion["gear_um"] == 0.0
    assert pinion["pinion_um"] == pytest.approx(even["pinion_um"], rel=0.1)  # the load shares a little otherwise


@pytest.mark.slow
def test_wear_at_one_end_of_the_face_is_deeper_there_and_levels_off_by_itself():
    """The deeper end carries less, so that the wear differs by less than the coefficient does."""
    even, _ = depth()
    uneven, _ = depth(face_gradient=0.8)
    ratio = uneven["combined_any_slice_um"] / uneven["combined_um"]
    assert even["combined_any_slice_um"] / even["combined_um"] == pytest.approx(1.0, abs=0.01)
    assert 1.05 < ratio < 1 + 0.8 * 2 / 3  # three slices: the outer ones lie a third of the face from the middle


@pytest.mark.slow
def test_wear_that_differs_from_tooth_to_tooth_does_so():
    even, _ = depth()
    uneven, _ = depth(tooth_scatter=0.3)
    assert even["combined_any_tooth_um"] / even["combined_um"] < 1.05
    assert uneven["combined_any_tooth_um"] / uneven["combined_um"] > 1.2


@pytest.mark.slow
def test_a_gain_that_drifts_is_larger_in_every_window():
    effects = [{"name": "sensor_gain", "gain": 2.0, "onset_revolutions": 0.0, "full_revolutions": 400.0}]
    plain, drifting = (made(effects=e, wear={"k_m2_per_n": 0.0}) for e in ([], effects))
    ratios = [b.acceleration.std() / a.acceleration.std() for a, b in zip(plain.windows, drifting.windows, strict=True)]
    assert ratios == pytest.approx([1 + 20 / 400, 2.0], rel=0.01)


@pytest.mark.slow
def test_speed_rises_within_a_window_by_the_share_asked_for_about_its_mean():
    campaign = made(
        windows={"seconds": 1.0, "at_revolutions": [20, 400], "speed_rise": [0.0, 0.4]},
        drive={"speed_spread": 0.0, "speed_wander": 0.0},
    )
    for window, truth, rise in zip(campaign.windows, campaign.truth["windows"], (0.0, 0.4), strict=True):
        intervals = np.diff(window.pinion_edges[1])
        speeds = [1 / intervals[part].mean() / 1024 for part in (slice(0, 400), slice(-400, None))]
        assert truth["speed_hz"] == pytest.approx(10.0, rel=0.08 if rise else 0.01)  # the drive's control lags
        assert 0.5 * rise - 0.02 < speeds[1] / speeds[0] - 1 < rise + 0.02


@pytest.mark.slow
def test_torque_rises_within_a_window():
    campaign = made(windows={"seconds": 1.0, "at_revolutions": [20, 400], "torque_rise": [0.0, 0.5]})
    steady, rising = (np.array(w.torque) for w in campaign.windows)
    assert rising[-300:].mean() / rising[:300].mean() > 1.2 * steady[-300:].mean() / steady[:300].mean()


def test_rises_must_be_as_many_as_windows():
    with pytest.raises(SpecError, match="one value for each of the 2 windows"):
        made(windows={"seconds": 0.25, "at_revolutions": [20, 400], "speed_rise": [0.1]})


@pytest.mark.slow
def test_a_lost_line_of_the_gears_disc_makes_its_count_fall_behind_by_one_a_turn():
    effects = [{"name": "lost_encoder_line", "line": 700, "shaft": "gear", "onset_revolutions": 100.0}]
    plain, faulty = (made(effects=e) for e in ([], effects))
    for a, b, turns in zip(plain.windows, faulty.windows, (0, 300 * 19 / 52), strict=True):
        assert a.pinion_edges[0] == b.pinion_edges[0]
        assert a.gear_edges[0] - b.gear_edges[0] == pytest.approx(turns, abs=1.5)
    assert faulty.windows[1].gear_edges[1].size in (a.gear_edges[1].size - 1, a.gear_edges[1].size)


@pytest.mark.slow
def test_wrong_polarity_turns_the_accelerometer_and_leaves_the_rest():
    plain, turned = (made(effects=e) for e in ([], [{"name": "wrong_polarity", "onset_revolutions": 200.0}]))
    same, other = plain.windows, turned.windows
    assert np.array_equal(same[0].acceleration, other[0].acceleration)
    assert np.corrcoef(same[1].acceleration, other[1].acceleration)[0, 1] < -0.99
    assert same[1].torque == pytest.approx(other[1].torque, abs=0.01)  # its onset parts the steps of wear


@pytest.mark.slow
def test_a_shifted_clock_shifts_the_accelerometer_against_the_edges():
    plain, late = (made(effects=e) for e in ([], [{"name": "time_shift", "shift_ms": 5.0}]))
    samples = round(5e-3 * 12800)
    a, b = plain.windows[1].acceleration, late.windows[1].acceleration
    assert np.corrcoef(a[samples:], b[:-samples])[0, 1] > 0.99
    assert np.array_equal(plain.windows[1].gear_edges[1], late.windows[1].gear_edges[1])


@pytest.mark.slow
def test_a_clock_that_drifts_too_far_is_refused():
    with pytest.raises(SimulationError, match="the clocks differ by"):
        made(effects=[{"name": "time_shift", "shift_ms": 0.0, "drift_ms_per_hour": 1000.0}], windows={
            "seconds": 0.25, "at_revolutions": [20, 9000]})  # fmt: skip


@pytest.mark.slow
def test_the_end_of_life_can_be_set_by_the_share_of_it_that_is_used():
    campaign = made(truth={"to_end_of_life": True, "life_step_um": 1.0, "life_share": 0.8}, wear=PLAIN)
    end = campaign.truth["end_of_life"]
    assert campaign.truth["final"]["combined_um"] / end["limit_um"] == pytest.approx(0.8, rel=0.1)
    assert end["revolutions"] > campaign.truth["windows"][-1]["revolutions"]
