"""Order lines, synchronous averages and mesh bands of signals that are known exactly."""

import numpy as np
import pytest

from twin.features.angle import angle_track
from twin.features.orders import mesh_bands, order_lines, synchronous_average
from twin.features.resample import AngleSignal, on_angle, spline_response
from twin.windows import Edges, Samples

Z1, Z2 = 19, 52
ORDERS = np.array([0, 19, 38, 57, 190, 18, 20, 19 - Z1 / Z2, 19 + Z1 / Z2, 1, 2, 3, Z1 / Z2, 2 * Z1 / Z2])
AMPLITUDES = np.array([-40, 5, -3 + 1j, 0.2j, 2 + 2j, 0.5, 0.4j, 0.3, -0.2, 1.5j, 0.1, 0.02, 30 - 2j, 1], dtype=complex)


def time_at(angle, wander=0.01, speed=10.0):
    """Time [s] at which a shaft with slow speed changes is at an angle [rad]."""
    return (angle + wander * 11 * np.sin(angle / 11)) / (2 * np.pi * speed)


def wave(angle, orders=ORDERS, amplitudes=AMPLITUDES):
    return np.real(np.exp(1j * np.outer(angle, orders)) @ amplitudes)


def on_grid(first_turn, turns, orders=ORDERS, amplitudes=AMPLITUDES, per_turn=1280):
    step = 2 * np.pi / per_turn
    start = 2 * np.pi * first_turn
    angle = start + step * np.arange(round(turns * per_turn))
    return AngleSignal(
        start=start, step=step, values=wave(angle, orders, amplitudes), usable=np.ones(angle.size, dtype=bool)
    )


@pytest.mark.parametrize("turns", [10.0, 12.573, 25.141, 48.9])
@pytest.mark.parametrize("first_turn", [0.0, 1276.0352])
def test_lines_do_not_depend_on_where_the_record_is_cut(turns, first_turn):
    found = order_lines(on_grid(first_turn, turns), ORDERS)
    assert np.abs(found.amplitudes - AMPLITUDES).max() < 1e-8


def edges_and_samples(first_turn, turns, per_rev=1024, rate=12800.0):
    """An encoder and an accelerometer on a shaft whose speed wanders, from a given turn on."""
    t0 = time_at(2 * np.pi * first_turn)
    first = int(np.ceil(first_turn * per_rev))
    edges = time_at(2 * np.pi / per_rev * (first + np.arange(round(turns * per_rev)))) - t0
    t = np.arange(int(edges[-1] * rate)) / rate
    angle = 2 * np.pi * first_turn + 2 * np.pi * 10 * t
    for _ in range(60):
        angle = angle - (time_at(angle) - t0 - t) * 2 * np.pi * 10
    track = Edges(per_rev=per_rev, first_index=first, times=edges)
    return track, Samples(rate=rate, start=0.0, values=wave(angle))


@pytest.mark.parametrize("first_turn", [3.2, 1276.0352])
def test_lines_of_a_time_signal_are_unbiased_though_the_speed_wanders(first_turn):
    edges, samples = edges_and_samples(first_turn, 25.14)
    track = angle_track(edges)
    signal, per_turn = on_angle(samples, track)
    found = order_lines(signal, ORDERS, [(signal.values, spline_response(ORDERS / per_turn))])
    # the spline of the angle follows the wander to about 1e-5 rad: 2e-3 at order 190
    assert np.abs(found.amplitudes - AMPLITUDES).max() < 1e-2
    assert np.abs(found.amplitudes - AMPLITUDES)[:4].max() < 5e-3
    assert track.speed == pytest.approx(track.turns / (edges.times[-1] - edges.times[0]), rel=1e-6)
    assert track.revolutions == pytest.approx(first_turn + 25.14 / 2, abs=1e-3)


def test_two_windows_of_a_steady_machine_give_the_same_phase():
    lines = []
    for first_turn in (100.3, 7000.9):
        edges, samples = edges_and_samples(first_turn, 25.14)
        signal, _ = on_angle(samples, angle_track(edges))
        lines.append(order_lines(signal, ORDERS).amplitudes)
    assert np.angle(lines[0][1:5] / lines[1][1:5]) == pytest.approx(np.zeros(4), abs=5e-3)


