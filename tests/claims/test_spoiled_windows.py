"""What is said of windows of a worn machine that something else than its gears has changed: no verdict of a gear's."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.foreign_content import KINDS, spoiled
from benchmarks.scoring import ROOT, run, windows_of

pytestmark = pytest.mark.slow


@cache
def sound():
    return windows_of(ROOT / "recordings" / "short-campaign.mcap")


def answered(windows):
    _, estimates = run(sound()[0], windows)
    return estimates[-1].report


def foreign(kind, seed):
    rig, windows = sound()
    return answered(spoiled(rig, windows, KINDS[kind], seed)[0])


@pytest.mark.parametrize("seed", [11, 12])
def test_a_sensor_that_feels_another_direction_is_another_path_and_no_effect(seed):
    said = foreign("turned sensor", seed)
    assert said["effects"] == [] and said["unexplained"]["verdict"] == "unknown_effect"
    assert "acceleration" in said["unexplained"]["reason"]


@pytest.mark.parametrize("seed", [11, 12])
def test_a_brake_that_chatters_is_said_with_its_frequency_and_with_no_impossible_size(seed):
    said = foreign("brake chatter", seed)
    frequency = np.random.default_rng([seed, 5]).uniform(31, 39)
    assert {e["name"] for e in said["effects"]} <= {"unknown_effect"}
    assert said["unexplained"]["verdict"] == "unknown_effect"
    assert f"{frequency:.1f}"[:4] in said["unexplained"]["reason"] and "e+" not in said["unexplained"]["reason"]


@pytest.mark.parametrize("gain", [0.4, 2.5])
def test_one_window_of_another_gain_gives_no_name_and_no_verdict_that_all_is_well(gain):
    _, windows = sound()
    given = [
        replace(w, accelerations={n: replace(s, values=gain * s.values) for n, s in w.accelerations.items()})
        if i == 4
        else w
        for i, w in enumerate(windows)
    ]
    said = answered(given)
    assert not [e for e in said["effects"] if e["name"] not in ("sensor_gain", "unknown_effect")]
    assert said["status"]["level"] != "normal"


def test_last_window_of_another_gain_is_told_as_content_of_the_accelerometer():
    _, windows = sound()
    last = windows[-1]
    louder = {n: replace(s, values=3.0 * s.values) for n, s in last.accelerations.items()}
    said = answered([*windows[:-1], replace(last, accelerations=louder)])
    assert not {e["name"] for e in said["effects"]} - {"unknown_effect"} and said["status"]["level"] != "normal"
    assert said["unexplained"]["verdict"] == "unknown_effect" and "the accelerometer" in said["unexplained"]["reason"]
