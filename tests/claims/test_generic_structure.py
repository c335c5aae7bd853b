"""The generic structure: right within its stated spread for the rig that is known, and similar machines are similar."""

from dataclasses import replace
from math import exp, log, pi, radians

import numpy as np
import pytest

from tests.mesh_pairs import UNSW_RIG
from twin.generic_structure import (
    SPECIFIC_WEAR,
    SPREADS,
    KnownGears,
    bearing_stiffness,
    generic_structure,
    hertz_half_width,
    shaft_diameter,
)
from twin.rig import Rig
from twin.rig_estimated import PARTS, part_of
from twin.wear.archard import specific_wear_rate

UNSW = KnownGears(
    teeth=(19, 52), module=0.002, pressure_angle=radians(20), face_width=0.02, speed_hz=10.0, torque=10.0,
    lubrication="dry",
)  # fmt: skip


def test_every_part_has_a_spread():
    assert set(SPREADS) == set(PARTS)


def test_the_reference_rig_lies_within_the_stated_spreads():
    known = Rig.from_mapping(UNSW_RIG)
    distances = {
        key: log(value / known.get(key)) / SPREADS[part]
        for key, value in generic_structure(UNSW).assumed.items()
        if (part := part_of(key)) and known.get(key)
    }
    assert len(distances) > 25
    assert max(abs(d) for d in distances.values()) < 2.5, distances
    assert np.std(list(distances.values())) < 1.2


def test_similar_machines_have_similar_structures():
    """Twice as large in every length under the same stresses: stiffness ∝ λ, inertia ∝ λ⁵, mass ∝ λ³."""
    λ = 2.0
    large = replace(UNSW, module=λ * 0.002, face_width=λ * 0.02, speed_hz=10.0 / λ, torque=λ**3 * 10.0)
    small, big = generic_structure(UNSW), generic_structure(large)
    powers = {
        "shafts.bending_stiffness_input": 1, "bearings.kx_output": 1, "torsional_stiffness.k_3_5": 3,
        "torsional_stiffness.k_1_2": 3, "inertias.J5": 5, "inertias.J12": 5, "masses.m5": 3, "masses.m9": 3,
        "wear.contact_half_width": 1, "mesh.relative_damping_time": 1,
    }  # fmt: skip
    for key, power in powers.items():
        assert big.assumed[key] / small.assumed[key] == pytest.approx(λ**power, rel=1e-6), key
    assert big.mean_stiffness / small.mean_stiffness == pytest.approx(λ, rel=1e-3)


def test_shafts_carry_their_torque():
    for wheel, torque in enumerate(UNSW.torques):
        d = shaft_diameter(UNSW, wheel)
        assert 16 * torque / (pi * d**3) <= 12e6 * (1 + 1e-9)


def test_a_ball_bearing_stiffens_with_the_cube_root_of_its_load():
    assert bearing_stiffness(0.02, 800.0) / bearing_stiffness(0.02, 100.0) == pytest.approx(2.0)
    # 6204 under 1 kN: handbooks give some 1e8 N/m for the bearing alone, here with a housing as soft
    assert 2e7 < bearing_stiffness(0.02, 1000.0) < 1e8


def test_the_half_width_by_hertz_is_that_of_the_reference_rig():
    pair = generic_structure(UNSW).pair
    assert hertz_half_width(pair, 10.0 / pair.base_radius[0]) == pytest.approx(38.9e-6, rel=0.02)


def test_the_wear_coefficient_is_the_specific_wear_rate_of_the_lubrication():
    for lubrication, k in SPECIFIC_WEAR.items():
        made = generic_structure(replace(UNSW, teeth=(23, 57), speed_hz=25.0, torque=80.0, lubrication=lubrication))
        K, τ = made.assumed["wear.K"], made.assumed["wear.dwell_time"]
        assert specific_wear_rate(made.pair, K, τ, 25.0) == pytest.approx(k, rel=1e-6)
    assert exp(SPREADS["wear"]) > 10
