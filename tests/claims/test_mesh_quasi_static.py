"""Claims about the loaded mesh at rest."""

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks.quasi_static import (
    mesh_period,
    nominal_mesh_stiffness,
    pair_positions,
    static_deflection,
    static_mesh,
)
from tests.mesh_pairs import PAIRS, UNSW
from twin.errors import ParameterError
from twin.mesh.corner_contact import corner_gap
from twin.mesh.stiffness import PairStiffness

FORCE = 560.0  # 10 N·m on the pinion of the reference rig


def mesh_of(pair, n=512, wear=0.0):
    s = pair_positions(pair, mesh_period(pair, n))
    return s, PairStiffness.of(pair)(s), corner_gap(pair, s) + wear


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
@pytest.mark.parametrize("force", [1e-3, FORCE, 1e5])
def test_pair_forces_balance_the_load_to_round_off(pair, force):
    _, k, gap = mesh_of(pair)
    mesh = static_mesh(k, gap, force)
    assert mesh.pair_forces.sum(axis=0) == pytest.approx(np.full(512, force), rel=1e-9)
    assert mesh.load_sharing.sum(axis=0) == pytest.approx(np.ones(512), rel=1e-13)
    assert np.all(mesh.pair_forces >= 0)


def test_balance_is_exact_for_any_gaps_and_stiffnesses():
    rng = np.random.default_rng(5)
    k, gap = rng.uniform(1e7, 4e8, (5, 400)), rng.normal(0, 3e-6, (5, 400))
    force = rng.uniform(0.1, 5000, 400)
    mesh = static_mesh(k, gap, force)
    assert mesh.pair_forces.sum(axis=0) == pytest.approx(force, rel=1e-10)
    assert set((mesh.pair_forces > 0).sum(axis=0)) == {1, 2, 3, 4, 5}


def test_deflection_is_the_root_that_a_search_finds():
    rng = np.random.default_rng(6)
    k, gap = rng.uniform(1e8, 2e8, (3, 20)), rng.normal(0, 2e-6, (3, 20))
    d = static_deflection(k, gap, FORCE)
    for j in range(20):
        root = brentq(lambda d, j=j: np.sum(k[:, j] * np.maximum(d - gap[:, j], 0)) - FORCE, -1e-4, 1e-4, xtol=1e-16)
        assert d[j] == pytest.approx(root, abs=1e-15)


def test_one_pair_is_a_spring():
    assert static_deflection([[2e8]], [[3e-6]], 400.0) == pytest.approx([5e-6], rel=1e-14)


def test_without_load_the_pinion_rests_against_the_nearest_tooth():
    gap = np.array([[4e-6, 1e-6], [2e-6, 3e-6]])
    assert static_deflection(np.full((2, 2), 2e8), gap, 0.0) == pytest.approx([2e-6, 1e-6])


def test_equal_wear_of_all_pairs_moves_the_transmission_error_and_nothing_else():
    _, k, gap = mesh_of(UNSW)
    new, worn = static_mesh(k, gap, FORCE), static_mesh(k, gap + 50e-6, FORCE)
    assert worn.deflection == pytest.approx(new.deflection + 50e-6, rel=1e-12)
    assert worn.pair_forces == pytest.approx(new.pair_forces, rel=1e-8, abs=1e-7)


def test_the_pair_that_is_worn_more_carries_less():
    _, k, gap = mesh_of(UNSW)
    shares = []
    for wear in (0.0, 0.2e-6, 0.5e-6, 1e-6):
        worn = gap.copy()
        worn[1] += wear
        shares.append(static_mesh(k, worn, FORCE).load_sharing[1])
    two = (shares[0] > 0.05) & (shares[0] < 0.95)
    assert two.sum() > 200
    assert np.all(np.diff(np.array(shares)[:, two], axis=0) <= 0)
    assert np.all(shares[-1][two] < shares[0][two])


def test_a_pair_worn_beyond_the_deflection_carries_nothing():
    _, k, gap = mesh_of(UNSW)
    gap[1] += 50e-6
    mesh = static_mesh(k, gap, FORCE)
    double = (mesh_of(UNSW)[2][[0, 2]] == 0).any(axis=0)
    assert not mesh.pair_forces[1][double].any()


def test_mesh_stiffness_is_the_slope_of_force_over_deflection():
    _, k, gap = mesh_of(UNSW)
    step = 1e-4
    mesh = static_mesh(k, gap, FORCE)
    d = [static_deflection(k, gap, FORCE + f) for f in (-step, step)]
    assert 2 * step / (d[1] - d[0]) == pytest.approx(mesh.mesh_stiffness, rel=1e-6)


def test_static_transmission_error_is_continuous_and_periodic():
    """Corner contact hands the load over without a step: a finer grid has smaller differences."""
    jumps = []
    for n in (512, 4096):
        d = static_mesh(*mesh_of(UNSW, n)[1:], FORCE).deflection
        jumps.append(np.abs(np.diff(np.append(d, d[0]))).max())
    assert jumps[1] < jumps[0] / 6


def test_mean_mesh_stiffness_is_the_mean_of_the_curve():
    stiffness = PairStiffness.of(UNSW)
    curve = nominal_mesh_stiffness(stiffness, 20000)
    assert stiffness.mesh_mean == pytest.approx(curve.mean(), rel=1e-4)


def test_under_a_light_load_the_tangent_is_the_nominal_mesh_stiffness():
    _, k, gap = mesh_of(UNSW)
    tangent = static_mesh(k, gap, 1e-3).mesh_stiffness
    nominal = nominal_mesh_stiffness(PairStiffness.of(UNSW), 512)
    assert np.sum(~np.isclose(tangent, nominal, rtol=1e-12)) <= 2  # at the ends of the path


def test_load_widens_the_contact_beyond_the_nominal_path():
    _, k, gap = mesh_of(UNSW, 4096)
    pairs = [(static_mesh(k, gap, F).pair_forces > 0).sum() / 4096 for F in (1.0, FORCE, 20 * FORCE)]
    assert pairs[0] == pytest.approx(UNSW.contact_ratio, rel=0.02)
    assert pairs[0] < pairs[1] < pairs[2]


def test_pairs_cover_the_path_and_a_base_pitch_apart():
    s = pair_positions(UNSW, mesh_period(UNSW, 64))
    assert np.diff(s, axis=0) == pytest.approx(np.full((s.shape[0] - 1, 64), UNSW.base_pitch), rel=1e-12)
    assert s.min() < UNSW.path_start - 0.99 * UNSW.base_pitch
    assert s.max() > UNSW.path_end + UNSW.base_pitch / 2


def test_a_pulling_force_is_refused_with_its_number():
    with pytest.raises(ParameterError, match=r"force = -3 N must not be negative"):
        static_deflection([[2e8]], [[0.0]], -3.0)
    with pytest.raises(ParameterError, match=r"pair stiffness = 0 N/m must be positive"):
        static_deflection([[0.0]], [[0.0]], 3.0)