def test_shifting_the_clock_changes_nothing():
    edges, samples = edges_and_samples(50.3, 20.0)
    shift = 3.25
    later = Edges(per_rev=edges.per_rev, first_index=edges.first_index, times=edges.times + shift)
    moved = Samples(rate=samples.rate, start=samples.start + shift, values=samples.values)
    here = order_lines(on_angle(samples, angle_track(edges))[0], ORDERS).amplitudes
    there = order_lines(on_angle(moved, angle_track(later))[0], ORDERS).amplitudes
    assert np.abs(here - there).max() < 1e-6


def test_standard_deviation_is_the_scatter_of_repeated_measurements():
    rng = np.random.default_rng(5)
    errors, stated = [], []
    for _ in range(60):
        clean = on_grid(0.0, 20.0, ORDERS[:4], AMPLITUDES[:4], per_turn=256)
        values = clean.values + 0.3 * rng.standard_normal(clean.values.size)
        noisy = AngleSignal(start=clean.start, step=clean.step, values=values, usable=clean.usable)
        found = order_lines(noisy, ORDERS[:4])
        errors.append(found.amplitudes - AMPLITUDES[:4])
        stated.append(found.std)
    spread = np.sqrt(np.mean(np.abs(np.array(errors)[:, 1:]) ** 2, axis=0) / 2)
    assert spread == pytest.approx(np.mean(stated, axis=0)[1:], rel=0.25)


def test_lines_too_close_for_the_turns_are_named_not_guessed():
    close = np.array([4.0, 11 * Z1 / Z2, 19.0])  # 4.019 against 4
    short = order_lines(on_grid(0.0, 25.0, close, np.array([1, 0.5j, 2])), close)
    assert np.isnan(short.amplitudes[1]) and np.isfinite(short.amplitudes[[0, 2]]).all()
    long = order_lines(on_grid(0.0, 120.0, close, np.array([1, 0.5j, 2])), close)
    assert np.abs(long.amplitudes - [1, 0.5j, 2]).max() < 1e-6


def test_a_lost_stretch_costs_accuracy_but_no_bias():
    whole = on_grid(0.0, 25.14)
    usable = whole.usable.copy()
    usable[9000:12000] = False
    values = np.where(usable, whole.values, 0.0)
    found = order_lines(AngleSignal(start=0.0, step=whole.step, values=values, usable=usable), ORDERS)
    assert np.abs(found.amplitudes - AMPLITUDES).max() < 2e-3


def test_mesh_bands_hold_the_harmonic_and_two_sidebands_and_nothing_else():
    orders = np.array([19, 17, 21, 38, 40.9, 57, 30.0])
    amplitudes = np.array([3, 1, 2, 1, 7, 0.5, 9], dtype=complex)
    bands = mesh_bands(on_grid(5.3, 25.2, orders, amplitudes), Z1)
    expected = np.sqrt(np.array([9 + 1 + 4, 1, 0.25]) / 2)
    assert bands[:3] == pytest.approx(expected, rel=2e-3)
    assert bands[3:].max() < 1e-3


def test_synchronous_average_of_a_periodic_signal_is_one_period():
    orders, amplitudes = np.array([19, 38, 1.0]), np.array([2, 1j, 0.5], dtype=complex)
    signal = on_grid(7.31, 25.2, orders, amplitudes)
    mean, count = synchronous_average(signal, 1.0, 500)
    assert count == 24
    assert mean == pytest.approx(wave(2 * np.pi * np.arange(500) / 500, orders, amplitudes), abs=1e-6)
    mesh, count = synchronous_average(signal, 1 / Z1, 64)
    assert count == int(25.2 * Z1) - 1 or count == int(25.2 * Z1)
    assert mesh == pytest.approx(wave(2 * np.pi / Z1 * np.arange(64) / 64, orders[:2], amplitudes[:2]), abs=0.02)
