"""Operating points on one axis and on two: weights, order, and a machine that runs at several speeds and loads."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.claims.test_baseline import RIG, SHAFTS, machine, parts
from twin.baseline.diagnosis import diagnose
from twin.baseline.leaving_out import learn
from twin.baseline.operating import axes_of, miss_of, order_of, point_of, weights_of
from twin.baseline.transfer_path import common_level, lesser
from twin.errors import NotAvailable

GRID = np.array([(torque, speed) for torque in (5.0, 10.0, 20.0) for speed in (10.0, 15.0, 25.0)])


def readings(points):
    return [SimpleNamespace(torque_nm=torque, speed_hz=speed) for torque, speed in points]


def test_axis_is_what_varies():
    assert axes_of(readings([(None, 10.0), (None, 12.0)])) == ("speed_hz",)
    assert axes_of(readings([(10.0, 10.0), (10.1, 20.0)])) == ("speed_hz",)
    assert axes_of(readings([(5.0, 10.0), (10.0, 9.9), (15.0, 9.8), (20.0, 9.7)])) == ("torque_nm",)  # slip alone
    assert axes_of(readings(GRID)) == ("torque_nm", "speed_hz")
    assert axes_of(readings(GRID[:3])) == ("speed_hz",)


def test_window_without_torque_has_no_place_on_its_axis():
    with pytest.raises(NotAvailable, match="no torque"):
        point_of(readings([(None, 10.0)])[0], ("torque_nm",))


@pytest.mark.parametrize("points", [GRID, GRID[:, :1].copy(), GRID[::3]])
def test_weights_are_shares_and_give_back_what_is_linear(points):
    rng = np.random.default_rng(3)
    points = np.unique(points, axis=0)
    slope = rng.normal(size=points.shape[1])
    for at in points.min(axis=0) + np.ptp(points, axis=0) * rng.uniform(0.02, 0.98, size=(40, points.shape[1])):
        weights, inside = weights_of(points, at)
        assert min(weights.values()) > 0 and sum(weights.values()) == pytest.approx(1)
        if np.linalg.matrix_rank(points - points[0]) == points.shape[1]:
            assert inside
            assert sum(w * (points[i] @ slope) for i, w in weights.items()) == pytest.approx(at @ slope)


def test_at_a_point_learned_it_stands_alone_and_outside_the_nearest_does():
    for i, point in enumerate(GRID):
        weights, inside = weights_of(GRID, point)
        assert inside and weights[i] == pytest.approx(1)
    weights, inside = weights_of(GRID, np.array([40.0, 24.0]))
    assert weights == {8: 1.0} and not inside
    weights, inside = weights_of(GRID, np.array([20.1, 25.1]))  # within a twentieth of the range
    assert weights == {8: 1.0} and inside


def test_points_on_one_line_are_not_spread_over_the_plane():
    line = np.array([(t, 10.0 + t) for t in (0.0, 1.0, 2.0, 3.0)])
    assert weights_of(line, np.array([1.5, 11.0]))[1] is False


def test_order_goes_outwards_from_the_middle_by_nearest_neighbours():
    order = order_of(np.array([[5.0], [1.0], [3.0], [2.0], [4.0]]))
    assert order[0] == (2, None) and sorted(i for i, _ in order) == list(range(5))
    assert {(i, j) for i, j in order[1:]} == {(3, 2), (4, 2), (1, 3), (0, 4)}


def at(load, speed, seed, **what):
    return parts(machine(load, seed, nominal=speed, metered=True, seconds=6.0, **what), name=f"{load:g} {speed:g}")


@pytest.mark.slow
def test_machine_of_several_speeds_and_loads_is_known_between_them():
    points = [(load, speed) for load in (0.1, 0.5, 0.9) for speed in (15.0, 16.0, 17.5)]
    base = learn(RIG, [at(load, speed, i).whole for i, (load, speed) in enumerate(points)], SHAFTS)
    assert base.axes == ("torque_nm", "speed_hz")
    well = diagnose(base, [at(0.4, 16.6, 90)])
    assert well.effects == () and well.verdict == "explained" and well.compared[0].expected.interpolated
    assert len(well.compared[0].expected.between) == 3
    struck = diagnose(base, [at(0.4, 16.6, 91, pulse=2.0)])
    assert [e.name for e in struck.effects] == ["tooth_crack"]
    beyond = diagnose(base, [at(0.4, 19.0, 92)])
    assert not beyond.compared[0].expected.interpolated
    assert "8 N·m, 18.924 Hz" in beyond.reason and "2 to 18 N·m, 14.865 to 17.483 Hz" in beyond.reason


def test_miss_is_nothing_at_a_point_learned_and_grows_with_the_distance():
    points = np.array([[0.0], [4.0], [10.0]])
    miss = [miss_of(points, np.array([u]), weights_of(points, np.array([u]))[0]) for u in (4.0, 4.5, 7.0, 12.0, 20.0)]
    assert miss[0] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.diff(miss) > 0)
    far = miss_of(points, np.array([20.0]), {2: 1.0})
    assert far == pytest.approx(2 * 1.0**1.5)  # a whole range beyond the nearest alone


@pytest.mark.slow
def test_scatter_is_wider_far_from_what_was_learned():
    base = learn(RIG, [at(load, 16.0, i).whole for i, load in enumerate((0.1, 0.15, 0.2))], SHAFTS)
    near, far = (base.expected(at(load, 16.0, 9).whole) for load in (0.17, 0.9))
    assert near.wider == 1.0 and far.wider > 5
    usual = far.wider * base.std["a"]
    assert np.all(far.std["a"] >= 0.999 * usual)  # and more where the noise is louder than in any healthy recording
    assert np.median(far.std["a"] / usual) == pytest.approx(1.0, abs=0.05)


def test_level_that_all_sensors_share_is_of_no_sensor():
    rng = np.random.default_rng(1)
    gains = [np.exp(-0.3 + 0.05 * rng.normal(size=9)) * np.exp(0.1j * rng.normal(size=9)) for _ in range(4)]
    assert common_level(gains) == pytest.approx(-0.3, abs=0.05)
    assert common_level([*gains[:3], np.ones(9)]) == 0.0  # one sensor stays where it was
    assert common_level([*gains[:3], 1 / gains[3]]) == 0.0
    assert common_level(gains[:1]) == 0.0  # too few to tell
    # lines that have only lost their phase have another gain and the same level: nothing that the machine does
    assert np.all(lesser(gains[0], np.ones(9)) == 1)
    assert np.allclose(lesser(gains[0], gains[0]), np.abs(gains[0]))


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.6, 1.5])
def test_machine_that_is_louder_at_all_sensors_has_no_changed_sensor_and_says_so(factor):
    def third(window):  # a sensor between the two others
        a, b = (window.accelerations[k] for k in "ab")
        channels = {**window.accelerations, "c": replace(a, values=0.5 * a.values + 0.7 * np.roll(b.values, 5))}
        return replace(window, accelerations=channels)

    loads = (0.1, 0.25, 0.4, 0.55, 0.7)  # enough to judge teeth: a sensor is named only then
    base = learn(RIG, [parts(third(machine(load, i))).whole for i, load in enumerate(loads)], SHAFTS)
    window = third(machine(0.42, 50))
    louder = replace(
        window, accelerations={k: replace(s, values=factor * s.values) for k, s in window.accelerations.items()}
    )
    found = diagnose(base, [parts(louder)])
    assert found.effects == ()
    said = re.search(r"all sensors are at ([\d.]+) times", found.reason)
    assert float(said[1]) == pytest.approx(factor, rel=0.03)
    alone = {k: replace(s, values=factor * s.values) if k == "b" else s for k, s in window.accelerations.items()}
    (effect,) = diagnose(base, [parts(replace(window, accelerations=alone))]).effects
    assert effect.name == "sensor_gain" and effect.channels == ("b",)
