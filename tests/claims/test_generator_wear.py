"""Wear of the simulated machine against Archard's law in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from recordings.generator.wear import Wearing, depth_per_revolution, depths, elliptic_kernel
from tests.generator_instances import RATED, knobs, machine, pair

K = 6e-12
LAW = {
    "k_m2_per_n": K,
    "contact_half_width_um": 200.0,
    "step_um": 1.0,
    "tooth_scatter": 0.0,
    "running_in_factor": 1.0,
    "running_in_revolutions": 2000.0,
    "dynamic_forces": False,
}


def worn(revolutions, effect=None, slices=1, condition=RATED, **law):
    """A machine run from new, and its law."""
    m = machine(slices=slices)
    wearing = Wearing(m, {**LAW, **law}, np.random.default_rng(2))
    wearing.advance(0.0, revolutions, condition, effect or knobs())
    return m


def test_the_first_wear_where_one_pair_carries_is_archards():
    """dh/dn = k·(F/W)·|s|/rb1·(1 + z1/z2) on the pinion, and z1/z2 of that on the gear."""
    m = machine()
    rates = m.carried(RATED, knobs(), 0.0, 3.0)
    teeth = (np.ones(19), np.ones(52))
    pinion, gear = depth_per_revolution(m, rates, K, teeth, elliptic_kernel(2e-4))
    s, p = -0.65e-3, pair()
    force = RATED.torque / p.base_radius[0]
    expected = K * force / p.face_width * abs(s) / p.base_radius[0] * (1 + 19 / 52)
    at = np.argmin(abs(p.points - s))
    assert pinion.mean((0, 2))[at] == pytest.approx(expected, rel=0.03)
    assert gear.mean((0, 2))[at] == pytest.approx(expected * 19 / 52, rel=0.03)


def test_the_pinion_bears_73_percent_of_the_depth():
    """1/(1 + 19/52), the paper's "about 73 %"."""
    d = depths(worn(1000))
    assert d["pinion_um"] / d["combined_um"] == pytest.approx(52 / 71, rel=0.01)


@pytest.mark.slow
def test_two_thirds_of_156_um_are_reached_at_4000_revolutions_as_in_the_paper():
    """156 µm at 6000 revolutions at a constant rate; k is chosen for it, the shape of the growth is not."""
    d = depths(worn(4000, k_m2_per_n=6.02e-12))
    assert d["combined_um"] == pytest.approx(104, rel=0.02)


@pytest.mark.slow
def test_only_the_product_of_coefficient_and_revolutions_counts():
    one, two = worn(600), worn(300, k_m2_per_n=2 * K)
    both = one.pinion_worn.mean((0, 2)), two.pinion_worn.mean((0, 2))
    assert np.max(abs(both[0] - both[1])) < 2e-3 * both[0].max()  # other teeth meet: not the same to the bit


@pytest.mark.slow
def test_halving_the_depth_step_changes_the_profile_little():
    coarse, fine = worn(1500, step_um=1.0), worn(1500, step_um=0.5)
    h = [m.pinion_worn.mean((0, 2)) for m in (coarse, fine)]
    assert np.max(abs(h[0] - h[1])) < 0.005 * h[1].max()


@pytest.mark.slow
def test_the_pitch_point_wears_least_and_the_profile_has_two_humps():
    m, s = worn(1500), pair().points
    h = m.pinion_worn.mean((0, 2)) + m.gear_worn.mean((0, 2))
    inside = (s > -2e-3) & (s < 2e-3)
    lowest = s[inside][np.argmin(h[inside])]
    assert abs(lowest) < 0.2e-3
    assert h[inside].min() < 0.15 * h.max()
    assert h[s < 0].max() == pytest.approx(h[s > 0].max(), rel=0.15)


def test_a_misaligned_pair_wears_at_its_loaded_edge_first():
    m = worn(500, knobs("misalignment", lead_um=30.0), slices=5)
    across = m.pinion_worn.max(1).mean(0)
    assert np.all(np.diff(across) > 0) and across[-1] > 2 * across[0]
    d = depths(m)
    assert d["combined_any_slice_um"] > 1.3 * d["combined_um"]


@pytest.mark.slow
def test_running_in_wears_faster_by_the_integral_of_its_excess():
    n, factor, age = 1000.0, 1.5, 500.0
    extra = (factor - 1) * age * (1 - np.exp(-n / age)) / n
    plain, quick = (depths(worn(n, running_in_factor=f, running_in_revolutions=age)) for f in (1.0, factor))
    assert quick["combined_um"] / plain["combined_um"] == pytest.approx(1 + extra, rel=0.02)


@pytest.mark.slow
def test_dynamic_forces_wear_as_static_ones_where_the_machine_hardly_turns():
    """At a crawl the mesh force is that at rest at every phase of the mesh."""
    crawl = replace(RATED, speed=2 * np.pi * 0.5)
    ratio = machine().force_ratio(crawl, knobs())
    assert np.max(abs(ratio - 1)) < 0.02
    rest, turning = (worn(300, condition=crawl, dynamic_forces=d).pinion_worn.mean((0, 2)) for d in (False, True))
    assert np.max(abs(turning - rest)) < 0.02 * rest.max()


def test_dynamic_forces_have_the_mean_of_the_static_ones_and_wear_more_where_they_are_high():
    """The wear of one phase of the mesh follows the force there; over the path its mean is kept."""
    ratio = machine().force_ratio(RATED, knobs())
    assert ratio.mean() == pytest.approx(1.0, abs=1e-6) and np.ptp(ratio) > 0.02
    m = machine()
    even, high = (m.carried(RATED, knobs(), 0.0, 3.0, r)[0].mean((0, 2)) for r in (np.ones(64), np.full(64, 1.5)))
    assert high.max() == pytest.approx(1.5 * even.max(), rel=0.02)


@pytest.mark.slow
def test_every_tooth_wears_and_pitch_errors_spread_the_depths():
    even = worn(1000)
    uneven = worn(1000, knobs("pitch_error", pinion_um=4.0, gear_um=3.0))
    scatter = [np.ptp(m.pinion_worn.max((1, 2))) / m.pinion_worn.max() for m in (even, uneven)]
    assert even.pinion_worn.max((1, 2)).min() > 0 and even.gear_worn.max((1, 2)).min() > 0
    assert scatter[0] < 0.05 < scatter[1]


def test_without_a_coefficient_nothing_wears():
    assert worn(5000, k_m2_per_n=0.0).pinion_worn.max() == 0.0
