"""Lines of a window whose speed changes, against the mean of steady states over its speeds."""

from dataclasses import replace

import numpy as np
import pytest

from tests.dynamics_cases import RIG, TEN, model
from tests.updating_cases import lines
from twin.features.window_features import WindowFeatures
from twin.model import Condition
from twin.updating.changing_speed import passages, speeds_of, with_changing_speed
from twin.updating.conditions import LEVEL, Measured

ORDERS = 19.0 * np.arange(1, 9)
SEEN = {"acceleration": "acceleration_lines", "encoder": "transmission_error_lines", "torque": "torque_lines"}


def over_speeds(variation: float, count: int = 41):
    """Steady states at evenly spread speeds, and the share of turns at each."""
    speeds = TEN.speed_hz * (1 + np.sqrt(3) * variation * np.linspace(-1, 1, count))
    states = [model().steady(model().unworn, Condition(speed_hz=s, torque=TEN.torque)) for s in speeds]
    return states, speeds / speeds.sum()


@pytest.mark.parametrize("variation", [0.02, 0.05, 0.1])
def test_lines_over_speeds_are_the_mean_of_steady_states(variation):
    """The excitation hardly depends on the speed: the ratio to the line at the mean speed agrees to a few per cent."""
    states, share = over_speeds(variation)
    for channel, name in SEEN.items():
        made = passages(model(), ORDERS, TEN.speed_hz, variation)[channel]
        steady = getattr(model(), name)
        passed = share @ np.array([steady(s)[:8] for s in states])
        at_mean = steady(model().steady(model().unworn, TEN))[:8]
        np.testing.assert_allclose(at_mean / passed, made.at_mean / made.mean, rtol=0.05, atol=0.03)


def test_speeds_have_the_stated_mean_and_deviation():
    speeds, share = speeds_of(10.0, 0.1)
    weight = share / speeds / np.sum(share / speeds)  # of the time
    assert weight @ speeds == pytest.approx(10.0)
    assert np.sqrt(weight @ (speeds - 10.0) ** 2) == pytest.approx(1.0)


def swept(variation: float, count: int = 41) -> WindowFeatures:
    """What a window of changing speed shows, and its level."""
    states, share = over_speeds(variation, count)
    heard = np.array([model().acceleration_lines(s) for s in states])
    error = np.array([model().transmission_error_lines(s)[:5] for s in states])
    inside = np.array([s.omega[1:] / 2 / np.pi < RIG.band[1] for s in states])
    level = np.sqrt(np.mean(np.sum(np.abs(heard) ** 2 * inside, axis=1) / 2))
    return WindowFeatures(
        start_time_ns=0, duration=5.0, quality="good", speed_hz=TEN.speed_hz, speed_variation=variation, turns=50.0,
        revolutions=1000.0, torque_nm=TEN.torque, sensor="bearing", rms=float(level), noise_rms=0.0, band=RIG.band,
        acceleration=lines("m/s²", share @ heard[:, :10], 1e-3), transmission_error=lines("m", share @ error, 1e-9),
    )  # fmt: skip


def test_lines_of_a_changing_speed_become_those_of_the_mean_speed():
    seen = swept(0.05)
    told = with_changing_speed(RIG, seen)
    steady = model().steady(model().unworn, TEN)
    at_mean = model().acceleration_lines(steady)[:10]
    before, after = (np.abs(f.acceleration.mesh()[1] - at_mean) for f in (seen, told))
    std = told.acceleration.mesh()[2]
    assert np.linalg.norm(after) < 0.2 * np.linalg.norm(before)
    assert (after < 3 * np.sqrt(2) * std + 0.03 * np.abs(at_mean)).all()
    assert (std >= 0.9 * np.abs(told.acceleration.mesh()[1] / seen.acceleration.mesh()[1]) * 1e-3).all()


def test_once_per_mesh_error_of_the_encoders_is_hardly_touched():
    """Far below the resonances the transmission error follows no speed."""
    seen = swept(0.1)
    first = with_changing_speed(RIG, seen).transmission_error
    assert first.at(1) == pytest.approx(seen.transmission_error.at(1), rel=0.01)
    assert first.at(0) == seen.transmission_error.at(0)


def test_steady_windows_are_left_as_they_are():
    seen = swept(0.001, 3)
    assert with_changing_speed(RIG, seen) is seen
    unknown = replace(seen, speed_variation=None)
    assert with_changing_speed(RIG, unknown) is unknown


def test_uncertainty_of_the_level_is_that_of_steady_states():
    """To the share of the band that is not read line by line."""
    seen = swept(0.05)
    at_mean = model().acceleration_rms(model().steady(model().unworn, TEN))
    told = with_changing_speed(RIG, seen)
    assert told.level_uncertainty == pytest.approx(abs(at_mean / seen.rms - 1), abs=0.02)


def test_window_says_why_its_level_is_not_compared():
    told = with_changing_speed(RIG, swept(0.05))
    assert Measured.of(replace(told, level_uncertainty=0.9 * LEVEL.most_uncertain), RIG).level_fault is None
    reason = Measured.of(replace(told, level_uncertainty=0.36), RIG).level_fault
    assert reason is not None and "the speed changes within the window (standard deviation 5 %)" in reason
    assert "36 %" in reason
