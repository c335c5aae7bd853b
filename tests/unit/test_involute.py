"""The involute against its closed forms."""

import numpy as np
import pytest

from twin.geometry.involute import involute, pressure_angle_at, roll_angle


def test_involute_of_20_degrees_is_the_tabulated_value():
    assert involute(np.radians(20.0)) == pytest.approx(0.014904384, abs=5e-10)  # ISO 21771, any gear handbook


def test_involute_starts_with_a_third_of_the_cube():
    α = np.array([1e-2, 2e-2])
    assert involute(α) == pytest.approx(α**3 / 3 + 2 * α**5 / 15, rel=1e-5)


def test_roll_angle_is_the_tangent_of_the_pressure_angle():
    r_b = 0.04
    α = np.linspace(0.0, 0.9, 19)
    assert roll_angle(r_b / np.cos(α), r_b) == pytest.approx(np.tan(α), abs=1e-7)
    assert pressure_angle_at(r_b / np.cos(α[1:]), r_b) == pytest.approx(α[1:], rel=1e-12)


def test_no_involute_exists_below_the_base_circle():
    assert roll_angle(np.array([0.03, 0.04]), 0.04).tolist() == [0.0, 0.0]
