"""The errors of the lines that an effect moves, channel by channel."""

from dataclasses import replace

import numpy as np
import pytest

from tests.held_out_windows import MESH, RIPPLE, window
from twin.tracing.moved_lines import moved_lines


def errors_of_ripple(share, model_error=0.0):
    """Of the lines that a ripple moves, fitted `share` times as large as it is."""
    measured = MESH * np.exp(1j * model_error) + RIPPLE
    return moved_lines([(window(MESH, measured), window(MESH + share * RIPPLE, measured))], True)


@pytest.mark.parametrize("share", [0.7, 0.9, 1.0, 1.5])
def test_error_of_the_moved_line_is_what_the_size_is_off(share):
    (moved,) = errors_of_ripple(share)
    assert (moved.channel, moved.lines) == ("torque", 1)
    assert (moved.before, moved.after) == (pytest.approx(1.0), pytest.approx(abs(1 - share), abs=1e-9))


def test_lines_that_an_effect_does_not_move_are_left_out_however_wrong_they_are():
    assert errors_of_ripple(0.9, model_error=0.4) == errors_of_ripple(0.9)


def test_effect_that_moves_nothing_beyond_the_scatter_claims_no_line():
    assert errors_of_ripple(0.01) == () and errors_of_ripple(0.0) == ()


def test_windows_are_taken_together_by_their_energy():
    pairs = [
        (window(MESH, MESH + size * RIPPLE), window(MESH + size * RIPPLE, MESH + size * RIPPLE * 1.1))
        for size in (1.0, 3.0)
    ]
    (moved,) = moved_lines(pairs, True)
    assert moved.lines == 2 and moved.after == pytest.approx(0.1) and moved.before == pytest.approx(1.0)


@pytest.mark.parametrize(("speed_hz", "lines"), [(5.0, 0), (9.0, 0), (11.0, 1)])
def test_torque_that_a_displacement_makes_counts_only_beyond_the_speed_control(speed_hz, lines):
    measured = MESH + RIPPLE  # of order 2
    pair = [replace(window(m, measured), speed_hz=speed_hz) for m in (MESH, MESH + 0.9 * RIPPLE)]
    assert sum(moved.lines for moved in moved_lines([tuple(pair)])) == lines
    assert sum(moved.lines for moved in moved_lines([tuple(pair)], is_torque=True)) == 1
