"""Claims about the contact on the back flanks."""

from dataclasses import replace
from math import cos, tan

import numpy as np
import pytest

from tests.mesh_pairs import EQUAL, UNSW, UNSW_TIGHT
from twin.mesh.back_flank import back_flank_position


def test_without_backlash_the_back_flanks_are_half_a_mesh_period_out_of_step():
    s = np.linspace(-3e-3, 3e-3, 7)
    assert back_flank_position(UNSW_TIGHT, s) == pytest.approx(UNSW_TIGHT.base_pitch / 2 - s, rel=1e-12)


def test_backlash_moves_the_back_contact_by_half_of_itself():
    pair = replace(UNSW, backlash=2e-4)
    shift = back_flank_position(UNSW_TIGHT, 0.0) - back_flank_position(pair, 0.0)
    assert shift == pytest.approx(1e-4, rel=1e-10)


@pytest.mark.parametrize("pair", [UNSW, EQUAL], ids=["unsw", "equal"])
@pytest.mark.parametrize("s", [-2e-3, 0.0, 1.5e-3])
def test_back_flank_touches_where_the_drawn_tooth_cuts_the_mirrored_line_of_action(pair, s):
    """The tooth is turned until its drive flank touches at s; its other flank must have the stated ρ1."""
    tooth, r_b, α = pair.tooth(0), pair.base_radius[0], pair.pressure_angle
    ξ = tan(α) + s / r_b
    x, y = tooth.flank_point(ξ - tooth.base_half_angle)
    contact = np.array([pair.pitch_radius[0] + s * np.sin(α), s * np.cos(α)])  # centres on the first axis
    centre_line = np.arctan2(contact[1], contact[0]) - np.arctan2(x, y)  # the drive flank leads
    ρ_back = r_b * tan(α) + back_flank_position(pair, s)
    τ = ρ_back / r_b - tooth.base_half_angle
    x, y = tooth.flank_point(τ)
    angle = centre_line - np.arctan2(x, y)
    back = np.hypot(x, y) * np.array([np.cos(angle), np.sin(angle)])
    foot = r_b * np.array([cos(α), np.sin(α)])  # mirrored line of action touches the base circle here
    along = np.array([np.sin(α), -cos(α)])
    assert back - foot == pytest.approx(ρ_back * along, abs=1e-12)
