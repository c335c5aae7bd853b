"""Claims about the corner contact outside the nominal path."""

import numpy as np
import pytest

from tests.mesh_pairs import EQUAL, LARGE, PAIRS, UNDERCUT, UNSW
from twin.mesh.corner_contact import corner_gap


@pytest.mark.parametrize("pair", [UNSW, EQUAL, LARGE], ids=["unsw", "equal", "large"])
def test_gap_is_zero_inside_the_path_and_grows_steadily_outside(pair):
    inside = np.linspace(pair.path_start, pair.path_end, 101)
    x = np.linspace(1e-5, pair.base_pitch, 400)
    assert not corner_gap(pair, inside).any()
    for outside in (pair.path_start - x, pair.path_end + x):
        gap = corner_gap(pair, outside)
        assert np.all(gap > 0)
        assert np.all(np.diff(gap) > 0)


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_gap_leaves_the_path_with_zero_slope(pair):
    """A quadratic start: a tenth of the overshoot gives a hundredth of the gap."""
    x = np.array([1e-6, 1e-5]) * pair.module / 2e-3
    for outside in (pair.path_start - x, pair.path_end + x):
        small, large = corner_gap(pair, outside)
        assert small == pytest.approx(large / 100, rel=0.02)
        assert large < 2e-3 * x[1]


def test_equal_gears_part_as_they_meet():
    x = np.linspace(0, 3e-3, 61)
    assert corner_gap(EQUAL, EQUAL.path_start - x) == pytest.approx(corner_gap(EQUAL, EQUAL.path_end + x))


@pytest.mark.parametrize("overshoot", [1e-4, 5e-4, 1.5e-3])
def test_gap_is_the_shortest_distance_from_the_corner_to_the_drawn_flank(overshoot):
    """Both teeth drawn point by point in Cartesian axes, before the path's start."""
    pair = UNSW
    s = pair.path_start - overshoot
    α, (r_b1, r_b2) = pair.pressure_angle, pair.base_radius
    along = np.array([np.sin(α), -np.cos(α)])  # line of action, centres on x
    pitch_point = np.array([pair.pitch_radius[0], 0.0])

    def involute_through(centre, contact, base_radius, string, turn):
        """Points of an involute through `contact` as its string of given length is rolled on; (n, 2)."""
        foot = contact - string * along * turn  # the string touches the base circle here
        angle0 = np.arctan2(*(foot - centre)[::-1])
        lengths = np.linspace(0.0, 0.03, 600001)
        angle = angle0 + (lengths - string) / base_radius
        tangent = np.stack([-np.sin(angle), np.cos(angle)])
        radial = np.stack([np.cos(angle), np.sin(angle)])
        return (centre[:, None] + base_radius * radial - lengths * tangent).T

    ρ1, ρ2 = pair.curvature_radius(s)
    contact = pitch_point + s * along
    centre2 = np.array([pair.centre_distance, 0.0])
    pinion = involute_through(np.zeros(2), contact, r_b1, ρ1, 1)
    gear = involute_through(centre2, contact, r_b2, ρ2, -1)
    corner = gear[np.argmin(np.abs(np.hypot(*(gear - centre2).T) - pair.tip_radius[1]))]
    distance = np.hypot(*(pinion - corner).T).min()
    assert corner_gap(pair, s) == pytest.approx(distance, rel=1e-3, abs=5e-8)


def test_undercut_flank_loses_contact_at_its_foot():
    """The path is cut short; the gap starts from zero there, stays open, and is wide a base pitch on."""
    x = np.linspace(1e-6, UNDERCUT.base_pitch, 2000)
    gap = corner_gap(UNDERCUT, UNDERCUT.path_start - x)
    assert corner_gap(UNDERCUT, UNDERCUT.path_start) == 0
    assert np.all(gap > 0)
    assert gap[-1] > 1e-4
    assert np.abs(np.diff(gap)).max() < 1.5 * (x[1] - x[0])  # no step anywhere


def test_shape_of_the_positions_is_kept():
    for s in (np.float64(-9e-3), np.full(3, -9e-3), np.zeros((2, 3))):
        assert np.shape(corner_gap(UNSW, s)) == np.shape(s)
