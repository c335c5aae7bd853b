"""Spectra of signals in closed form show the lines in closed form."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from twin.errors import NotAvailable, ParameterError, WindowError
from twin.features.angle import angle_track
from twin.features.envelope import envelope_spectrum
from twin.features.orders import synchronous_average
from twin.features.resample import on_angle
from twin.features.spectra import amplitude_spectrum, order_spectrum
from twin.windows import Edges, Samples

RATE, N = 5120.0, 20_480
SCALLOPING = 8 / (3 * pi)  # least reading of a line of amplitude 1 by a Hann window: at the border of two bins


def time():
    return np.arange(N) / RATE


def near(spectrum, x: float) -> float:
    return float(spectrum.amplitude[np.abs(spectrum.x - x) <= 2 * spectrum.resolution].max())


def test_a_line_in_the_middle_of_a_bin_reads_its_peak_amplitude_and_its_own_frequency():
    found = amplitude_spectrum(3.0 + 2.5 * np.cos(2 * pi * 200.0 * time() + 0.3), RATE)
    assert near(found, 200.0) == pytest.approx(2.5, rel=1e-9)
    assert found.x[np.argmax(found.amplitude)] == pytest.approx(200.0)
    assert found.amplitude[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("share", np.linspace(0, 1, 9))
def test_a_line_between_two_bins_loses_no_more_than_the_scalloping_of_the_window(share):
    found = amplitude_spectrum(2.5 * np.sin(2 * pi * (200.0 + share * RATE / N) * time()), RATE)
    assert 2.5 * SCALLOPING * (1 - 1e-6) <= near(found, 200.0) <= 2.5 * (1 + 1e-6)


@pytest.mark.parametrize("segments", [1, 7, 15])
def test_the_amplitudes_hold_the_power_of_the_signal(segments):
    x = np.random.default_rng(3).standard_normal(N) + 4 * np.sin(2 * pi * 700.3 * time())
    found = amplitude_spectrum(x, RATE, segments)
    assert found.rms == pytest.approx(np.std(x), rel=0.01)


def test_averaging_steadies_the_floor_and_keeps_the_line():
    x = np.random.default_rng(5).standard_normal(N) + 2 * np.sin(2 * pi * 640.0 * time())
    one, many = amplitude_spectrum(x, RATE), amplitude_spectrum(x, RATE, 15)
    assert near(many, 640.0) == pytest.approx(2.0, rel=0.03)

    def scatter(found):
        floor = found.amplitude[(found.x > 1000) & (found.x < 2000)]
        return floor.std() / floor.mean()

    assert scatter(many) < 0.35 * scatter(one)


def test_lost_samples_are_bridged_and_their_share_is_stated():
    x = 2.0 * np.sin(2 * pi * 50.0 * time())
    x[1000:1200] = np.nan
    found = amplitude_spectrum(x, RATE)
    assert found.lost == pytest.approx(200 / N)
    assert near(found, 50.0) == pytest.approx(2.0, rel=0.02)


def test_too_few_samples_are_one_clear_error():
    with pytest.raises(WindowError, match="3 valid samples are too few for a spectrum"):
        amplitude_spectrum(np.array([1.0, 2.0, np.nan, 3.0]), RATE)


def run_up(share: float = 0.2, per_rev: int = 256):
    """Angle over time of a shaft that speeds up evenly from 10 Hz, its encoder, and the angle at any time."""
    t = np.linspace(0.0, 4.0, 400_001)

    def angle(at):
        return 2 * pi * (10.0 * at + 0.5 * share * 10.0 / 4.0 * at**2)

    count = int(angle(4.0) / (2 * pi) * per_rev)
    times = np.interp(np.arange(count) * 2 * pi / per_rev, angle(t), t)
    return angle, Edges(per_rev=per_rev, first_index=0, times=times)


def test_the_order_spectrum_of_a_run_up_is_one_line_where_the_spectrum_smears_it():
    angle, edges = run_up()
    samples = Samples(rate=RATE, start=0.0, values=1.7 * np.cos(19 * angle(time()) + 0.4))
    signal, per_turn = on_angle(samples, angle_track(edges))
    found = order_spectrum(signal, per_turn)
    line = float(found.x[np.argmax(found.amplitude)])
    assert line == pytest.approx(19.0, abs=found.resolution)
    assert 1.7 * SCALLOPING * 0.99 <= found.amplitude.max() <= 1.7 * 1.01
    off = np.abs(found.x - 19.0) > 5 * found.resolution
    assert found.amplitude[off].max() < 0.01 * 1.7
    assert amplitude_spectrum(samples.values, RATE).amplitude.max() < 0.3 * 1.7


def test_a_high_order_is_given_back_what_interpolation_takes():
    angle, edges = run_up(share=0.01)
    order = 0.33 * RATE / 10.05
    samples = Samples(rate=RATE, start=0.0, values=np.cos(order * angle(time())))
    found = order_spectrum(*on_angle(samples, angle_track(edges)))
    assert SCALLOPING * 0.99 <= near(found, order) <= 1.01


def test_the_synchronous_average_of_a_pattern_is_the_pattern_and_noise_falls_with_the_turns():
    angle, edges = run_up()
    rng = np.random.default_rng(2)

    def pattern(θ):
        return np.cos(3 * θ + 0.2) + 0.5 * np.sin(19 * θ)

    values = pattern(angle(time())) + 0.8 * rng.standard_normal(N) + 1.5 * np.cos(7.37 * angle(time()))
    signal, _ = on_angle(Samples(rate=RATE, start=0.0, values=values), angle_track(edges))
    average, turns = synchronous_average(signal, 1.0, 512)
    θ = 2 * pi * np.arange(512) / 512
    assert turns >= 42
    assert np.std(average - pattern(θ)) < 1.5 * 0.8 / np.sqrt(turns)


@pytest.mark.parametrize("depth", [0.1, 0.5, 1.0])
def test_the_envelope_spectrum_of_a_modulated_carrier_is_in_closed_form(depth):
    carrier = np.cos(2 * pi * 1500.0 * time())
    x, a = envelope_spectrum((1 + depth * np.cos(2 * pi * 25.0 * time())) * carrier, RATE, (1000.0, 2000.0))
    at = np.argmin(np.abs(x - 25.0)), np.argmin(np.abs(x - 50.0))
    mean = 1 + depth**2 / 2
    assert a[at[0]] == pytest.approx(2 * depth / mean, rel=0.01)
    assert a[at[1]] == pytest.approx(depth**2 / 2 / mean, rel=0.02)
    assert x[np.argmax(a)] == pytest.approx(25.0, abs=x[1])


def test_a_band_that_cannot_be_and_a_signal_with_nothing_in_it_are_clear_errors():
    with pytest.raises(ParameterError, match="must lie within"):
        envelope_spectrum(np.cos(2 * pi * 100 * time()), RATE, (3000.0, 2000.0))
    with pytest.raises(NotAvailable, match="nothing between"):
        envelope_spectrum(np.zeros(N), RATE, (1000.0, 2000.0))
