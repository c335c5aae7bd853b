"""Wear from windows and inspections together: closed-form linear Gaussian estimation."""

from __future__ import annotations

from dataclasses import replace
from math import inf, sqrt

import numpy as np
import pytest

from twin.updating.inspected_wear import FAULTS, InspectedWork, wear_with_inspections
from twin.updating.memory import RatePrior
from twin.updating.tracker import RateDrift, WearTrack
from twin.updating.wear_points import MOST_POINTS, WearPoint, with_point

STEADY = RateDrift(drift=0.0, surprise=inf)
RATE = 4.0  # κ
COUNTS = np.arange(1, 7) * 1000.0
SHARED, OWN = 0.02, 0.01  # relative standard deviations of a window's work


def point(count, work, shared=SHARED, own=OWN):
    return WearPoint(
        revolutions=float(count), depth=1e-9 * work, work=float(work), shared_std=shared * work, own_std=own * work
    )


def points(factor=1.0, noise=None, **kinds):
    noise = np.zeros(COUNTS.size) if noise is None else noise
    return tuple(point(n, factor * RATE * n * (1 + v), **kinds) for n, v in zip(COUNTS, noise, strict=True))


def track(of, rate=RATE):
    """The windows' own answer."""
    last = of[-1]
    return WearTrack(
        revolutions=last.revolutions, work=last.work, rate=rate, var_work=0.0, cov=0.0, var_rate=0.0, windows=len(of)
    )


def inspected(count, work, std):
    return InspectedWork(revolutions=float(count), work=float(work), std=float(std))


def estimate(of, *inspections, prior=RATE, alike=inf, drift=STEADY, by=None, **more):
    known = RatePrior(rate=prior, std=STEADY.prior * prior)
    return wear_with_inspections(of, inspections, known, by or track(of), alike, drift=drift, **more)


def by_matrices(of, inspections, prior, at):
    """x and κ at a count by the normal equations of κ and b alone: x = κ·N at a constant rate."""
    rows, values, stds = [[1.0, 0.0], [0.0, 1.0]], [prior, 0.0], [STEADY.prior * prior, 1.0]
    for p in of:
        rows, values, stds = [*rows, [p.revolutions, p.shared_std]], [*values, p.work], [*stds, p.own_std]
    for i in inspections:
        rows, values, stds = [*rows, [i.revolutions, 0.0]], [*values, i.work], [*stds, i.std]
    W = np.diag(1 / np.array(stds) ** 2)
    A = np.array(rows)
    P = np.linalg.inv(A.T @ W @ A)
    κ = float((P @ A.T @ W @ np.array(values))[0])
    return κ * at, κ, P[0, 0] * at**2, P[0, 0] * at, P[0, 0]


INSPECTIONS = {
    "now": (inspected(6000, 0.97 * RATE * 6000, 0.01 * RATE * 6000),),
    "earlier": (inspected(2500, 1.02 * RATE * 2500, 0.005 * RATE * 2500),),
    "at a window": (inspected(3000, 0.98 * RATE * 3000, 0.02 * RATE * 3000),),
    "after the last window": (inspected(7500, 1.01 * RATE * 7500, 0.01 * RATE * 7500),),
    "three, entered late": (
        inspected(5000, 0.99 * RATE * 5000, 200), inspected(1500, 1.0 * RATE * 1500, 90), inspected(500, 2100, 300),
    ),
}  # fmt: skip


@pytest.mark.parametrize("which", INSPECTIONS)
def test_estimate_is_that_of_the_normal_equations(which):
    of = points(noise=np.array([0.01, -0.012, 0.004, 0.0, 0.008, -0.003]))
    inspections = INSPECTIONS[which]
    x, κ, var_x, cov, var_κ = by_matrices(of, inspections, RATE, 6000.0)
    plain = by_matrices(of, (), RATE, 6000.0)
    own = WearTrack(revolutions=6000.0, work=plain[0], rate=plain[1], var_work=0, cov=0, var_rate=0, windows=6)
    found = estimate(of, *inspections, by=own).track
    assert (found.work, found.rate) == (pytest.approx(x, rel=1e-9), pytest.approx(κ, rel=1e-9))
    assert (found.var_work, found.cov, found.var_rate) == (
        pytest.approx(var_x, rel=1e-6), pytest.approx(cov, rel=1e-6), pytest.approx(var_κ, rel=1e-6)
    )  # fmt: skip


