"""RMS in a band, against signals whose RMS is known in closed form."""

import numpy as np
import pytest

from twin.errors import NotAvailable, WindowError
from twin.features.level import band_level, band_rms
from twin.windows import Samples

RATE = 12800.0
BAND = (0.0, 2000.0)


def sine(frequency, amplitude=3.0, seconds=2.5, offset=0.0):
    t = np.arange(round(seconds * RATE)) / RATE
    return offset + amplitude * np.sin(2 * np.pi * frequency * t + 0.7)


def samples(values):
    return Samples(rate=RATE, start=0.0, values=values)


@pytest.mark.parametrize("frequency", [21.77, 190.31, 767.1, 1911.137])
def test_rms_of_a_sine_is_its_amplitude_over_root_two_for_any_number_of_cycles(frequency):
    assert band_rms(samples(sine(frequency)), BAND) == pytest.approx(3 / np.sqrt(2), rel=2e-4)


def test_rms_leaves_out_what_lies_above_the_band():
    assert band_rms(samples(sine(500.0) + sine(2111.3, 50.0)), BAND) == pytest.approx(3 / np.sqrt(2), rel=1e-3)


def test_rms_leaves_out_the_mean():
    assert band_rms(samples(sine(190.0, offset=250.0)), BAND) == pytest.approx(3 / np.sqrt(2), rel=2e-4)


def test_rms_of_noise_is_the_share_of_the_band():
    noise = np.random.default_rng(3).standard_normal(256_000)
    assert band_rms(samples(noise), BAND) == pytest.approx(np.sqrt(2000 / 6400), rel=0.02)


def test_single_lost_samples_are_bridged_and_a_long_gap_is_left_out():
    values = sine(190.31)
    values[[100, 5000, 5001]] = np.nan
    whole = band_level(samples(values), BAND)
    assert whole.valid_share == 1.0
    assert whole.rms == pytest.approx(3 / np.sqrt(2), rel=1e-3)
    values[8000:16000] = np.nan
    values[16100:16200] = np.nan  # the stretch between is too short to be used
    part = band_level(samples(values), BAND)
    assert part.valid_share == pytest.approx(1 - 8200 / values.size)
    assert part.rms == pytest.approx(3 / np.sqrt(2), rel=1e-3)


def test_a_band_beyond_half_the_sampling_rate_is_not_available():
    with pytest.raises(NotAvailable, match="1500 Hz ends at 750 Hz"):
        band_rms(Samples(rate=1500.0, start=0.0, values=np.ones(3000)), BAND)


def test_a_channel_without_a_valid_sample_is_refused():
    with pytest.raises(WindowError, match="not one of"):
        band_rms(samples(np.full(1000, np.nan)), BAND)
