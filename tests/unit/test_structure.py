"""M, C, K and the frequency response of the 21-degree-of-freedom model."""

import numpy as np
import pytest

from tests.dynamics_cases import RIG
from tests.mesh_pairs import UNSW_RIG
from twin.dynamics.structure import Structure, direction
from twin.errors import NotAvailable, ParameterError
from twin.rig import Rig

STRUCTURE = Structure.from_rig(RIG)
OMEGA = 2 * np.pi * np.array([3.0, 21.0, 190.0, 433.0, 761.0, 1930.0, 5000.0])


def direct(ω: float, force: np.ndarray) -> np.ndarray:
    """The motion for a harmonic force, from the physical matrices."""
    s = STRUCTURE
    return np.linalg.solve(-(ω**2) * s.mass + 1j * ω * s.damping + s.stiffness, force)


def test_mass_and_stiffness_are_symmetric_and_stiffness_never_negative():
    K = STRUCTURE.stiffness
    assert np.array_equal(K, K.T)
    assert np.linalg.eigvalsh(K).min() > -1e-9 * np.abs(K).max()
    assert (np.diag(STRUCTURE.mass) > 0).all()
    assert np.count_nonzero(STRUCTURE.mass - np.diag(np.diag(STRUCTURE.mass))) == 0


@pytest.mark.parametrize("name", ["y6", "th7", "th2", "x10"])
def test_receptance_equals_the_direct_solution(name):
    response = direction({name: 1.0})
    expected = [response @ direct(ω, STRUCTURE.mesh) for ω in OMEGA]
    assert STRUCTURE.receptance(OMEGA, STRUCTURE.mesh, response) == pytest.approx(expected, rel=1e-7)


def test_receptances_are_reciprocal():
    a, b = direction({"th5": 1.0}), direction({"y6": 1.0})
    assert STRUCTURE.receptance(OMEGA, a, b) == pytest.approx(STRUCTURE.receptance(OMEGA, b, a), rel=1e-12)


def test_damping_is_the_given_ratio_in_every_vibrating_mode_and_none_in_rotation():
    ω, Φ = STRUCTURE.modes
    C = Φ.T @ STRUCTURE.damping @ Φ
    expected = np.where(ω > 1, 2 * 0.05 * ω, 0.0)
    assert np.diag(C) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert np.abs(C - np.diag(np.diag(C))).max() < 1e-7 * expected.max()


def test_mesh_force_does_no_work_when_both_gears_roll():
    z1, z2 = RIG.teeth
    rolling = direction({f"th{i}": 1.0 for i in (1, 2, 3, 5, 7)} | {f"th{i}": z1 / z2 for i in (8, 10, 12, 13)})
    assert STRUCTURE.mesh @ rolling == pytest.approx(0.0, abs=1e-15)


def test_pinion_turning_ahead_and_gears_moving_together_along_the_line_of_action_press_the_teeth():
    α = np.radians(20.0)
    towards = direction({"y5": -np.cos(α), "x5": np.sin(α)})
    assert STRUCTURE.mesh @ direction({"th5": 1.0}) > 0
    assert STRUCTURE.mesh @ towards == pytest.approx(1.0)
    assert STRUCTURE.mesh @ direction({"y5": 1.0, "y10": 1.0}) == pytest.approx(0.0)


def test_static_response_matches_the_direct_solution_with_the_mesh_held():
    z1, z2 = RIG.teeth
    load = direction({"th1": 1.0, "th13": -z2 / z1}) - STRUCTURE.mesh / RIG.gear_pair().base_radius[0]
    response = STRUCTURE.transmission_error - STRUCTURE.mesh
    deflection = np.linalg.lstsq(STRUCTURE.stiffness, load, rcond=1e-13)[0]
    assert STRUCTURE.static_response(response, load) == pytest.approx(response @ deflection, rel=1e-6)


def test_constant_forces_out_of_balance_are_refused():
    with pytest.raises(ParameterError, match="not in balance"):
        STRUCTURE.static_response(direction({"y6": 1.0}), direction({"th1": 1.0}))


def test_missing_inertia_makes_the_structure_unavailable_by_name():
    values = {k: v for k, v in UNSW_RIG.items() if k != "inertias"}
    with pytest.raises(NotAvailable, match=r"mass matrix .* inertias"):
        Structure.from_rig(Rig.from_mapping(values))


def test_damping_in_percent_is_refused():
    with pytest.raises(ParameterError, match=r"modal_damping = 5 is outside \[0, 1\); percent"):
        Structure.from_rig(RIG, modal_damping=5)