def test_inspections_in_any_order_give_the_same():
    of, three = points(), INSPECTIONS["three, entered late"]
    first, other = estimate(of, *three, alike=3.5).track, estimate(of, *three[::-1], alike=3.5).track
    assert other.work == pytest.approx(first.work) and other.rate == pytest.approx(first.rate)


def test_precise_inspection_sets_the_depth_and_takes_the_rate_along():
    true = 1.04 * RATE
    found = estimate(points(), inspected(6000, true * 6000, 1.0)).track
    assert found.work == pytest.approx(true * 6000, rel=1e-3)
    assert found.rate == pytest.approx(true, rel=0.01)
    assert sqrt(found.var_work) < 1.5


def test_inspection_that_says_little_leaves_the_windows_own_answer():
    of = points(noise=np.array([0.01, -0.01, 0.01, -0.01, 0.01, 0.015]))
    own = track(of, rate=1.01 * RATE)
    found = estimate(of, inspected(6000, 5000, 1e9), by=own).track
    assert (found.work, found.rate) == (pytest.approx(own.work), pytest.approx(own.rate))


def test_early_inspection_says_less_of_now_where_depths_are_off_alike_over_short_distances():
    one = inspected(1000, 0.96 * RATE * 1000, 0.002 * RATE * 1000)
    far, near = (estimate(points(), one, alike=alike).track.work for alike in (100.0, 0.5))
    assert far < near < RATE * 6000


def test_inspection_alone_sets_the_rate_before_any_worn_window():
    unworn = WearTrack.unworn(3 * RATE)
    found = wear_with_inspections(
        (), [inspected(2000, RATE * 2000, 100.0)], RatePrior(rate=3 * RATE, std=3 * RATE),
        replace(unworn, revolutions=2000.0), 3.5,
    ).track  # fmt: skip
    assert found.work == pytest.approx(RATE * 2000, rel=0.01)
    assert found.rate == pytest.approx(RATE, rel=0.02)


def test_rate_of_the_pair_before_is_weighed_with_an_inspection_by_its_own_spread():
    """Precision-weighted mean of a prior of 5·κ ± 50 % and an inspection."""
    prior, of = RatePrior(rate=5 * RATE, std=2.5 * RATE), WearTrack.unworn(5 * RATE)
    by = replace(of, revolutions=1000.0, work=5 * RATE * 1000)
    found = wear_with_inspections((), [inspected(1000, 4 * RATE * 1000, RATE * 1000)], prior, by, 3.5, drift=STEADY)
    weights = 1 / np.array([2.5, 1.0]) ** 2
    assert found.track.rate == pytest.approx(RATE * np.average([5, 4], weights=weights), rel=1e-6)
    assert not found.agreements[0].contradicts


def test_contradiction_is_said_and_the_band_covers_both():
    of, measured = points(), 1.4 * RATE * 6000
    found = estimate(of, inspected(6000, measured, 0.01 * measured))
    assert found.agreements[0].contradicts and found.agreements[0].difference < -FAULTS.contradiction
    assert found.work_quantile(0.05) < RATE * 6000 < measured < 1.01 * found.work_quantile(0.95)
    assert 0.2 < found.windows_wrong < 0.8
    assert sum(found.weights) == pytest.approx(1.0)


def test_two_inspections_that_agree_outvote_the_windows():
    found = estimate(points(), *(inspected(n, 1.4 * RATE * n, 0.01 * RATE * n) for n in (3000, 6000)))
    assert found.windows_wrong > 0.99
    assert found.track.work == pytest.approx(1.4 * RATE * 6000, rel=0.01)
    assert found.track.rate == pytest.approx(1.4 * RATE, rel=0.03)


