"""Ratio and run-out of a pair from two encoders alone, through a run-up, reversals and missed counts."""

from fractions import Fraction

import numpy as np
import pytest

from twin.encoder_pair.motion import forward_edges, pair_motion, quadrature
from twin.errors import WindowError
from twin.windows import Edges

PER_TURN, RATE, RATIO = 4000, 20000.0, 31 / 16


def levels(counts):
    """Quadrature levels of whole counts."""
    a = np.array([0, 0, 1, 1])[counts % 4]
    return a, np.array([0, 1, 1, 0])[counts % 4]


def counts(seed, seconds=6.0, missed=0, once=(0.008, 0.02), ratio=RATIO):
    """Counts of both encoders at every sample, through a run-up and a stop; the second wheel turns the other way."""
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


def counted(*given, **what):
    """The same as edges."""
    both = (forward_edges(n, RATE).times for n in counts(*given, **what))
    return tuple(Edges(per_rev=PER_TURN, first_index=i, times=times) for i, times in enumerate(both))


def test_levels_give_the_counts_back_with_reversals_and_illegal_steps():
    counts = np.array([0, 1, 2, 3, 4, 3, 2, 3, 4, 5])
    found = quadrature(*levels(counts))
    assert np.array_equal(found.counts, counts)
    assert found.reversals == 2 and found.illegal == 0
    assert quadrature(*levels(np.array([0, 1, 3, 4]))).illegal == 1


@pytest.mark.parametrize("seed", range(4))
def test_ratio_and_run_out_are_found_with_an_uncertainty_that_holds(seed):
    found = pair_motion(*counted(seed))
    assert abs(found.ratio / RATIO - 1) < 0.002
    assert abs(found.ratio - RATIO) < 3 * found.ratio_std
    assert Fraction(31, 16) in found.teeth
    sizes = {(r.wheel, r.multiple): r for r in found.run_out}
    assert sizes[1, 1].amplitude == pytest.approx(0.008, abs=3 * sizes[1, 1].std + 2e-4)
    assert sizes[2, 1].amplitude == pytest.approx(0.02, abs=3 * sizes[2, 1].std + 2e-4)
    assert found.after.std() < 0.3 * found.before.std()
    assert found.steps == () and found.jumps == ()


def test_missed_counts_are_found_with_their_time_and_their_number():
    found = pair_motion(*counted(2, missed=40))
    ((time, size),) = found.steps
    assert time == pytest.approx(3.1, abs=0.02)
    assert size / (2 * np.pi) * PER_TURN == pytest.approx(-40, abs=3)
    assert abs(found.ratio - RATIO) < 3 * found.ratio_std


def test_missed_transition_between_two_of_one_sense_counts_two_and_one_at_a_reversal_none():
    on = quadrature(*levels(np.array([0, 1, 3, 4])))
    assert (on.illegal, on.filled) == (1, 1) and np.array_equal(on.counts, [0, 1, 3, 4])
    turned = quadrature(*levels(np.array([0, 1, 3, 2])))
    assert (turned.illegal, turned.filled) == (1, 0) and np.array_equal(turned.counts, [0, 1, 1, 0])


def test_edges_of_the_forward_sense_rise_and_what_is_turned_back_is_passed_once():
    found = forward_edges(-np.array([0, 1, 2, 1, 0, 1, 2, 3, 5]), 10.0)
    assert found.sense == -1 and found.reversed_counts == 2
    assert found.times == pytest.approx([0.05, 0.15, 0.65, 0.725, 0.775])
    with pytest.raises(WindowError, match="no forward sense"):
        forward_edges(np.array([0, 1, 0]), 10.0)


def marked(turns, counts, at=0.3, angle=0.0):
    """Both wheels' edges; the second one's disc has a mark at `at` of its turn that costs `counts` and gives them back
    by `at` and a half; what is missed once is given by `angle`, in turns of wheel 1."""
    rng = np.random.default_rng(3)
    θ1 = np.arange(turns * PER_TURN) * (2 * np.pi / PER_TURN)
    smooth = np.convolve(rng.normal(size=θ1.size + 400), np.hanning(401) / 200, "valid")[: θ1.size]
    turned = θ1 / RATIO / (2 * np.pi) % 1
    sharp = np.clip(1 - (turned - at) / 0.5, 0, 1) * (turned >= at)
    θ2 = (θ1 - 2e-3 * smooth - counts * 2 * np.pi / PER_TURN * sharp) / RATIO
    passed = np.maximum.accumulate(θ2) / (2 * np.pi) * PER_TURN
    times = np.interp(np.arange(20, passed[-1]), passed, θ1)
    first = np.delete(θ1, slice(int(angle * PER_TURN), int(angle * PER_TURN) + 30)) if angle else θ1
    return tuple(Edges(per_rev=PER_TURN, first_index=i, times=t) for i, t in ((0, first), (20, times)))


