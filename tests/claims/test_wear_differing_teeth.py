"""Wear that differs from tooth to tooth: against closed forms, sums that cannot change, and teeth that are alike."""

from math import gcd

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.mesh_pairs import standard_pair
from twin.compiled.load_sharing import share_load
from twin.dynamics.mesh import PairMesh
from twin.errors import ParameterError
from twin.mesh.stiffness import PairStiffness
from twin.wear.differing_teeth import (
    POINTS,
    DifferingFlanks,
    Sharing,
    ToothDifferences,
    departures,
)
from twin.wear.evolution import StepSizes
from twin.wear.laws.archard import Archard

STIFFNESS, FORCE = 1.6e8, 560.0  # of a pair, the same everywhere [N/m]; [N]
DEFLECTION = FORCE / (2 * STIFFNESS)  # of two pairs in contact: 1.75 µm
HUNTING, WHOLE = (20, 51), (20, 40)  # every tooth meets all others; every tooth meets the same two
FINE = StepSizes(first=0.05e-6, share=0.05, largest=0.1e-6)


def sharing(teeth=HUNTING, half_width=1e-6) -> Sharing:
    pair = standard_pair(*teeth, 2e-3, (5e-3, 5e-3))
    s = np.linspace(1.1 * pair.path_start, 1.1 * pair.path_end, 9)
    stiffness = PairStiffness.given(pair, s, np.full(9, STIFFNESS))
    mesh = PairMesh.of(pair, 64, stiffness)
    return Sharing(mesh=mesh, stiffness_scale=1.0, force=FORCE, half_width=half_width, law=Archard())


def alternating(e: float, z: int) -> tuple[float, ...]:
    return tuple(e * (-1) ** k for k in range(z))


def drawn(z: int, std: float, seed: int = 5) -> tuple[float, ...]:
    f = std * np.random.default_rng(seed).normal(size=z)
    return tuple((f - f.mean()).tolist())


@pytest.mark.parametrize("depth", [1e-6, 3e-6, 6e-6])
def test_a_difference_of_one_gear_dies_out_over_the_deflection_of_two_pairs(depth):
    """e ∝ exp(−h̄/λ), λ = F/(2κ), in the middle of the zone of two pairs, where both slide alike; linear: 2e < λ."""
    e, middle = 0.4e-6, POINTS  # half a base pitch before the pitch point
    differ = ToothDifferences(displacement=(alternating(e, 20), ()))
    pinion, _ = DifferingFlanks(sharing(), (differ,), FINE).at(depth)
    mean = pinion[:, middle].mean()
    left = e - 0.5 * (pinion[::2, middle] - pinion[1::2, middle]).mean()
    assert left == pytest.approx(e * np.exp(-mean / DEFLECTION), rel=0.01)


@pytest.mark.parametrize("depth", [1e-6, 3e-6])
def test_fixed_partners_wear_both_flanks_so_that_a_difference_dies_out_over_the_combined_depth(depth):
    e, middle = 0.4e-6, POINTS
    differ = ToothDifferences(displacement=(alternating(e, 20), ()))
    pinion, gear = DifferingFlanks(sharing(WHOLE), (differ,), FINE).at(depth)
    assert len(gear) == gcd(*WHOLE)
    mean = pinion[:, middle].mean() + gear[:, middle].mean()
    flank = pinion + gear
    left = e - 0.5 * (flank[::2, middle] - flank[1::2, middle]).mean()
    assert left == pytest.approx(e * np.exp(-mean / DEFLECTION), rel=0.01)


def test_gear_teeth_that_are_not_given_repeat_those_of_the_common_divisor():
    few = ToothDifferences(displacement=(drawn(20, 1e-6), ()))
    every = ToothDifferences(displacement=(drawn(20, 1e-6), (0.0,) * 40), stiffness_loss=((), (1e-12,) * 40))
    short, long = (DifferingFlanks(sharing(WHOLE), (d,)).at(4e-6) for d in (few, every))
    np.testing.assert_allclose(long[0], short[0], atol=1e-12)
    np.testing.assert_allclose(long[1], np.tile(short[1], (2, 1)), atol=1e-12)


def test_mates_of_a_hunting_pair_wear_alike_by_a_pinion_alone():
    differ = ToothDifferences(displacement=(drawn(20, 1e-6), ()))
    _, gear = DifferingFlanks(sharing(), (differ,)).at(4e-6)
    assert len(gear) == 1
    every = ToothDifferences(displacement=(drawn(20, 1e-6), ()), stiffness_loss=((), (1e-12,) * 51))
    _, same = DifferingFlanks(sharing(), (every,)).at(4e-6)
    np.testing.assert_allclose(same, np.tile(gear, (51, 1)), atol=1e-12)


@pytest.mark.parametrize("teeth", [HUNTING, WHOLE])
def test_teeth_that_are_alike_stay_alike(teeth):
    shifted = ToothDifferences(displacement=((3e-6,) * teeth[0], (-1e-6,) * teeth[1]))
    for flank in departures(sharing(teeth), (shifted,), 10e-6):
        assert np.ptp(flank, axis=0).max() < 1e-15
    for flank in departures(sharing(teeth), (), 10e-6):
        assert not flank.any()


