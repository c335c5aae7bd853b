"""The hunting-tooth period: every tooth meets every other, and only what differs between them shows."""

import numpy as np
import pytest

from tests.dynamics_cases import PRIOR, TEN, contacts, model, relative, steady, worn
from tests.mesh_pairs import EQUAL, LARGE
from twin.dynamics.hunting import HuntingPeriod
from twin.dynamics.mesh import PairMesh

STRUCTURE = model().structure
HUNTING = HuntingPeriod.of(model().mesh)
TE = STRUCTURE.transmission_error


def response(errors=(), depth=50e-6):
    table = HUNTING.contacts(worn(TEN, depth), TEN.speed_hz, errors, damping_time=PRIOR.damping_time)
    return steady(table, TEN)


def lines(found):
    """TE at every order of pinion rotation times 52; (n//2,)."""
    return np.abs(found.lines(STRUCTURE, TE))


def lines_at(found, orders):
    """TE at orders of pinion rotation (m,), complex."""
    return found.lines(STRUCTURE, TE)[np.rint(np.asarray(orders) * HUNTING.pinion_turns).astype(int) - 1]


def pinion_pitch_errors(passages):
    deviation = 3e-6 * np.random.default_rng(19).standard_normal(19)
    return passages.side * deviation[passages.pinion_tooth], 0.0


def eccentric_gear(passages):
    e, θ = 20e-6, passages.gear_angle
    return passages.side * e * np.cos(θ), -passages.side * e * np.sin(θ) * 19 / 52


def test_periods_are_the_least_common_multiple_of_the_tooth_counts():
    assert (HUNTING.mesh_periods, HUNTING.pinion_turns, HUNTING.samples) == (988, 52, 63232)
    for pair, periods, turns in ((EQUAL, 29, 1), (LARGE, 46, 2)):
        hunting = HuntingPeriod.of(PairMesh.of(pair, 64))
        assert (hunting.mesh_periods, hunting.pinion_turns) == (periods, turns)


def test_every_pinion_tooth_meets_every_gear_tooth_once_at_the_pitch_point():
    p = HUNTING.passages
    at_pitch_point = np.flatnonzero(p.position[1] == 0.0)
    met = set(zip(p.pinion_tooth[1, at_pitch_point], p.gear_tooth[1, at_pitch_point], strict=True))
    assert at_pitch_point.size == len(met) == 988


def test_a_tooth_moves_along_the_path_without_a_jump_and_comes_again_after_a_turn():
    p, pair = HUNTING.passages, HUNTING.mesh.pair
    for tooth in (0, 7):
        there = (p.pinion_tooth[:3] == tooth) & (np.arange(63232) < 19 * 64)
        row, sample = np.nonzero(there)
        angle = (p.pinion_angle[sample] - 2 * np.pi * tooth / 19 + np.pi) % (2 * np.pi) - np.pi
        assert p.position[row, sample] == pytest.approx(pair.base_radius[0] * angle, abs=1e-12)


def test_back_flank_of_a_pinion_tooth_stands_against_the_gear_tooth_behind():
    p, pair = HUNTING.passages, HUNTING.mesh.pair
    thickness = pair.tooth_thickness * np.cos(pair.pressure_angle)
    row, sample = np.nonzero(np.arange(63232) < np.full((3, 1), 19 * 64))
    tooth, s_b = p.pinion_tooth[3:][row, sample], p.position[3:][row, sample]
    angle = (p.pinion_angle[sample] - 2 * np.pi * tooth / 19 + np.pi) % (2 * np.pi) - np.pi
    assert s_b == pytest.approx(thickness - pair.base_radius[0] * angle, abs=1e-12)
    meshing = (p.pinion_tooth[1] == 3) & (p.pinion_tooth[4] == 3)
    assert meshing.any()
    assert np.array_equal((p.gear_tooth[4] - p.gear_tooth[1])[meshing] % 52, np.ones(meshing.sum()))


def test_record_without_errors_repeats_the_mesh_period():
    found = response().mesh_force
    one = steady(contacts(worn(TEN, 50e-6), TEN, 64), TEN).mesh_force
    assert np.abs(found.reshape(988, 64) - one).max() < 1e-6 * np.abs(one).max()


def test_eccentric_gear_shows_its_eccentricity_at_its_own_order():
    found = response((eccentric_gear,))
    at_own, at_pinion = np.abs(lines_at(found, [19 / 52, 1.0]))
    assert at_own == pytest.approx(20e-6, rel=2e-3)
    assert at_pinion < 1e-12


def test_mesh_lines_are_untouched_by_an_eccentric_gear():
    orders = 19.0 * np.arange(1, 6)
    with_it, without = (lines_at(found, orders) for found in (response((eccentric_gear,)), response()))
    assert relative(with_it, without) < 1e-4


def test_pitch_errors_of_the_pinion_show_only_at_whole_orders_of_its_rotation():
    found = lines(response((pinion_pitch_errors,)))
    whole = np.zeros(found.size, dtype=bool)
    whole[51::52] = True
    assert found[~whole].max() < 1e-7 * found[whole].max()
    assert np.count_nonzero(found[whole][:19] > 1e-8) > 10


def test_errors_of_both_gears_fill_the_record_with_lines_of_both():
    found = response((pinion_pitch_errors, eccentric_gear))
    own = np.abs(lines_at(found, [19 / 52, 2.0, 3.0]))
    alone = np.abs(lines_at(response((pinion_pitch_errors,)), [2.0, 3.0]))
    assert own[0] == pytest.approx(20e-6, rel=2e-3)
    assert own[1:] == pytest.approx(alone, rel=1e-3)


def test_rate_of_added_separation_follows_its_slope():
    table = HUNTING.contacts(model().unworn, TEN.speed_hz, (eccentric_gear,))
    plain = HUNTING.contacts(model().unworn, TEN.speed_hz)
    added = (table.separation - plain.separation)[0]
    rate = (table.separation_rate - plain.separation_rate)[0]
    step = table.period / HUNTING.samples
    assert np.gradient(added, step)[1:-1] == pytest.approx(rate[1:-1], abs=1e-6 * np.abs(rate).max())
