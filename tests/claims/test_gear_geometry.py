"""Claims about the geometry of a pair and of its teeth."""

from dataclasses import replace
from math import cos, pi, radians, sin, sqrt, tan

import numpy as np
import pytest

from tests.mesh_pairs import EQUAL, PAIRS, UNDERCUT, UNSW, UNSW_RIG, UNSW_TIGHT, standard_pair
from twin.errors import ParameterError


def test_path_of_contact_is_that_of_the_rig_file():
    path = UNSW_RIG["gears"]["path_of_contact"]
    assert UNSW.path_start == pytest.approx(path["start"], rel=1e-6)
    assert UNSW.path_end == pytest.approx(path["end"], rel=1e-6)
    assert UNSW.base_pitch == pytest.approx(path["base_pitch"], rel=1e-6)
    assert UNSW.contact_ratio == pytest.approx(1.65258, rel=1e-5)
    assert UNSW.base_radius[0] == pytest.approx(UNSW_RIG["gears"]["pinion"]["base_radius"], rel=1e-8)
    assert UNSW.base_radius[1] == pytest.approx(UNSW_RIG["gears"]["gear"]["base_radius"], rel=1e-8)


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_radii_of_curvature_always_sum_to_the_length_of_the_common_tangent(pair):
    s = np.linspace(pair.path_start, pair.path_end, 11)
    ρ1, ρ2 = pair.curvature_radius(s)
    assert ρ1 + ρ2 == pytest.approx(np.full(11, pair.centre_distance * sin(pair.pressure_angle)), rel=1e-13)


@pytest.mark.parametrize("pair", [UNSW, EQUAL], ids=["unsw", "equal"])
def test_the_path_starts_at_the_gears_tip_and_ends_at_the_pinions(pair):
    ρ2 = pair.curvature_radius(pair.path_start)[1]
    ρ1 = pair.curvature_radius(pair.path_end)[0]
    assert sqrt(pair.base_radius[1] ** 2 + ρ2**2) == pytest.approx(pair.tip_radius[1], rel=1e-13)
    assert sqrt(pair.base_radius[0] ** 2 + ρ1**2) == pytest.approx(pair.tip_radius[0], rel=1e-13)


def test_contact_ratio_of_many_teeth_tends_to_that_of_two_racks():
    pair = standard_pair(20000, 20000, 2e-3, (0.1, 0.1))
    rack = 4 / (pi * sin(2 * radians(20)))  # 2·h_a/(sin α · p_b), h_a = m
    assert pair.contact_ratio == pytest.approx(rack, rel=2e-3)


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
@pytest.mark.parametrize("wheel", [0, 1])
def test_fillet_joins_root_circle_and_flank(pair, wheel):
    tooth = pair.tooth(wheel)
    τ, γ = tooth.form_point
    assert np.hypot(*tooth.fillet_point(pi / 2)) == pytest.approx(tooth.root_radius, rel=1e-13)
    assert np.array(tooth.fillet_point(γ)) == pytest.approx(np.array(tooth.flank_point(τ)), abs=1e-14)


@pytest.mark.parametrize("wheel", [0, 1])
def test_fillet_runs_into_the_flank_without_a_corner(wheel):
    """True of teeth without undercut, root circle below (pinion) or above (gear) the base circle."""
    tooth, h = UNSW.tooth(wheel), 1e-6
    assert (tooth.root_radius < tooth.base_radius) == (wheel == 0)
    τ, γ = tooth.form_point
    flank = np.subtract(tooth.flank_point(τ + h), tooth.flank_point(τ - h))
    fillet = np.subtract(tooth.fillet_point(γ - h), tooth.fillet_point(γ + h))
    assert np.arctan2(*fillet) == pytest.approx(np.arctan2(*flank), abs=1e-6)


@pytest.mark.parametrize("curve", ["flank", "fillet"])
def test_slopes_of_the_profile_are_the_derivatives_of_its_points(curve):
    tooth, h = UNSW.tooth(0), 1e-6
    at = np.linspace(0.4, 1.5, 9)
    point, slope = getattr(tooth, f"{curve}_point"), getattr(tooth, f"{curve}_slope")
    numeric = (point(at + h)[1] - point(at - h)[1]) / (2 * h)
    assert slope(at) == pytest.approx(numeric, rel=1e-7, abs=1e-11)


def test_tooth_is_as_thick_on_the_pitch_circle_as_stated():
    tooth = UNSW.tooth(1)
    τ = tan(tooth.pressure_angle) - tooth.base_half_angle
    x, y = tooth.flank_point(τ)
    assert np.hypot(x, y) == pytest.approx(tooth.pitch_radius, rel=1e-14)
    assert 2 * np.arctan2(x, y) * tooth.pitch_radius == pytest.approx(UNSW.tooth_thickness, rel=1e-12)


def test_teeth_and_backlash_fill_the_pitch():
    pitch = pi * UNSW.module
    assert 2 * UNSW.tooth_thickness + UNSW.backlash / cos(UNSW.pressure_angle) == pytest.approx(pitch)
    assert UNSW_TIGHT.tooth_thickness == pytest.approx(pitch / 2)


def test_undercut_shortens_the_path_of_contact():
    ρ1 = UNDERCUT.curvature_radius(UNDERCUT.path_start)[0]
    assert ρ1 > 0
    assert ρ1 == pytest.approx(UNDERCUT.tooth(0).form_roll_angle * UNDERCUT.base_radius[0], rel=1e-12)
    tip_start = UNDERCUT.pitch_radius[1] * sin(UNDERCUT.pressure_angle) - sqrt(
        UNDERCUT.tip_radius[1] ** 2 - UNDERCUT.base_radius[1] ** 2
    )
    assert UNDERCUT.path_start > tip_start


@pytest.mark.parametrize("teeth", [5, 8, 12, 16, 17, 18, 40, 300])
def test_every_tooth_count_has_a_flank_from_form_point_to_tip(teeth):
    tooth = replace(UNSW.tooth(0), teeth=teeth)
    tip = np.sqrt(((tooth.pitch_radius + tooth.addendum) / tooth.base_radius) ** 2 - 1)
    assert 0 <= tooth.form_roll_angle < tip


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"addendum": 1e-3, "dedendum": 1.25e-3}, r"contact ratio = 0\.89\d must be above 1.*coefficient"),
        ({"dedendum": 1e-3}, r"dedendum = 0\.001 m must be at least the addendum = 0\.002 m"),
        ({"backlash": 6e-3}, r"tooth thickness = -\S+ m is outside \(0, 0\.00628319\) m; a backlash"),
        ({"dedendum": 6e-3}, r"dedendum = 0\.006 m: the rack that cuts it is pointed.*up to 0\.004\d+ m"),
    ],
)
def test_impossible_geometry_is_refused_with_its_number(change, message):
    with pytest.raises(ParameterError, match=message):
        replace(UNSW, **change)