def test_sharp_step_that_comes_every_turn_is_the_wheels_and_no_missed_counts():
    found = pair_motion(*marked(7, 15))
    assert found.steps == ()
    (jump,) = found.jumps
    assert (jump.wheel, jump.seen) == (2, 4) and jump.turn == pytest.approx(0.3, abs=0.005)
    assert jump.size / (2 * np.pi) * PER_TURN == pytest.approx(15, abs=3)


@pytest.mark.slow
def test_what_is_passed_once_only_is_indistinguishable_from_a_mark_and_widens_the_ratio():
    for turns, told in ((3.4, False), (7, True)):
        found, clean = pair_motion(*marked(turns, 0, angle=1.75)), pair_motion(*marked(turns, 0))
        assert [round(s / (2 * np.pi) * PER_TURN) for _, s in found.steps] == ([-30] if told else [])
        assert [j.wheel for j in found.jumps] == ([] if told else [None])
        assert abs(found.ratio - RATIO) < 2.5 * found.ratio_std
        assert told or found.ratio_std > 3 * clean.ratio_std


@pytest.mark.slow
def test_lost_edges_and_either_wheel_first_give_the_same_ratio():
    first, second = counted(1)
    holed = first.times.copy()
    holed[500:900] = np.nan
    lossy = pair_motion(Edges(per_rev=PER_TURN, first_index=77, times=holed), second)
    whole, turned = pair_motion(first, second), pair_motion(second, first)
    assert lossy.ratio == pytest.approx(whole.ratio, abs=whole.ratio_std)
    assert 1 / turned.ratio == pytest.approx(whole.ratio, abs=whole.ratio_std)


def test_terms_that_come_as_often_within_less_than_a_turn_are_said_to_be_alike():
    alike = {(r.wheel, r.multiple): r.alike for r in pair_motion(*counted(0, seconds=4.0)).run_out}
    assert alike[1, 1] == ((2, 2),) and alike[2, 2] == ((1, 1),) and alike[2, 1] == ()


@pytest.mark.parametrize(
    ("first", "second", "message"),
    [
        (np.arange(2000.0), np.arange(1000.0), "do not determine a ratio"),
        (np.arange(9000.0), 1e5 + np.arange(9000.0), "at the same time"),
    ],
)
def test_wheels_that_hardly_turn_or_never_together_tell_nothing(first, second, message):
    with pytest.raises(WindowError, match=message):
        pair_motion(*(Edges(per_rev=PER_TURN, first_index=0, times=t) for t in (first, second)))


@pytest.mark.slow
def test_a_long_window_of_a_fast_machine_is_answered_from_its_first_turns():
    times = np.arange(600 * PER_TURN) / (60.0 * PER_TURN)
    slow = np.arange(600 / RATIO * 64) * RATIO / 64 / 60 + 2e-5 * np.cos(2 * np.pi / 64 * np.arange(600 / RATIO * 64))
    found = pair_motion(*(Edges(per_rev=n, first_index=0, times=t) for n, t in ((PER_TURN, times), (64, slow))))
    assert found.turns[0] == pytest.approx(600, abs=0.1) and found.angle[-1] == pytest.approx(800 * np.pi, rel=0.01)
    assert found.ratio == pytest.approx(RATIO, abs=3 * found.ratio_std) and found.ratio_std < 1e-3
    (gear,) = [r for r in found.run_out if (r.wheel, r.multiple) == (2, 1)]
    assert gear.amplitude == pytest.approx(2e-5 * 60 * 2 * np.pi, rel=0.05)


def test_a_coarse_encoder_that_loses_most_of_its_edges_still_gives_the_ratio():
    rng = np.random.default_rng(1)
    times = [np.arange(n) / rate for n, rate in ((480, 16.0), (248, 16.0 / RATIO))]
    for t in times:
        t[rng.permutation(t.size)[: round(0.7 * t.size)]] = np.nan
    found = pair_motion(*(Edges(per_rev=16, first_index=0, times=t) for t in times))
    assert found.ratio == pytest.approx(RATIO, abs=3 * found.ratio_std)


def test_a_tachometer_of_few_edges_tells_no_run_out():
    few = Edges(per_rev=8, first_index=0, times=np.arange(80.0))
    with pytest.raises(WindowError, match="at least 16"):
        pair_motion(few, few)
