"""Tachometer pulses in an analog column: edges where they passed, single faults repaired, none where there are none."""

import numpy as np
import pytest

from twin.errors import WindowError
from twin.features.pulses import PulseSettings, pulses_of

RATE = 25600.0
SECONDS = 4.0


def edges_of(speed=24.6, slope=0.0, per_rev=1):
    """Times at which the marks pass, of a shaft at `speed` that changes by `slope` a second."""
    number = np.arange(1, int(SECONDS * speed * per_rev)) / per_rev + 0.37
    return number / speed if slope == 0 else (-speed + np.sqrt(speed**2 + 2 * slope * number)) / slope


def pulses(edges, rise=4.0, width=0.0015, height=5.0, noise=0.0, seed=0):
    """A column of trapezoidal pulses whose rising edges pass half their height at the given times."""
    t, ramp = np.arange(int(SECONDS * RATE)) / RATE, rise / RATE
    x = np.zeros(t.size)
    for e in edges:
        a = np.clip((t - e) / ramp + 0.5, 0, 1) - np.clip((t - e - width) / ramp + 0.5, 0, 1)
        x += a
    return height * x + noise * np.random.default_rng(seed).normal(size=t.size)


def error(found, edges):
    """Largest distance of an edge that was found from the nearest true one, in samples."""
    t = found.times[np.isfinite(found.times)]
    return RATE * np.max(np.min(np.abs(t[:, None] - edges[None, :]), axis=1))


@pytest.mark.parametrize("slope", [0.0, 1.5, -1.5])
def test_edges_of_slanted_pulses_are_exact_without_noise(slope):
    edges = edges_of(slope=slope)
    found = pulses_of(pulses(edges), RATE, PulseSettings())
    assert found.times.size == edges[edges < SECONDS - 0.001].size
    assert error(found, edges) < 1e-6
    assert (found.missed, found.doubled) == (0, 0)
    assert found.threshold == pytest.approx(2.5, abs=1e-9)


@pytest.mark.parametrize("noise", [0.01, 0.05, 0.2])
def test_noise_moves_an_edge_by_noise_over_slope(noise):
    edges = edges_of()
    found = pulses_of(pulses(edges, noise=noise), RATE, PulseSettings())
    t = found.times
    moved = np.array([np.min(np.abs(t_k - edges)) for t_k in t]) * RATE
    expected = noise / (5.0 / 4.0)  # samples
    assert t.size == edges[edges < SECONDS - 0.01].size
    assert np.sqrt(np.mean(moved**2)) < 1.2 * expected


def test_edge_between_two_samples_is_within_half_a_sample():
    edges = edges_of()
    found = pulses_of(pulses(edges, rise=1e-6), RATE, PulseSettings())
    assert error(found, edges) <= 0.5 + 1e-6


def test_falling_edges_and_negative_pulses():
    edges = edges_of()
    falling = pulses_of(pulses(edges), RATE, PulseSettings(falling=True))
    assert error(falling, edges + 0.0015) < 1e-6
    negative = pulses_of(-pulses(edges), RATE, PulseSettings(falling=True))
    assert error(negative, edges) < 1e-6


def test_sine_of_a_magnetic_pick_up_gives_its_zero_crossings():
    t = np.arange(int(SECONDS * RATE)) / RATE
    found = pulses_of(3 + 0.4 * np.sin(2 * np.pi * 24.6 * 60 * t), RATE, PulseSettings(per_rev=60))
    assert found.speed == pytest.approx(24.6, rel=1e-6)
    assert found.missed == found.doubled == 0


def test_given_threshold_and_hysteresis_are_used():
    edges = edges_of()
    found = pulses_of(pulses(edges), RATE, PulseSettings(threshold=1.25, hysteresis=0.1))
    assert error(found, edges - 1 / RATE) < 1e-6  # a quarter of the height: one sample of four earlier
    assert (found.threshold, found.hysteresis) == (1.25, 0.1)


@pytest.mark.parametrize("lost", [[30], [30, 31], [20, 50, 51, 70]])
def test_missed_pulses_are_interpolated_and_counted(lost):
    edges = edges_of()
    found = pulses_of(pulses(np.delete(edges, lost)), RATE, PulseSettings())
    assert (found.missed, found.filled, found.doubled) == (len(lost), len(lost), 0)
    assert found.times.size == edges[edges < SECONDS - 0.01].size
    assert error(found, edges) < 1e-3


def test_long_gap_keeps_the_count_and_is_not_filled():
    edges = edges_of()
    found = pulses_of(pulses(np.delete(edges, range(40, 46))), RATE, PulseSettings())
    assert np.flatnonzero(np.isnan(found.times)).tolist() == list(range(40, 46))
    assert (found.missed, found.filled) == (6, 0)


def test_double_pulses_are_left_out_and_counted():
    edges = edges_of()
    extra = edges[[25, 60]] + np.array([0.003, 0.017])
    found = pulses_of(pulses(np.sort(np.concatenate((edges, extra))), width=0.001), RATE, PulseSettings())
    assert (found.missed, found.doubled) == (0, 2)
    assert found.times.size == edges[edges < SECONDS - 0.01].size
    assert error(found, edges) < 1e-6


@pytest.mark.slow
def test_gap_of_a_toothed_wheel_marks_the_turn_and_is_no_fault():
    edges = edges_of(speed=12.0, per_rev=60)
    place = np.arange(edges.size) % 60
    found = pulses_of(
        pulses(edges[(place != 17) & (place != 18)], width=0.0004, rise=2.0), RATE,
        PulseSettings(per_rev=60, missing_teeth=2),
    )  # fmt: skip
    assert (found.missed, found.doubled) == (0, 0)
    assert found.speed == pytest.approx(12.0, rel=1e-6)
    first_after_gap = np.flatnonzero(np.abs(found.times - edges[19]) < 1e-4)[0]
    assert (found.first_index + first_after_gap) % 60 == 0


def test_single_spike_and_lost_samples_do_not_make_an_edge():
    edges = edges_of()
    x = pulses(edges, noise=0.02)
    x[[1000, 40000]] = 80.0
    x[20000:20004] = np.nan
    found = pulses_of(x, RATE, PulseSettings())
    assert found.threshold == pytest.approx(2.5, abs=0.05)
    assert found.doubled + found.missed <= 2
    assert error(found, edges) < 0.2


NOTHING = [
    (lambda t: np.zeros(t.size), "constant or empty"),
    (lambda t: np.full(t.size, np.nan), "constant or empty"),
    (lambda t: np.random.default_rng(1).normal(size=t.size), "no pulses stand out"),
    (lambda t: 5.0 * (t > 2.0), "at least 4 are needed"),
]


@pytest.mark.parametrize(("column", "message"), NOTHING)
def test_a_column_without_pulses_is_refused(column, message):
    with pytest.raises(WindowError, match=message):
        pulses_of(column(np.arange(int(SECONDS * RATE)) / RATE), RATE, PulseSettings())


def test_pulses_at_random_times_are_refused():
    edges = np.sort(np.random.default_rng(3).uniform(0.1, 3.9, 90))
    with pytest.raises(WindowError, match=r"missed and .* doubled"):
        pulses_of(pulses(edges, width=0.0005), RATE, PulseSettings())


def test_threshold_outside_the_values_says_where_they_are():
    with pytest.raises(WindowError, match="threshold 9 is outside the values, which go from 0 to 5"):
        pulses_of(pulses(edges_of()), RATE, PulseSettings(threshold=9.0))
