"""The plain data that effects act on."""

from fractions import Fraction

import numpy as np
import pytest

from tests.dynamics_cases import TEN, model
from twin.effects.setup import Shift, common_period, contacts_of, setup_of
from twin.errors import ParameterError


@pytest.mark.parametrize(
    ("periods", "expected"),
    [
        ([], "mesh"),
        (["mesh", "mesh"], "mesh"),
        (["mesh", "gear"], "gear"),
        (["pinion", "pinion"], "pinion"),
        (["pinion", "gear"], "hunting"),
        (["mesh", "hunting"], "hunting"),
    ],
)
def test_common_period_is_the_shortest_over_which_all_repeat(periods, expected):
    assert common_period(periods) == expected


def test_unknown_period_is_refused():
    with pytest.raises(ParameterError, match="'week'"):
        setup_of(model(), TEN, "week")


@pytest.mark.parametrize(
    ("period", "turns", "samples"),
    [("mesh", Fraction(1, 19), 1024), ("pinion", 1, 1216), ("gear", Fraction(52, 19), 3328), ("hunting", 52, 63232)],
)
def test_period_has_its_turns_and_samples(period, turns, samples):
    setup = setup_of(model(), TEN, period)
    assert (setup.turns, setup.samples) == (turns, samples)
    table = contacts_of(setup, [model().unworn])
    assert table.period == pytest.approx(float(turns) / TEN.speed_hz, rel=1e-12)
    assert table.stiffness.shape == (6, samples)


def test_orders_go_to_their_lines_and_off_the_lines_only_over_the_hunting_period():
    hunting, pinion = setup_of(model(), TEN, "hunting"), setup_of(model(), TEN, "pinion")
    assert (hunting.line(1.0), hunting.line(19 / 52), hunting.line(3.584)) == (52, 19, 186)
    assert pinion.line(7.0) == 7
    with pytest.raises(ParameterError, match=r"order 3.584 of the pinion's rotation is no line of this period"):
        pinion.line(3.584)
    with pytest.raises(ParameterError, match="order 0 of"):
        hunting.line(0.0)


def test_load_is_the_cosine_that_it_stands_for():
    setup = setup_of(model(), TEN, "pinion").with_load(np.eye(21)[0], {2.0: 3 * np.exp(0.4j)})
    (load,) = setup.loads
    force = np.fft.irfft(load.lines, setup.samples, norm="forward")
    assert force == pytest.approx(3 * np.cos(2 * setup.passages.pinion_angle + 0.4), abs=1e-12)


def test_slices_share_the_stiffness_and_leave_the_back_flanks_whole():
    whole = contacts_of(setup_of(model(), TEN, "mesh"), [model().unworn])
    sliced = contacts_of(setup_of(model(), TEN, "mesh").sliced(5), [model().unworn])
    assert sliced.stiffness.shape == (18, 1024)
    assert sliced.stiffness[:15].reshape(5, 3, -1).sum(axis=0) == pytest.approx(whole.stiffness[:3], rel=1e-12)
    assert sliced.stiffness[15:] == pytest.approx(whole.stiffness[3:], rel=1e-12)
    assert sliced.side.tolist() == [1.0] * 15 + [-1.0] * 3


def test_a_second_slicing_changes_nothing():
    assert setup_of(model(), TEN, "mesh").sliced(5).sliced(9).slices == 5


def test_constant_shift_moves_stiffness_and_corners_along_the_path():
    setup, δ = setup_of(model(), TEN, "mesh"), 1e-4
    ones, none = np.full(setup.samples, δ), np.zeros(setup.samples)
    shift = Shift(pinion=ones, gear=ones, pinion_slope=none, gear_slope=none)
    moved = contacts_of(setup.with_shift(shift), [model().unworn])
    mesh = setup.mesh
    assert moved.stiffness[:3] == pytest.approx(mesh.stiffness(mesh.positions + δ), rel=1e-12)
    inside = (mesh.positions > mesh.pair.path_start - δ) & (mesh.positions < mesh.pair.path_end - δ)
    assert not moved.separation[:3][inside].any()
