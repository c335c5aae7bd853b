"""Ratio and run-out of a pair from two encoders alone, through a run-up, reversals and missed counts."""

from fractions import Fraction

import numpy as np
import pytest

from twin.baseline.encoder_pair import pair_motion, quadrature
from twin.errors import WindowError

PER_TURN, RATE, RATIO = 4000, 20000.0, 31 / 16


def levels(counts):
    """Quadrature levels of whole counts."""
    a = np.array([0, 0, 1, 1])[counts % 4]
    return a, np.array([0, 1, 1, 0])[counts % 4]


def counted(seed, seconds=6.0, missed=0, once=(0.008, 0.02), ratio=RATIO):
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    speed = np.clip(t - 0.5, 0, 0.5) * 2 * np.clip(seconds - 0.5 - t, 0, 0.5) * 2 * 1.4
    θ1 = 2 * np.pi * np.cumsum(speed) / RATE + 4e-4 * np.sin(40 * t) * (t < 0.5)
    smooth = np.convolve(rng.normal(size=t.size + 400), np.hanning(401) / 200, "valid")
    θ2 = (θ1 - once[0] * np.cos(θ1 + 0.3) - 2e-3 * smooth * (speed > 0)) / ratio
    θ2 = θ2 - once[1] * np.sin(θ2) / ratio
    n1, n2 = (np.floor(θ / (2 * np.pi) * PER_TURN).astype(int) for θ in (θ1, -θ2))
    if missed:
        n1 = n1 - missed * (t > 3.1)
    return n1, n2


def test_levels_give_the_counts_back_with_reversals_and_illegal_steps():
    counts = np.array([0, 1, 2, 3, 4, 3, 2, 3, 4, 5])
    found = quadrature(*levels(counts))
    assert np.array_equal(found.counts, counts)
    assert found.reversals == 2 and found.illegal == 0
    assert quadrature(*levels(np.array([0, 1, 3, 4]))).illegal == 1


@pytest.mark.parametrize("seed", range(4))
def test_ratio_and_run_out_are_found_with_an_uncertainty_that_holds(seed):
    found = pair_motion(*counted(seed), (PER_TURN, PER_TURN), RATE)
    assert found.opposite
    assert abs(found.ratio / RATIO - 1) < 0.002
    assert abs(found.ratio - RATIO) < 3 * found.ratio_std
    assert Fraction(31, 16) in found.teeth
    sizes = {(r.wheel, r.multiple): r for r in found.run_out}
    assert sizes[1, 1].amplitude == pytest.approx(0.008, abs=3 * sizes[1, 1].std + 2e-4)
    assert sizes[2, 1].amplitude == pytest.approx(0.02, abs=3 * sizes[2, 1].std + 2e-4)
    assert found.after.std() < 0.3 * found.before.std()
    assert found.steps == ()


def test_missed_counts_are_found_with_their_time_and_their_number():
    found = pair_motion(*counted(2, missed=40), (PER_TURN, PER_TURN), RATE)
    ((time, size),) = found.steps
    assert time == pytest.approx(3.1, abs=0.15)
    assert size / (2 * np.pi) * PER_TURN == pytest.approx(-40, abs=6)
    assert abs(found.ratio - RATIO) < 3 * found.ratio_std


def test_wheels_that_hardly_turn_tell_nothing():
    with pytest.raises(WindowError, match="tell no ratio"):
        pair_motion(np.arange(2000), np.arange(1000), (PER_TURN, PER_TURN), RATE)
