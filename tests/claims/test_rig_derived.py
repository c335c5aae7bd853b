"""Values that a rig file leaves out follow from others of it, and estimates that disagree are named."""

import copy

import numpy as np
import pytest

from tests.mesh_pairs import UNSW_RIG
from twin.dynamics.structure import Structure, mass_matrix, stiffness_matrix
from twin.errors import NotAvailable
from twin.model import Calibration
from twin.rig import Rig
from twin.rig_derived import BEAM_SHARE
from twin.rig_notes import rig_notes

RIG = Rig.from_mapping(UNSW_RIG)


def rig_with(**changes):
    """The reference rig with values replaced (`table__key`), or left out where they are None."""
    values = copy.deepcopy(UNSW_RIG)
    for path, value in changes.items():
        table, key = path.split("__")
        if value is None:
            del values[table][key]
        else:
            values[table][key] = value
    return Rig.from_mapping(values)


def test_bending_stiffness_of_a_shaft_follows_from_its_dimensions():
    bare = rig_with(shafts__bending_stiffness_input=None, shafts__bending_stiffness_output=None)
    assert stiffness_matrix(bare) == pytest.approx(stiffness_matrix(RIG), rel=1e-4)


def test_mesh_stiffness_that_is_not_scaled_is_that_of_the_gears():
    assert Calibration.prior(rig_with(mesh__stiffness_scale=None)).stiffness_scale == 1.0


def test_mass_and_inertia_of_the_wheels_follow_from_density_and_dimensions():
    bare = rig_with(inertias__J5=None, inertias__J10=None, masses__m5=None, masses__m10=None)
    assert mass_matrix(bare) == pytest.approx(mass_matrix(RIG), rel=4e-4)


def test_torsion_of_a_shaft_half_follows_from_its_segments_without_joints():
    bare = rig_with(torsional_stiffness__k_3_5=None, shafts__torsional_stiffness_half=None)
    (k,) = bare.require("the shaft half", "torsional_stiffness.k_3_5")
    assert k == pytest.approx(3974, rel=1e-4)


def test_damping_time_follows_from_the_damping_of_the_mesh():
    bare = rig_with(mesh__relative_damping_time=None)
    assert Calibration.prior(bare).damping_time == pytest.approx(8e-6, rel=1e-4)


def test_what_follows_from_nothing_is_not_available():
    bare = rig_with(shafts__bending_stiffness_input=None, shafts__bearing_span=None)
    with pytest.raises(NotAvailable, match=r"shafts\.bending_stiffness_input"):
        stiffness_matrix(bare)


def test_share_of_the_shaft_that_moves_with_its_middle_is_rayleigh_s():
    ξ = np.linspace(0, 0.5, 20001)
    φ = 3 * ξ - 4 * ξ**3
    assert pytest.approx(2 * np.trapezoid(φ**2, ξ), rel=1e-8) == BEAM_SHARE


def test_lateral_stiffness_of_the_couplings_acts_on_the_bearings_beside_them():
    k = 2e6
    change = stiffness_matrix(rig_with(couplings__lateral_stiffness=k)) - stiffness_matrix(RIG)
    names = [i for i in np.flatnonzero(np.diag(change))]
    assert np.diag(change)[names] == pytest.approx([k] * 4)
    assert change.sum() == pytest.approx(4 * k)
    softer, stiffer = (
        Structure.from_rig(r).natural_frequencies(2.7e8) for r in (RIG, rig_with(couplings__lateral_stiffness=k))
    )
    assert np.all(stiffer >= softer - 1e-6)
    assert stiffer[5:].max() > softer[5:].max()


def test_torque_meter_and_encoders_measure_where_the_file_places_them():
    moved = rig_with(
        sensors__torque="k_12_13*(th12-th13)", sensors__encoder_input="th5", sensors__encoder_output="th10"
    )
    structure, pair = Structure.from_rig(moved), moved.gear_pair()
    k = moved.get("torsional_stiffness.k_12_13")
    assert structure.torque_meter[[7, 8]].tolist() == [k, -k]
    rb1, rb2 = pair.base_radius
    assert structure.transmission_error[[3, 6]].tolist() == [rb1, -rb2]
    assert structure.transmission_error @ np.ones(21) == pytest.approx(rb1 - rb2)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"shafts__bearing_span": 0.2}, ("shafts.bending_stiffness_input", "is used; bearing span")),
        ({"gears__density": 7000.0}, ("inertias.J5", "density and dimensions of pinion")),
        ({"shafts__length": 0.5}, ("shafts.length = 0.5 m", "torsion_segments are 0.32 m long")),
        ({"shafts__torsional_stiffness_half": 3000.0}, ("torsional_stiffness.k_3_5", "a joint can only soften")),
        ({"mesh__mean_stiffness": 4e8}, ("mesh.mean_stiffness = 4e+08 N/m", "potential-energy method")),
        ({"mesh__damping": 5000.0}, ("mesh.relative_damping_time = 8e-06 s is used", "1.83660e-05"[:4])),
        ({"mesh__corner_gap_end": [60.0, 0.0, 0.0]}, ("mesh.corner_gap_end departs", "follows from the gears")),
        ({"wear__max_depth_at_6000": 80e-6}, ("wear.max_depth_at_6000 = 8e-05 m", "wear.K with wear.dwell_time")),
        ({"operating__end_revs": 30000}, ("operating.end_revs = 30000", "beyond the end of life")),
        ({"operating__measurement_interval_revs": 9000}, ("leaves fewer than 3 measurements", "wear.K reaches")),
    ],
)
def test_estimates_that_disagree_are_named_with_both_values(changes, words):
    notes = " | ".join(rig_notes(rig_with(**changes)))
    assert all(word in notes for word in words), notes