def test_the_load_of_all_passages_is_the_load():
    mesh = sharing()
    s = mesh.positions
    k, gap = np.full(s.size, STIFFNESS), mesh.mesh.corner(s)[0]
    missing = tuple(-np.array(drawn(z, 3e-6))[:, None] * np.ones(s.size) for z in HUNTING)
    loads = share_load(20 * 51, k, gap, missing, (np.ones(20), np.ones(51)), FORCE)
    for load in loads:
        total = load.mean(axis=0).reshape(3, POINTS).sum(axis=0)
        np.testing.assert_allclose(total, FORCE, rtol=1e-12)


def test_small_differences_leave_the_mean_flank_as_it_is_to_first_order():
    """The mean departure falls with the square of the differences, the departures in proportion to them."""
    mean, apart, on = [], [], slice(POINTS, 2 * POINTS)
    alike = sum(DifferingFlanks(sharing(), (), FINE).at(2e-6))[0]
    for size in (0.4e-6, 0.1e-6):
        differ = ToothDifferences(displacement=(drawn(20, size), drawn(51, size)))
        flanks = DifferingFlanks(sharing(), (differ,), FINE).at(2e-6)
        mean.append(np.abs(sum(f.mean(axis=0) for f in flanks) - alike)[on].max())
        apart.append((flanks[0] - flanks[0].mean(axis=0))[:, on].std())
    assert apart[1] == pytest.approx(apart[0] / 4, rel=0.1)
    assert mean[1] < 0.1 * mean[0] and mean[1] < 0.01 * apart[1]


def test_a_tooth_that_protrudes_is_worn_down_where_two_pairs_touch_and_stays_where_one_touches():
    displaced = tuple(5e-6 if k == 3 else 0.0 for k in range(20))
    pinion, _ = departures(sharing(), (ToothDifferences(displacement=(displaced, ())),), 30e-6)
    s, pair = sharing().positions, sharing().mesh.pair
    corner = 0.7e-3  # how much longer than the path a tooth touches that is 5 µm ahead, with its corner
    single = (s > pair.path_end - pair.base_pitch + corner) & (s < pair.path_start + pair.base_pitch - corner)
    assert single.sum() > 5 and np.abs(pinion[3, single]).max() < 1e-9
    assert pinion[3, POINTS] == pytest.approx(2.5e-6, rel=0.01)  # slides as much as its mate: each gives half
    assert pinion[2, 2 * POINTS] == pytest.approx(-2.5e-6, rel=0.01)


def test_a_soft_tooth_wears_less_from_its_onset_on():
    loss = tuple(0.6 if k == 3 else 0.0 for k in range(20))
    cracked = ToothDifferences(stiffness_loss=(loss, ()), onset_depth=10e-6)
    for flank in departures(sharing(), (cracked,), 10e-6):
        assert np.abs(flank).max() < 0.02e-6  # two ways of steps to the same depth
    pinion, _ = departures(sharing(), (cracked,), 15e-6)
    assert pinion[3, POINTS] < -0.3e-6 < 0.1e-6 < pinion[2, 2 * POINTS]  # its neighbour ahead carries for it


def test_flanks_do_not_depend_on_what_was_asked_for_before():
    differ = ToothDifferences(displacement=(drawn(20, 2e-6), ()))
    path = DifferingFlanks(sharing(), (differ,))
    late = path.at(20e-6)
    early = path.at(5e-6)
    np.testing.assert_array_equal(DifferingFlanks(sharing(), (differ,)).at(5e-6)[0], early[0])
    assert late[0].max() > early[0].max()


def test_sharing_of_three_pairs_is_the_root_of_the_balance():
    rng = np.random.default_rng(1)
    n = 8
    k, gap = 1e8 * (1 + rng.random(3 * n)), 4e-6 * rng.random(3 * n)
    missing = 6e-6 * rng.random((3, 3 * n)), np.zeros((1, 3 * n))
    kept = np.array([1.0, 0.4, 0.8])
    pinion, gear = share_load(3, k, gap, missing, (kept, np.ones(1)), FORCE)
    for a in range(n):
        expected = np.zeros((3, 3))
        for j in range(3):
            teeth, at = [(j + 1) % 3, j, (j - 1) % 3], [a, a + n, a + 2 * n]
            stiff = np.array([kept[t] * k[i] for t, i in zip(teeth, at, strict=True)])
            open_by = np.array([gap[i] + missing[0][t, i] for t, i in zip(teeth, at, strict=True)])
            d = brentq(lambda d, k=stiff, g=open_by: (k * np.maximum(d - g, 0)).sum() - FORCE, 0, 1e-3, xtol=1e-16)
            for t, i, force in zip(teeth, range(3), stiff * np.maximum(d - open_by, 0), strict=True):
                expected[t, i] += force
        np.testing.assert_allclose(pinion[:, [a, a + n, a + 2 * n]], expected, atol=1e-6 * FORCE)
        np.testing.assert_allclose(gear[0, [a, a + n, a + 2 * n]], expected.mean(axis=0), atol=1e-6 * FORCE)


def test_values_that_do_not_fit_the_teeth_are_refused():
    with pytest.raises(ParameterError, match="7 values for 20 teeth"):
        departures(sharing(), (ToothDifferences(displacement=((1e-6,) * 7, ())),), 1e-6)
    with pytest.raises(ParameterError, match="periods"):
        share_load(7, np.ones(6), np.ones(6), (np.ones((3, 6)), np.ones((1, 6))), (np.ones(3), np.ones(1)), 1.0)