def test_one_inspection_of_three_that_is_off_is_outvoted():
    good = (inspected(n, 0.99 * RATE * n, 0.01 * RATE * n) for n in (3000, 6000))
    found = estimate(points(), *good, inspected(4500, 2 * RATE * 4500, 0.01 * RATE * 4500))
    assert [a.contradicts for a in found.agreements] == [False, False, True]
    assert found.windows_wrong < 0.01
    assert found.track.work == pytest.approx(0.99 * RATE * 6000, rel=0.01)


def test_inspection_that_agrees_narrows_the_band():
    of = points()
    alone = by_matrices(of, (), RATE, 6000.0)[2]
    assert estimate(of, inspected(6000, RATE * 6000, 0.01 * RATE * 6000)).track.var_work < 0.4 * alone


@pytest.mark.slow
def test_hundreds_of_simulated_inspections_are_within_their_uncertainty():
    """|error after| in its own standard deviations, and the mean error before and after."""
    random = np.random.default_rng(13)
    before, after, scores = [], [], []
    for _ in range(300):
        true = RATE * random.uniform(0.5, 2)
        of = tuple(
            point(p.revolutions, true * p.revolutions * (1 + v))
            for p, v in zip(points(), SHARED * random.normal() + OWN * random.normal(size=6), strict=True)
        )
        count, std = random.uniform(500, 6000), random.uniform(0.003, 0.05) * true * 6000
        one = inspected(count, max(true * count + std * random.normal(), 0.0), std)
        plain = by_matrices(of, (), RATE, 6000.0)
        own = WearTrack(revolutions=6000.0, work=plain[0], rate=plain[1], var_work=0, cov=0, var_rate=0, windows=6)
        found = estimate(of, one, by=own)
        before.append(abs(plain[0] / (true * 6000) - 1))
        after.append(abs(found.track.work / (true * 6000) - 1))
        scores.append((found.track.work - true * 6000) / found.track.work_std)
        assert after[-1] <= max(before[-1], 4 * std / (true * count))
    assert np.mean(after) < 0.9 * np.mean(before)
    assert 0.85 < np.mean(np.abs(scores) < 1.645) < 0.95


def test_points_of_a_long_history_stay_few_and_keep_the_latest():
    kept = ()
    for n in range(1000):
        kept = with_point(kept, point(n + 1.0, RATE * (n + 1)))
    assert len(kept) <= MOST_POINTS
    assert [p.revolutions for p in kept[-50:]] == [951.0 + i for i in range(50)]


def test_doubted_windows_keep_the_growth_that_they_measured_since_an_inspection():
    works = RATE * 1000 * np.cumsum([1.5, 1.2, 1.0, 0.9, 0.85, 0.8])  # running-in: the rate falls by half
    of = tuple(point(n, work) for n, work in zip(COUNTS, works, strict=True))
    halfway = inspected(3000, works[2], 0.05 * works[2])  # it agrees with the windows
    found = estimate(of, halfway, doubt=0.25, drift=RateDrift())
    assert found.work_quantile(0.5) == pytest.approx(works[-1], rel=0.03)
    assert found.work_quantile(0.95) - found.work_quantile(0.05) < 2.5 * 1.645 * 0.06 * works[-1]
    assert abs(found.agreements[0].difference) < 0.5 and found.windows_wrong == 0.0


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_an_inspection_corrects_doubted_windows_by_a_common_factor(factor):
    exact = inspected(3000, factor * RATE * 3000, 0.01 * factor * RATE * 3000)
    found = estimate(points(), exact, doubt=0.25, prior=factor * RATE)
    assert found.work_quantile(0.5) == pytest.approx(factor * RATE * COUNTS[-1], rel=0.03)
    assert not found.agreements[0].contradicts


def test_doubted_windows_alone_are_as_certain_as_stated():
    found = estimate(points(), inspected(3000, RATE * 3000, 1e6 * RATE), doubt=0.25)  # an inspection that says nothing
    width = (found.work_quantile(0.84) - found.work_quantile(0.16)) / 2 / (RATE * COUNTS[-1])
    assert width == pytest.approx(0.25, rel=0.25)
