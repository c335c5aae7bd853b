"""The noise floor: calibrated on noise whose spectrum is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from twin.errors import NotAvailable, ParameterError
from twin.features.lines import noise_rms
from twin.features.noise_floor import exceedance, median_bias, noise_floor, threshold
from twin.features.resample import AngleSignal
from twin.features.transforms import hann

N = 16384


def floor_of(x):
    weight = hann(x.size)
    power = np.abs(np.fft.rfft(weight * (x - weight @ x / weight.sum()))) ** 2
    return power, noise_floor(power)


def test_floor_of_white_noise_is_its_variance():
    for seed in range(4):
        x = 0.3 * np.random.default_rng(seed).standard_normal(N)
        _, floor = floor_of(x)
        expected = 0.09 * (hann(N) @ hann(N))
        assert np.mean(floor.power) == pytest.approx(expected, rel=0.04)
        assert np.std(floor.power / expected) == pytest.approx(1 / np.sqrt(floor.freedom), rel=0.4)


def test_lines_on_every_tenth_bin_raise_the_floor_by_less_than_a_quarter():
    rng = np.random.default_rng(5)
    t = np.arange(N) / N
    x = rng.standard_normal(N)
    lines = sum(np.cos(2 * np.pi * f * t + f) for f in np.arange(16.3, N / 2, 10.0))
    _, floor = floor_of(x + lines)
    # a line with its skirts takes six bins of ten; what is left of the skirts reads as noise: on the safe side
    assert 0.95 < np.median(floor.power) / (hann(N) @ hann(N)) < 1.25


@pytest.mark.parametrize("colour", ["white", "red", "resonant"])
def test_false_alarms_come_at_the_stated_rate(colour):
    # 200 records at 10 %: the count is binomial, 20 ± 4.2; three deviations and the little that colour adds
    rng = np.random.default_rng(11)
    alarms, records, n = 0, 200, 4096
    for _ in range(records):
        x = rng.standard_normal(n)
        if colour == "red":
            x = lfilter([1.0], [1.0, -0.7], x)
        if colour == "resonant":
            x = lfilter([1.0], [1.0, -1.2, 0.81], x)
        power, floor = floor_of(x)
        inner = slice(3, -3)
        alarms += (power / floor.power)[inner].max() > floor.threshold(0.1, n // 2 - 5)
    assert 0.02 * records < alarms < 0.17 * records


def test_threshold_grows_where_the_floor_is_uncertain_and_inverts_the_exceedance():
    assert threshold(0.01, 1) == pytest.approx(-np.log(0.01))
    assert threshold(0.01, 100, 20) > threshold(0.01, 100, 2000) > threshold(0.01, 100)
    q = -np.expm1(np.log1p(-0.01) / 100)
    assert exceedance(threshold(0.01, 100, 20), 20) == pytest.approx(q)
    assert exceedance(threshold(0.01, 100)) == pytest.approx(q)


def test_median_of_few_values_is_unbiased():
    rng = np.random.default_rng(2)
    for n in (3, 7, 15):
        mean = np.median(rng.exponential(size=(100_000, n)), axis=1).mean()
        assert median_bias(n) == pytest.approx(mean, rel=0.01)
    assert median_bias(10_001) == pytest.approx(np.log(2), rel=1e-3)


def test_what_cannot_be_is_refused():
    with pytest.raises(ParameterError, match="false_alarm = 0"):
        threshold(0.0, 10)
    with pytest.raises(NotAvailable, match="bins are too few"):
        noise_floor(np.ones(5))
    with pytest.raises(NotAvailable, match="lines fill"):
        noise_floor(np.ones(500), np.ones(500, dtype=bool))


@pytest.mark.parametrize("usable", [0, 1, 40])
def test_a_signal_that_is_hardly_usable_on_the_angle_has_no_noise_floor_and_says_so(usable):
    """With no usable sample at all, the longest of no stretches ended the window with a traceback."""
    good = np.zeros(N, dtype=bool)
    good[N // 2 : N // 2 + usable] = True
    signal = AngleSignal(start=0.0, step=2 * np.pi / 512, values=np.ones(N), usable=good)
    with pytest.raises(NotAvailable, match="the noise floor is not available"):
        noise_rms(signal, 20.0, (100.0, 5000.0))
