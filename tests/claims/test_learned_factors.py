"""What a window teaches of the path to the accelerometer, where wear cancels a line."""

from types import SimpleNamespace

import numpy as np
import pytest

from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.updating.encoders import factors
from twin.updating.prediction import PATH
from twin.wear.curve import LINES, MeshLines

SPEED, TEETH, DEPTH = 10.0, 20, 20e-6


def curve(left):
    """Lines over depth of which the second falls from 1 to `left` m/s² by 20 µm, as the sum of new flanks and wear."""

    def lines_at(depth):
        heard = np.ones(LINES, dtype=complex)
        heard[1] += (left - 1) * depth / DEPTH
        error = np.full(LINES, 1e-5 + 0j)
        return MeshLines(transmission_error=error, mean=0.0, pinion_motion=error, acceleration=heard)

    return SimpleNamespace(lines_at=lines_at)


def window(heard, unit, std):
    orders = TEETH * np.arange(1, LINES + 1)
    keys = tuple((k, 0, 0) for k in range(1, LINES + 1))
    return MeasuredLines(unit=unit, keys=keys, orders=tuple(orders), amplitudes=tuple(heard), std=(std,) * LINES)


def path(left, gain):
    """The factor of the second line that one window teaches, and its standard deviation.

    gain  of what new flanks make of that line over the model's, by which the sum of both parts moves
    """
    own = curve(left)
    expectation = SimpleNamespace(curve=own, lines=own.lines_at, condition=SimpleNamespace(speed_hz=SPEED))
    heard = own.lines_at(DEPTH).acceleration.copy()
    heard[1] += gain - 1
    features = WindowFeatures(
        start_time_ns=0, duration=1.0, quality="good", speed_hz=SPEED,
        acceleration=window(heard, "m/s²", 1e-4), transmission_error=window(np.full(LINES, 1e-5 + 0j), "m", 1e-9),
    )  # fmt: skip
    taught, _ = factors(features, expectation, DEPTH, 0.0, 3, TEETH)
    return next((ρ, σ) for _, f, ρ, σ in taught if f == pytest.approx(2 * TEETH * SPEED))


@pytest.mark.parametrize("left", [0.05, -0.05, 0.05j])
def test_a_line_that_wear_nearly_cancels_teaches_as_little_as_its_parts_scatter(left):
    """New flanks 3 % off move a line of which 5 % are left by 60 %: within three of its standard deviations."""
    factor, std = path(left, 1.03)
    assert abs(factor - 1) == pytest.approx(0.6, rel=0.02) and abs(factor - 1) < 3 * std


def test_a_line_that_wear_leaves_teaches_as_before():
    factor, std = path(0.9, 1.0)
    assert factor == pytest.approx(1.0) and std == pytest.approx(0.02, rel=0.15)


def test_a_window_in_which_a_line_is_cancelled_spoils_no_factor_that_others_taught():
    """One window at the null between two that show the line: the prediction stays theirs within 5 %."""
    lines = [(float(i), 400.0, *path(left, 1.03)) for i, left in enumerate((0.8, 0.04, 0.8))]
    assert abs(PATH.predict(tuple(lines), np.array([400.0]), 3)[0] - 1.0) < 0.05
