"""Histories of the wear rate: closed forms, limits, and the same by a Kalman filter and by drawing."""

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from twin.updating.rate_histories import HISTORIES
from twin.updating.remaining_life import LifeMixture, RemainingLife
from twin.updating.tracker import WearTrack
from twin.updating.wear_forecast import forecast_of
from twin.updating.wear_points import WearPoint

RATE = 3.0
COUNTS = 1000.0 * np.arange(1, 13)
ONLY_STEADY = replace(
    HISTORIES, wanders=(0.0, 1e-9), steady=1 - 1e-9, irregular=(0.0,), running_in_prior=1e-12, trend_prior=1e-12,
    power_prior=1e-12, step_prior=1e-12, shift_prior=1e-12, scatters=(1.0,),
)  # fmt: skip


def points_of(works, own=0.005, shared=0.0, counts=COUNTS):
    return tuple(
        WearPoint(revolutions=n, depth=1e-9 * x, work=x, shared_std=shared * x, own_std=own * x)
        for n, x in zip(counts.tolist(), np.asarray(works).tolist(), strict=True)
    )


def noisy(works, seed=0, std=0.003):
    return works * (1 + std * np.random.default_rng(seed).normal(size=works.size))


def life(forecast, end):
    """Median and spread of the mixture."""
    lives = forecast.lives(end)
    logs = np.log(lives.median)
    middle = float(lives.weights @ logs)
    var = float(lives.weights @ (np.log1p(lives.relative**2) + (logs - middle) ** 2))
    return float(np.exp(middle)), np.sqrt(var)


def test_a_steady_rate_alone_is_weighted_least_squares_through_the_origin():
    """With one history, z = κ·N + v and a prior of κ: the closed form of the normal equations."""
    works = noisy(RATE * COUNTS)
    points = points_of(works)
    found = forecast_of(points, COUNTS[-1], ONLY_STEADY)
    own = np.array([p.own_std for p in points])
    prior = works[-1] / COUNTS[-1]
    information = 1 / prior**2 + np.sum((COUNTS / own) ** 2)
    rate = (1 / prior + np.sum(COUNTS * works / own**2)) / information
    assert found.rate == pytest.approx(rate, rel=1e-6)
    assert found.covariance[0, 1, 1] == pytest.approx(1 / information, rel=1e-4)
    median, spread = life(found, 2 * works[-1])
    assert median == pytest.approx((2 * works[-1] - rate * COUNTS[-1]) / rate, rel=1e-5)
    assert spread == pytest.approx(np.sqrt(1 / information) * (COUNTS[-1] + median) / (rate * median), rel=1e-3)


def test_a_wandering_rate_is_that_of_a_kalman_filter_over_fine_steps():
    """One history of wander g: the integrated Wiener process followed by the Kalman filter in 200 steps a window."""
    g, works = 0.3, noisy(RATE * COUNTS * (1 + 2e-5 * COUNTS))
    only = replace(ONLY_STEADY, wanders=(g, g), steady=0.5)
    points = points_of(works)
    found = forecast_of(points, COUNTS[-1], only)
    mean_rate, fine = works[-1] / COUNTS[-1], 200
    q = (g * mean_rate) ** 2 / COUNTS[-1]
    x, P, dn = np.array([0.0, mean_rate]), np.diag([0.0, mean_rate**2]), COUNTS[0] / fine
    F, Q = np.array([[1, dn], [0, 1]]), q * np.array([[dn**3 / 3, dn**2 / 2], [dn**2 / 2, dn]])
    for point in points:
        for _ in range(fine):
            x, P = F @ x, F @ P @ F.T + Q
        gain = P[:, 0] / (P[0, 0] + point.own_std**2)
        x, P = x + gain * (point.work - x[0]), P - np.outer(gain, P[0])
    heaviest = int(found.weights.argmax())
    assert found.mean[heaviest, :2] == pytest.approx(x, rel=1e-6)
    assert found.covariance[heaviest, :2, :2] == pytest.approx(P, rel=1e-4)


