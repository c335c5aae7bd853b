"""What may go wrong with a recording and must not go wrong with the depth.

The windows of recordings/short-campaign.mcap, dropped, shortened, holed, turned and mis-scaled; truth beside it.
"""

import copy
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchmarks.scoring import ROOT, read_truth, run, score_run, truth_beside, windows_of
from twin.rig import Rig

SHORT = ROOT / "recordings" / "short-campaign.mcap"
WORN = 5  # index of the first window from which the discs are moved


@lru_cache(maxsize=1)
def recorded():
    return windows_of(SHORT)


def scored(change=lambda windows: windows, rig=None):
    """The score of a changed recording, and all notes."""
    own, windows = recorded()
    _, estimates = run(rig or own, change(list(windows)))
    return score_run("short-campaign", estimates, read_truth(truth_beside(SHORT)))


def check(score, percent=2.0):
    assert score.worn
    assert abs(score.worst()) < percent
    assert score.coverage == 1.0
    assert score.life_band[0] < score.life_true < score.life_band[1]
    if len(score.worn) > 2:  # of two depths alone, the rate between them may have run in, stepped or drifted
        assert abs(score.life_error) < 15


def each(change):
    return lambda windows: [change(w) for w in windows]


def halved(window):
    half = window.duration / 2

    def first(samples):
        return replace(samples, values=samples.values[: samples.values.size // 2])

    return replace(
        window,
        accelerations={k: first(s) for k, s in window.accelerations.items()},
        torques={k: first(s) for k, s in window.torques.items()},
        encoders={k: replace(e, times=e.times[e.times < half]) for k, e in window.encoders.items()},
    )


def holed(window):
    """A quarter of a second of acceleration lost, and another of the gear's encoder."""

    def lost(values, times, start):
        return np.where((times > start) & (times < start + 0.25), np.nan, values)

    gear = window.encoders["gear"]
    return replace(
        window,
        accelerations={k: replace(s, values=lost(s.values, s.times, 0.8)) for k, s in window.accelerations.items()},
        encoders={**window.encoders, "gear": replace(gear, times=lost(gear.times, gear.times, 1.3))},
    )


def turned(window, pinion, gear=0):
    """The discs turned by so many edges."""
    by = {"pinion": pinion, "gear": gear}
    return replace(
        window, encoders={k: replace(e, first_index=e.first_index + by[k]) for k, e in window.encoders.items()}
    )


def torque_gain(gain):
    def change(window):
        return replace(window, torques={k: replace(s, values=gain * s.values) for k, s in window.torques.items()})

    return change


def with_wear_coefficient(factor):
    values = copy.deepcopy({k: dict(v) if hasattr(v, "keys") else v for k, v in recorded()[0].values.items()})
    values["wear"]["K"] *= factor
    return Rig.from_mapping(values)


@pytest.mark.slow
def test_machine_first_seen_worn_is_measured_without_an_unworn_window():
    check(scored(lambda windows: windows[4:]))


@pytest.mark.slow
def test_coefficient_ten_times_too_small_does_not_bound_the_depth_of_a_first_window():
    check(scored(lambda windows: windows[:3] + windows[6:], with_wear_coefficient(0.1)))


@pytest.mark.slow
def test_gear_encoder_that_lost_a_count_is_found_out():
    """One edge of 2048 is 150 µm of transmission error, two hundred of wear."""
    score = scored(lambda windows: windows[:WORN] + [turned(w, 0, -1) for w in windows[WORN:]])
    check(score)
    notes = [note for row in score.rows for note in row.notes]
    assert len(notes) == 1 and "a lost count, a moved disc" in notes[0]
    assert "+150 µm" in notes[0]


@pytest.mark.slow
def test_pinion_encoder_that_lost_a_count_is_found_out():
    score = scored(lambda windows: windows[:WORN] + [turned(w, 1) for w in windows[WORN:]])
    check(score)
    assert any("a lost count" in note for row in score.rows for note in row.notes)


@pytest.mark.slow
def test_discs_mounted_again_at_another_angle_start_anew():
    score = scored(lambda windows: windows[:WORN] + [turned(w, 311, 77) for w in windows[WORN:]])
    check(score)
    assert any("turned by" in note for row in score.rows for note in row.notes)


@pytest.mark.slow
@pytest.mark.parametrize("edges", [1, 27, 512, 1023])
def test_angle_at_which_the_pinions_disc_sits_does_not_matter(edges):
    check(scored(each(lambda w: turned(w, edges))))


@pytest.mark.slow
@pytest.mark.parametrize("kept", [(0, 2, 5, 7), (2, 4, 6), (0, 1, 6, 7), (3, 7)])
def test_windows_that_are_missing_do_not_matter(kept):
    check(scored(lambda windows: [windows[i] for i in kept]))


@pytest.mark.slow
def test_windows_of_half_the_length_do():
    check(scored(each(halved)))


@pytest.mark.slow
def test_lost_frames_in_two_windows_leave_their_depth_within_the_band():
    check(scored(lambda windows: [holed(w) if i in (4, 6) else w for i, w in enumerate(windows)]))


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.98, 1.02])
def test_torque_meter_two_percent_off_does_not_move_the_depth(gain):
    check(scored(each(torque_gain(gain))))


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_rig_files_wear_coefficient_may_be_ten_times_off(factor):
    check(scored(rig=with_wear_coefficient(factor)))


@pytest.mark.slow
def test_window_taken_twice_or_late_counts_once():
    check(scored(lambda windows: [*windows[:5], windows[4], *windows[5:]]))
    check(scored(lambda windows: [*windows[:6], windows[4], *windows[6:]]))
