"""The depth of a machine whose structure is an estimate lies inside its band, whatever its structure really is."""

from dataclasses import replace

import numpy as np
import pytest

from tests.estimated_machines import DEPTHS, followed, followed_of, lost_count, machine, rig_of, windows
from tests.updating_cases import seen
from twin.model import Condition
from twin.serial import from_plain, to_plain
from twin.updating.joint_gauge import SIZE
from twin.updating.memory import Memory

TEN = Condition(speed_hz=10.0, torque=10.0)


def inside(outcomes, depths=DEPTHS):
    return [o.depth_band[0] - 1e-9 <= d <= o.depth_band[1] + 1e-9 for o, d in zip(outcomes, depths, strict=True)]


def widths(outcomes):
    """Width of the bands over the true depths."""
    return np.array([(o.depth_band[1] - o.depth_band[0]) / d for o, d in zip(outcomes, DEPTHS, strict=True) if d])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("lab", 1), ("pump", 3)])
def test_the_true_depth_lies_inside_its_band_and_the_band_is_of_use(name, seed):
    outcomes = followed_of(name, seed)
    assert sum(inside(outcomes)) >= len(DEPTHS) - 1
    assert widths(outcomes)[-1] < 0.7
    assert all(o.method == "transmission error" for o in outcomes)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lab", "pump"])
def test_nine_in_ten_depths_lie_inside_their_band(name):
    """Over machines drawn from the rig file's spreads: windows of one machine share their error, machines do not."""
    runs = [followed_of(name, seed) for seed in range(10, 17)]
    share = np.mean([np.mean(inside(run)[1:]) for run in runs])
    width = np.median([widths(run)[-1] for run in runs])
    print(f"{name}: {100 * share:.0f} % of depths inside 5–95 %, median width {width:.2f}")
    assert share >= 0.85


def test_a_lost_count_is_noticed_and_does_not_shift_the_depth():
    rig, twin = rig_of("lab"), machine("lab", 5)
    found = list(windows(twin, TEN, seed=5))
    found[4:] = [lost_count(w, 109e-6) for w in found[4:]]
    outcomes = followed(rig, iter(found))
    assert any("1 edge(s) of the pinion's encoder" in note for o in outcomes for note in o.notes)
    assert all(inside(outcomes))
    assert not outcomes[-1].memory.line_factors.contradicted


@pytest.mark.slow
def test_a_mean_that_contradicts_its_lines_by_no_whole_count_widens_the_band():
    rig, twin = rig_of("lab"), machine("lab", 5)
    found = list(windows(twin, TEN, seed=5))
    counted = followed(rig, iter([*found[:4], *(lost_count(w, 109.55e-6) for w in found[4:])]))
    moved = followed(rig, iter([*found[:4], *(lost_count(w, 30e-6) for w in found[4:])]))
    assert any("an effect that is not in the model" in note for o in moved for note in o.notes)
    assert all(inside(moved))
    low, high = moved[-1].depth_band
    assert low < 0.75 * moved[-1].depth and high > 1.25 * moved[-1].depth
    assert high - low > 1.3 * (counted[-1].depth_band[1] - counted[-1].depth_band[0])
    stored = moved[-1].memory.line_factors
    assert stored.contradicted


@pytest.mark.slow
def test_a_change_of_speed_does_not_shift_the_depth():
    rig, twin = rig_of("lab"), machine("lab", 6)
    slow = list(windows(twin, TEN, seed=6))
    profile = followed(rig, iter(slow))[-1].curve.profile(float(DEPTHS[-1]))
    fast = seen(profile, Condition(speed_hz=14.0, torque=9.0), twin=twin, revolutions=3600.0, phase=1.0, offset=3e-3)
    outcomes = followed(rig, iter([*slow, fast]))
    assert outcomes[-1].depth == pytest.approx(DEPTHS[-1], rel=0.3)
    assert inside(outcomes, [*DEPTHS, DEPTHS[-1]])[-1]


@pytest.mark.slow
def test_without_a_torque_meter_the_lines_alone_give_a_wide_band():
    rig, twin = rig_of("lab"), machine("lab", 7)
    with_meter = list(windows(twin, TEN, seed=7))
    without = [replace(w, torque_nm=None) for w in with_meter]
    full, lines = followed(rig, iter(with_meter)), followed(rig, iter(without))
    assert widths(lines)[-1] > 1.5 * widths(full)[-1]
    assert all(inside(lines))


def test_what_was_learned_is_stored_exactly():
    memory = followed_of("lab", 1)[-1].memory
    factors = memory.line_factors
    assert factors is not None and len(factors.mean) == SIZE
    assert from_plain(Memory, to_plain(memory)).line_factors == factors


def test_the_factors_of_the_lines_are_learned():
    first, last = (followed_of("lab", 1)[i].memory.line_factors for i in (0, -1))
    assert first is not None and last is not None
    before, after = (np.sqrt(np.diag(np.array(f.covariance))[:3]) for f in (first, last))
    assert np.all(after < 0.6 * before)