def test_variance_of_a_life_under_wander_is_that_of_drawn_futures():
    """From a rate that is known, x(L) = κ·L + ∫W: the life's spread by 4000 drawn Wiener paths."""
    g, now = 0.2, 10_000.0
    only = replace(ONLY_STEADY, wanders=(g, g), steady=0.5)
    found = forecast_of(points_of(RATE * COUNTS, own=1e-6), COUNTS[-1], only)
    exact = replace(found, covariance=np.zeros_like(found.covariance))
    median, spread = life(exact, found.work + RATE * now)
    steps, random = 400, np.random.default_rng(1)
    dn = 3 * now / steps
    rates = RATE + np.cumsum(random.normal(0, g * RATE * np.sqrt(dn / COUNTS[-1]), (4000, steps)), axis=1)
    gone = np.cumsum(rates * dn, axis=1)
    lives = dn * (1 + np.array([np.searchsorted(row, RATE * now) for row in np.maximum.accumulate(gone, axis=1)]))
    assert median == pytest.approx(np.median(lives), rel=0.02)
    assert spread == pytest.approx(np.std(np.log(lives)), rel=0.1)


def test_a_rate_that_wandered_is_expected_to_wander_on():
    """The same noise on a constant rate and on one that goes up and down by a third."""
    steady, restless = RATE * COUNTS, RATE * np.cumsum(1000 * (1 + 0.33 * np.sin(1.3 * np.arange(12))))
    spreads = [life(forecast_of(points_of(noisy(x)), COUNTS[-1]), 2 * x[-1])[1] for x in (steady, restless)]
    assert spreads[1] > 4 * spreads[0]


def test_running_in_is_extrapolated_at_the_late_rate():
    works = RATE * (COUNTS + 1.5 * 2000 * (1 - np.exp(-COUNTS / 2000)))
    found = forecast_of(points_of(noisy(works, std=0.001), own=0.003), COUNTS[-1])
    assert found.rate == pytest.approx(RATE, rel=0.05)
    assert life(found, works[-1] + RATE * 10_000)[0] == pytest.approx(10_000, rel=0.07)


@pytest.mark.parametrize(
    ("p", "count", "ahead"), [(0.6, 12, 1.5), (0.75, 12, 3.0), (1.3, 6, 3.0), (1.6, 8, 2.0), (1.6, 12, 3.0)]
)
def test_band_of_a_life_holds_the_true_one_where_wear_is_a_power_of_the_revolutions(p, count, ahead):
    """Wear as N^p: a wear rate that goes up was a running-in that was over, and the life 15 % too long."""
    now, inside, middles = 12_000.0, 0, []
    counts = now * np.arange(1, count + 1) / count
    true = now * (ahead ** (1 / p) - 1)
    for seed in range(12):
        works = RATE * now * (counts / now) ** p
        found = forecast_of(points_of(noisy(works, seed, 0.006), own=0.01, counts=counts), now)
        lives = found.lives(ahead * works[-1])
        at = np.log(true / lives.median) / np.sqrt(np.log1p(np.maximum(lives.relative, 1e-9) ** 2))
        below = float(lives.weights @ [NormalDist().cdf(x) for x in at])
        inside += 0.05 <= below <= 0.95
        middles.append(life(found, ahead * works[-1])[0] / true)
    assert inside >= 9
    assert 0.7 < np.median(middles) < 1.1


def test_a_power_ahead_is_that_of_the_wear_itself():
    """ψ of N^p by the difference of its values: φ(N + L) − φ(N) − φ'(N)·L."""
    found = forecast_of(points_of(noisy(RATE * COUNTS)), COUNTS[-1])
    now, p = COUNTS[-1], found.power
    φ = lambda n: now / p * (n / now) ** p  # noqa: E731
    for share in (0.1, 0.5, 2.0):
        L = np.full(p.size, share * now)
        ψ, slope = found._bent(L, np.full(p.size, np.inf), np.zeros(p.size), p)
        assert ψ == pytest.approx(φ(now + L) - φ(now) - L, rel=1e-9, abs=1e-6)
        assert slope == pytest.approx((1 + share) ** (p - 1) - 1, rel=1e-9, abs=1e-9)


