"""Natural frequencies of the test rig.

Source     K. Feng et al., Wear 426–427 (2019) 1410–1415, Table 2 (measured by impact test)
Tolerance  1 %: the reading of the table's four digits leaves 0.05 %; the rig file was fitted to these
           frequencies, so a deviation tells of an error in the assembly of M and K, not of the paper
"""

import numpy as np
import pytest

from tests.dynamics_cases import RIG
from twin.dynamics.structure import Structure

MEASURED = [21.77, 86.91, 217.80, 430.20, 511.60, 767.10, 1248.00, 1927.00]  # Table 2 [Hz]
LIVES_IN = ["th13 th2", "th2", "th10", "y10", "x10", "y5", "x5", "y4 y6"]
STRUCTURE = Structure.from_rig(RIG)
MESH_STIFFNESS = RIG.get("mesh.mean_stiffness")


def test_natural_frequencies_match_table_2_one_to_one():
    f = STRUCTURE.natural_frequencies(MESH_STIFFNESS)
    vibrating = f[f > 0]
    assert vibrating[:8] == pytest.approx(MEASURED, rel=0.01)
    assert vibrating[8] > 2000, "the eight measured modes are all that lie within the band of the RMS"


def test_modes_above_the_band_are_those_the_rig_file_lists():
    f = STRUCTURE.natural_frequencies(MESH_STIFFNESS)
    assert f[f > 0][8:] == pytest.approx(RIG.get("reference.natural_frequencies_hz.next_above"), rel=5e-4)


def test_one_rigid_body_mode_with_the_mesh_closed_and_two_without():
    assert np.count_nonzero(STRUCTURE.natural_frequencies(MESH_STIFFNESS) == 0) == 1
    assert np.count_nonzero(STRUCTURE.natural_frequencies(0.0) == 0) == 2


def test_rigid_body_mode_turns_both_shafts_at_the_tooth_ratio():
    f, Φ = STRUCTURE.coupled_modes(MESH_STIFFNESS)
    mode = Φ[:, f == 0][:, 0]
    z1, z2 = RIG.teeth
    expected = np.array([1.0] * 5 + [z1 / z2] * 4 + [0.0] * 12)
    assert mode / mode[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("number", range(8))
def test_each_mode_has_its_energy_where_the_table_of_modes_says(number):
    f, Φ = STRUCTURE.coupled_modes(MESH_STIFFNESS)
    mode = Φ[:, f > 0][:, number]
    kinetic = np.diag(STRUCTURE.mass) * mode**2
    names = np.array(RIG.get("layout.degrees_of_freedom"))
    strongest = set(names[np.argsort(kinetic)[-2:]])
    assert strongest & set(LIVES_IN[number].split()), f"mode {number + 1} lives in {strongest}"
