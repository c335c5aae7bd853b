"""What the transforms of the features share, against direct sums and scipy."""

import numpy as np
import pytest
from scipy import fft

from twin.features.orders import _hann_transforms
from twin.features.tones import _Local
from twin.features.transforms import bins_within, fast_length_below, hann, power_of, powers, record_of, spectrum_of


@pytest.mark.parametrize("n", [1, 2, 7, 8, 1001])
def test_the_hann_window_is_its_definition_and_read_only(n):
    assert hann(n) == pytest.approx(np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2, abs=1e-15)
    assert np.array_equal(hann(n), hann(n)[::-1])
    with pytest.raises(ValueError):
        hann(n)[0] = 1.0


def test_fast_lengths_are_the_greatest_that_scipy_calls_fast():
    for n in [*range(1, 400), 65_537, 255_999, 256_000]:
        found = fast_length_below(n)
        assert found <= n and fft.next_fast_len(found, real=True) == found
        assert not any(fft.next_fast_len(m, real=True) == m for m in range(found + 1, n + 1))


@pytest.mark.parametrize("count", [1, 2, 3, 8, 500])
def test_powers_are_powers(count):
    factors = np.exp(1j * np.array([0.0, 0.3, -2.0]))
    assert powers(factors, count) == pytest.approx(factors ** np.arange(count)[:, None], abs=1e-13)


def test_bins_within_a_band_count_its_edges():
    frequency = np.arange(50) * 0.1 / 3
    for band in ((0.0, 0.2), (-1.0, 0.0), (0.4 / 3, 0.7 / 3), (0.5, 9.0), (7.0, 9.0), (0.31, 0.32)):
        inside = np.flatnonzero((frequency >= band[0]) & (frequency <= band[1]))
        assert np.array_equal(np.arange(50)[bins_within(band, lambda k: k * 0.1 / 3, 50)], inside)


def test_power_is_the_squared_modulus():
    x = np.array([3 + 4j, -1j, 0])
    assert power_of(x) == pytest.approx([25, 1, 0])


@pytest.mark.parametrize("n", [60, 61])
def test_hanns_own_transform_at_differences_and_sums_of_orders_is_the_direct_sum(n):
    step, turns = 2 * np.pi / 16, n / 16
    orders = np.array([0.0, 0.5 / turns, 1 / turns, 2.3 / turns, 1.7, 3.0, 7.9])
    φ = step * (np.arange(n) - 0.5 * (n - 1))
    found = _hann_transforms(orders, n, step)
    for sign, values in zip((-1, 1), found, strict=True):
        δ = orders[:, None] + sign * orders
        assert values == pytest.approx((hann(n) * np.cos(δ[:, :, None] * φ)).sum(axis=2), abs=1e-10 * n)


def local_model():
    rng, m = np.random.default_rng(3), 4 * 17
    time = np.linspace(-1.0, 1.0, m)
    return _Local(
        y=np.zeros(17, complex), noise=1.0, w=hann(m), time=time, turn=0.3 * time**2, ν=rng.standard_normal(m),
        centre=40.0, speed=10.0,
    )  # fmt: skip


def test_bins_about_a_peak_are_those_of_the_whole_transform():
    local, signals = local_model(), np.random.default_rng(4).standard_normal((3, 68)) + 1j
    whole = np.fft.fft(local.w * signals, axis=1, norm="forward").T
    assert local.bins(signals) == pytest.approx(np.concatenate((whole[-8:], whole[:9])), abs=1e-14)
    assert local.bins(signals[:0]).shape == (17, 0)


def test_evenly_spaced_lines_are_the_lines_of_their_frequencies():
    local, frequencies = local_model(), 39.0 + 0.25 * np.arange(9)
    assert local.even(39.0, 0.25, 9, locked=False) == pytest.approx(local.tones(frequencies), abs=1e-12)
    assert local.even(39.0, 0.25, 9, locked=True) == pytest.approx(local.orders(frequencies / 10.0), abs=1e-12)


@pytest.mark.parametrize("n", [2, 3, 26, 34, 1000, 2 * 127, 2 * 13 * 17, 4 * 101, 999, 30_014])
def test_spectra_of_any_length_and_their_records_are_those_of_scipy(n):
    x = np.random.default_rng(n).standard_normal(n)
    spectrum = spectrum_of(x)
    assert spectrum == pytest.approx(fft.rfft(x), abs=1e-13 * n**0.5 * np.abs(x).max())
    assert record_of(spectrum, n) == pytest.approx(x, abs=1e-13)