def test_a_rate_that_rises_to_a_plateau_is_no_running_in():
    works = RATE * (COUNTS - 0.9 * 3000 * (1 - np.exp(-COUNTS / 3000)))
    found = forecast_of(points_of(noisy(works, std=0.002), own=0.004), COUNTS[-1])
    assert found.weights[np.isfinite(found.decay)].sum() < 0.02


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_after_a_step_the_life_goes_at_the_new_rate(factor):
    works = RATE * (COUNTS + (factor - 1) * np.maximum(COUNTS - 5500, 0))
    found = forecast_of(points_of(noisy(works, std=0.001), own=0.003), COUNTS[-1])
    assert found.rate == pytest.approx(factor * RATE, rel=0.06)


def test_depths_that_are_off_together_count_by_the_whole_work():
    """ε on all depths leaves N off by ε·X/(X − x): a hundred windows do not take that away."""
    shared, end = 0.02, 1.25 * RATE * COUNTS[-1]
    found = forecast_of(points_of(RATE * COUNTS, own=1e-4, shared=shared), COUNTS[-1], replace(ONLY_STEADY, alike=1e9))
    assert life(found, end)[1] == pytest.approx(shared * 1.25 / 0.25, rel=0.05)


def test_older_windows_are_merged_without_a_change_of_the_answer():
    counts = 100.0 * np.arange(1, 121)
    points = points_of(RATE * counts, counts=counts)
    merged = forecast_of(points, counts[-1], ONLY_STEADY)
    whole = forecast_of(points, counts[-1], replace(ONLY_STEADY, most_points=120))
    assert merged.rate == pytest.approx(whole.rate, rel=1e-6)


def test_a_later_count_leaves_less_life():
    points = points_of(RATE * COUNTS)
    now, later = (life(forecast_of(points, n), 3 * RATE * COUNTS[-1])[0] for n in (COUNTS[-1], COUNTS[-1] + 5000))
    assert now - later == pytest.approx(5000, rel=0.01)


def test_a_reached_end_is_no_life_and_no_window_is_no_forecast():
    found = forecast_of(points_of(RATE * COUNTS), COUNTS[-1])
    assert life(found, 0.5 * RATE * COUNTS[-1])[0] < 1.0
    assert forecast_of((), 100.0) is None


def test_a_mixture_is_quantile_and_probability_of_one_distribution():
    track = WearTrack.unworn(1.0)
    mixture = LifeMixture(
        weights=np.array([0.7, 0.3]), medians=np.array([100.0, 300.0]), spreads=np.array([0.1, 0.5])
    )  # fmt: skip
    found = RemainingLife(to_go=1.0, rate=track.rate, rate_std=0.0, mixture=mixture)
    for p in (1e-6, 0.05, 0.3, 0.5, 0.8, 0.95):
        (n,) = found.at(np.array([NormalDist().inv_cdf(p)]))
        assert 1 - found.beyond(n) == pytest.approx(p, abs=1e-12)
    for n in (80.0, 120.0, 400.0):
        exact = sum(
            w * NormalDist().cdf(np.log(n / m) / s) for w, m, s in ((0.7, 100.0, 0.1), (0.3, 300.0, 0.5))
        )  # fmt: skip
        assert found.beyond(n) == pytest.approx(1 - exact, abs=1e-12)


def test_a_falling_trend_fades_so_that_a_life_has_an_end():
    """A rate that falls by half along a line would reach zero after as many revolutions again."""
    works = RATE * (COUNTS - COUNTS**2 / (4 * COUNTS[-1]))
    found = forecast_of(points_of(noisy(works, std=0.0005), own=0.003), COUNTS[-1])
    lives = found.lives(works[-1] + 0.5 * RATE * COUNTS[-1])
    heavy = lives.weights > 0.01
    assert np.all((lives.median[heavy] > COUNTS[-1]) & (lives.median[heavy] < 3 * COUNTS[-1]))
    assert np.all(lives.relative[heavy] < 0.5)


@pytest.mark.parametrize("shift", [-0.03, 0.03])
def test_a_shift_of_all_depths_is_told_from_wear(shift):
    """At a tenth of the work before the end, a shift of 3 % taken for wear would move the life by a third."""
    works = RATE * COUNTS
    shifted = works * np.where(COUNTS > 7500, 1 + shift, 1.0)
    median, _ = life(forecast_of(points_of(noisy(shifted, std=0.0005), own=0.003), COUNTS[-1]), 1.1 * works[-1])
    assert median == pytest.approx(1200.0, rel=0.1)
