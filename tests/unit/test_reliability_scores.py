"""Scores of stated distributions, on distributions whose scores are known."""

from statistics import NormalDist

import numpy as np
import pytest

from benchmarks.reliability_scores import Scored, reached, scored, table
from benchmarks.wear_histories import CLASSES, drawn, followed

NORMAL = NormalDist()


def row(at, true, std=0.1):
    return scored(
        lambda p: 1.0 + std * NORMAL.inv_cdf(p), true, at, group="J", kind="constant", what="depth", campaign="a",
        by="twin",
    )  # fmt: skip


def test_crps_of_a_normal_distribution_is_the_closed_form():
    """CRPS = σ·(z·(2Φ(z) − 1) + 2φ(z) − 1/√π), Gneiting and Raftery, J. Am. Stat. Assoc. 102 (2007) 359, eq. 21."""
    for z in (-1.5, 0.0, 0.8):
        closed = 0.1 * (z * (2 * NORMAL.cdf(z) - 1) + 2 * NORMAL.pdf(z) - 1 / np.sqrt(np.pi))
        true = 1.0 + 0.1 * z
        assert row(NORMAL.cdf(z), true).crps * true == pytest.approx(closed, rel=0.03)


def test_calibrated_truths_lie_below_each_quantile_as_often_as_it_says():
    random = np.random.default_rng(3)
    z = random.normal(size=4000)
    line = table([row(NORMAL.cdf(float(v)), 1.0 + 0.1 * float(v)) for v in z], lambda r: r.kind)[-1].split()
    assert [int(n) for n in line[2:9]] == pytest.approx([5, 10, 25, 50, 75, 90, 95], abs=2)
    assert int(line[9]) == pytest.approx(90, abs=2)


def test_truth_beyond_the_stated_quantiles_is_at_their_ends():
    assert reached([1.0, 2.0], [0.1, 0.9], 0.5) == 0.0
    assert reached([1.0, 2.0], [0.1, 0.9], 2.5) == 1.0
    assert reached([1.0, 2.0], [0.1, 0.9], 1.5) == pytest.approx(0.5)


@pytest.mark.parametrize("kind", CLASSES)
def test_a_drawn_history_wears_to_its_end_and_is_drawn_again_alike(kind):
    history, again = drawn(kind, 5), drawn(kind, 5)
    assert np.all(np.diff(history.depths) > 0) and history.depths[-1] < history.end
    assert history.counts[-1] == pytest.approx(0.97 * history.life)
    assert np.array_equal(history.measured, again.measured)
    found = list(followed(history))
    assert [f.what for f in found][-1] == "end" and all(isinstance(f, Scored) for f in found)


def test_a_drawn_depth_is_off_as_campaigns_are():
    """Relative errors of depths beyond 20 µm: about COMMON, one standard deviation."""
    off = np.concatenate(
        [(h.measured / h.depths - 1)[h.depths > 20e-6] for h in (drawn("constant", s) for s in range(60))]
    )
    assert 0.006 < off.std() < 0.013


@pytest.mark.slow
def test_bands_of_drawn_lives_hold_the_truth():
    """A coarse check of all classes that windows can show: benchmarks.reliability has the figures."""
    seen = [
        f.quantile
        for kind in CLASSES
        if kind != "step ahead"
        for seed in range(1000, 1015)
        for f in followed(drawn(kind, seed))
    ]
    assert 0.82 < np.mean([0.05 <= u <= 0.95 for u in seen]) <= 1.0
