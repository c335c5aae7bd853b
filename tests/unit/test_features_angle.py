"""The spline of the smoothed angle against scipy's, and the windows that features share against what is stated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_lsq_spline

from twin.features.angle import MANY, fit_track, least_squares_spline
from twin.features.gaps import runs
from twin.features.orders import _Transform
from twin.features.transforms import hann

RNG = np.random.default_rng(8)


@pytest.mark.parametrize("pieces", [1, 2, 67])
@pytest.mark.parametrize("each", [MANY + 8, 96])
def test_the_normal_equations_give_the_spline_of_an_orthogonal_factorisation(pieces, each):
    x = np.sort(np.append(RNG.uniform(0, 600, pieces * each - 2), [0.0, 600.0]))
    knots = np.concatenate(([0.0] * 3, np.linspace(0, 600, pieces + 1), [600.0] * 3))
    y = 1e-4 * np.sin(x / 50) + 1e-7 * RNG.standard_normal(x.size)
    expected = make_lsq_spline(x, y, knots, k=3).c
    assert least_squares_spline(x, y, knots) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


def test_a_steady_rise_of_the_speed_is_followed_also_where_edges_are_few():
    for count, most in ((6400, 1e-9), (200, 1e-9), (30, 1e-9)):
        angle = np.linspace(0.0, 200.0, count)
        time = angle / 60 - 1e-6 * angle**2 + 1e-10 * angle**3
        track = fit_track(angle, time, 0.0, 200.0, "encoder/pinion")
        assert track.time(angle) == pytest.approx(time, abs=most)
        assert track.slowness(angle) == pytest.approx(1 / 60 - 2e-6 * angle + 3e-10 * angle**2, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 2, 3, 16, 17, 25_581, 100_000])
def test_the_hann_window_is_the_stated_one(n):
    k = np.arange(n)
    expected = np.sin(np.pi * (np.minimum(k, n - 1 - k) + 0.5) / n) ** 2
    assert hann(n) == pytest.approx(expected, rel=1e-13)


def test_a_mask_that_is_all_true_is_one_run_and_an_empty_one_none():
    assert runs(np.ones(5, dtype=bool)) == [(0, 5)] and runs(np.zeros(5, dtype=bool)) == []
    assert runs(np.zeros(0, dtype=bool)) == []


@pytest.mark.parametrize("n", [1, 2, 17, 100, 2601, 10_000])
def test_transforms_at_any_order_are_the_sums_that_are_stated(n):
    step, orders = 2 * np.pi / 500, np.array([0.0, 0.37, 1.0, 19.0, 61.2, 240.0])
    x, weight = RNG.standard_normal(n), RNG.uniform(0, 1, n)
    X = RNG.standard_normal(orders.size) + 1j * RNG.standard_normal(orders.size)
    turning = np.exp(1j * orders * (step * (np.arange(n) - 0.5 * (n - 1)))[:, None])  # (n, orders)
    transform = _Transform(n, step, orders)
    assert transform.forward(x, weight) == pytest.approx((x * weight) @ turning.conj(), abs=1e-12 * n)
    assert transform.back(X) == pytest.approx((turning @ X).real, abs=1e-10)
