"""Involute flanks and the corner contact beside the path."""

from math import tan

import numpy as np
import pytest

from recordings.generator.flanks import CORNER_SPACING
from tests.generator_instances import pair, rig


def test_the_path_of_contact_is_that_of_the_rig_file():
    path = rig()["gears"]["path_of_contact"]
    assert pair().start == pytest.approx(path["start"], rel=1e-6)
    assert pair().end == pytest.approx(path["end"], rel=1e-6)
    assert pair().base_pitch == pytest.approx(path["base_pitch"], rel=1e-6)


@pytest.mark.parametrize("side", ["start", "end"])
def test_corner_gaps_agree_with_the_polynomials_of_the_rig_file(side):
    """The file's are fitted; the exact ones depart as the overshoot grows, by some 20 % at 1 mm."""
    c = rig()["mesh"][f"corner_gap_{side}"]
    gap = getattr(pair(), f"gap_{side}")
    for x, tolerance in ((0.2e-3, 0.04), (0.5e-3, 0.08), (1.0e-3, 0.2)):
        polynomial = x**2 * (c[0] + c[1] * x + c[2] * x**2)
        assert gap[round(x / CORNER_SPACING)] == pytest.approx(polynomial, rel=tolerance)


@pytest.mark.parametrize("side", ["start", "end"])
def test_corner_gaps_start_at_zero_without_a_kink_and_only_grow(side):
    gap = getattr(pair(), f"gap_{side}")
    assert gap[0] == 0.0 and gap[1] < 1e-2 * CORNER_SPACING
    assert np.all(np.diff(gap) > 0) and np.all(np.isfinite(gap))


def test_a_corner_gap_opens_with_the_square_of_the_overshoot():
    """Second order of the two curves at the tip: x²/2 times the difference of their curvatures' effect."""
    gap = pair().gap_start
    a, b = round(20e-6 / CORNER_SPACING), round(40e-6 / CORNER_SPACING)
    assert gap[b] / gap[a] == pytest.approx(4.0, rel=0.02)


def test_the_base_circles_touch_the_ends_of_the_line_of_action():
    """The path lies between the two points of tangency."""
    t = tan(pair().pressure_angle)
    assert -pair().base_radius[0] * t < pair().start < 0 < pair().end < pair().base_radius[1] * t
