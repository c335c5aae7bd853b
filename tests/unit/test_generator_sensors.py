"""The simulated instruments: filters, converters, encoders."""

import numpy as np
import pytest

from recordings.generator import sensors
from recordings.generator.drive import blows, wander

RATE = 102400.0


def test_decimation_keeps_the_band_and_its_timing():
    t = np.arange(20000) / RATE
    out = sensors.decimated(np.sin(2 * np.pi * 1000 * t), 8, 4000, 1000)
    expected = np.sin(2 * np.pi * 1000 * (4000 / RATE + np.arange(1000) * 8 / RATE))
    assert np.max(abs(out - expected)) < 2e-4


def test_decimation_lets_no_alias_through():
    t = np.arange(20000) / RATE
    assert np.max(abs(sensors.decimated(np.sin(2 * np.pi * 9000 * t), 8, 4000, 1000))) < 1e-3


def test_a_filter_that_would_need_samples_that_are_not_there_says_so():
    with pytest.raises(ValueError, match="the filter needs"):
        sensors.decimated(np.zeros(1000), 8, 0, 100)


def test_a_converter_rounds_to_its_steps_and_ends_at_its_span():
    rng = np.random.default_rng(0)
    values = np.linspace(-12, 12, 1001)
    out = sensors.converted(values, 0.0, 10.0, 8, rng)
    step = 20 / 256
    assert np.allclose(out / step, np.round(out / step))
    assert out.min() == -10.0 and out.max() == 10.0 - step
    assert np.max(abs(out - values)[abs(values) < 9.9]) <= step / 2 + 1e-12


def test_converter_noise_has_its_level():
    out = sensors.converted(np.zeros(40000), 0.1, 1000.0, 16, np.random.default_rng(0))
    assert out.std() == pytest.approx(0.1, rel=0.03)


def test_edges_of_an_even_turn_are_even_and_counted_on():
    disc = sensors.make_disc(1000, [], 0.02, np.random.default_rng(1))
    times = np.arange(-0.1, 1.1, 1e-5)
    angle = 2 * np.pi * 10 * times + 40.0
    rng = np.random.default_rng(0)
    first, at = sensors.edges(disc, times, angle, 0.0, 0.5, 0.0, 1e-12, rng)
    second, later = sensors.edges(disc, times, angle, 0.5, 1.0, 0.0, 1e-12, rng)
    assert np.allclose(np.diff(at), 1e-4, atol=1e-9)
    assert second == first + at.size and later.size == 5000
    assert first == int(np.ceil((40.0 + disc.angle) / (2 * np.pi) * 1000))


def test_a_graduation_error_shows_once_a_turn_with_its_size_on_the_line_of_action():
    radius, disc = 0.02, sensors.make_disc(1000, [1.5e-6], 0.02, np.random.default_rng(1))
    times = np.arange(-0.1, 1.1, 1e-5)
    first, at = sensors.edges(disc, times, 2 * np.pi * 10 * times + 9.0, 0.0, 1.0, 0.0, 1e-12, np.random.default_rng(0))
    told = 2 * np.pi * (first + np.arange(at.size)) / 1000
    error = told - 2 * np.pi * 10 * at
    error -= error.mean()
    line = 2 * abs(np.mean(error * np.exp(-2j * np.pi * 10 * at))) * radius
    assert line * (1 + 1e-6) >= 1.2e-6 and line <= 1.8e-6 * (1 + 1e-6)


def test_jitter_and_clock_are_those_asked_for():
    disc = sensors.make_disc(1000, [], 0.02, np.random.default_rng(1))
    times = np.arange(-0.1, 1.1, 1e-5)
    angle = 2 * np.pi * 10 * times + 9.0
    _, exact = sensors.edges(disc, times, angle, 0.0, 1.0, 0.0, 1e-12, np.random.default_rng(0))
    _, rough = sensors.edges(disc, times, angle, 0.0, 1.0, 60e-9, 10e-9, np.random.default_rng(0))
    assert np.std(rough - exact) == pytest.approx(60e-9, rel=0.05)
    assert np.allclose(rough / 10e-9, np.round(rough / 10e-9), atol=1e-3)


def test_a_soft_mount_amplifies_at_its_resonance():
    t = np.arange(200000) / RATE
    gain = {}
    for f in (100.0, 1500.0, 6000.0):
        out = sensors.mounted(np.sin(2 * np.pi * f * t), RATE, 1500.0, 0.05)[100000:]
        gain[f] = out.std() * np.sqrt(2)
    assert gain[100.0] == pytest.approx(1.0, abs=0.01)
    assert gain[1500.0] == pytest.approx(np.hypot(1, 0.1) / 0.1, rel=0.03)
    assert gain[6000.0] < 0.1


def test_rms_below_takes_the_band_alone():
    t = np.arange(12800) / 12800
    signal = 3 + np.sqrt(2) * (2 * np.sin(2 * np.pi * 500 * t) + 5 * np.sin(2 * np.pi * 3000 * t))
    assert sensors.rms_below(signal, 12800.0, 2000.0) == pytest.approx(2.0, rel=1e-9)


def test_wander_has_its_spread_and_is_slow():
    slow = wander(np.random.default_rng(0), 2_000_000, 1e-4, 0.01, 0.5)
    assert slow.std() == pytest.approx(0.01, rel=0.25)
    assert np.std(slow[1000:] - slow[:-1000]) < slow.std()  # 0.1 s apart
    assert not wander(np.random.default_rng(0), 1000, 1e-4, 0.0, 0.5).any()


def test_blows_come_at_their_rate():
    force = blows(np.random.default_rng(0), 400000, 1e-5, 10.0, 32.0, 0.01)
    starts = np.flatnonzero((force[1:] > 0) & (force[:-1] == 0))
    assert starts.size == pytest.approx(4 * 32, abs=3)
    assert force.max() == pytest.approx(10.0, rel=0.01)
    assert not blows(np.random.default_rng(0), 1000, 1e-5, 0.0, 32.0, 0.01).any()
