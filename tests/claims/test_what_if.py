"""What if: life under another duty, of the bundled short campaign."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path

import pytest

from benchmarks.scoring import run, windows_of
from twin.assessment import Interval, Preliminary
from twin.errors import NotAvailable, ParameterError
from twin.options import Options
from twin.state import State
from twin.what_if import DutyPoint, Phase, what_if

RECORDING = Path(__file__).parents[2] / "recordings" / "short-campaign.mcap"
HOUR = 3600.0


@pytest.fixture(scope="module")
def machine():
    """Rig and state after the short campaign without attribution."""
    rig, windows = windows_of(RECORDING)
    return rig, run(rig, windows, Options(trace=False))[0]


def duty(*points, duration=inf):
    return Phase(points=tuple(DutyPoint(speed=f, torque=t, share=u) for f, t, u in points), duration=duration)


def present(state, share=1.0):
    return state.latest.life.speed, state.latest.life.torque, share


@pytest.mark.slow
def test_present_duty_gives_the_stated_life(machine):
    rig, state = machine
    life = state.latest.life
    found = what_if(rig, state, [duty(present(state))], until=life.time.median)
    assert found.quantile(0.5) == pytest.approx(life.time.median)
    assert [n for _, _, n in found.quantiles] == pytest.approx([n for _, n in life.distribution], rel=1e-4)
    assert found.probability == pytest.approx(0.5, abs=1e-6)
    assert found.notes == () and not found.reached


def test_probability_of_reaching_a_time_is_that_of_the_quantiles(machine):
    rig, state = machine
    phases = [duty(present(state))]
    quantiles = what_if(rig, state, phases).quantiles
    for p, time, _ in quantiles:
        assert what_if(rig, state, phases, until=time).probability == pytest.approx(1 - p, abs=1e-6)
    times = [t for t, _ in what_if(rig, state, phases).survival]
    assert times == sorted(times)


def test_standing_part_of_the_time_is_no_part_of_a_duty_but_half_the_speed_doubles_the_time(machine):
    """Wear goes by revolutions: within the tolerance of a segment, the life in revolutions stays."""
    rig, state = machine
    f, t, _ = present(state)
    slower = what_if(rig, state, [duty((0.96 * f, t, 1.0))])
    assert slower.quantile(0.5) == pytest.approx(state.latest.life.time.median / 0.96, rel=1e-6)


@pytest.mark.slow
def test_more_load_shortens_the_life_and_widens_its_band_and_says_so(machine):
    rig, state = machine
    f, t, _ = present(state)
    more, less = (what_if(rig, state, [duty((f, factor * t, 1.0))]) for factor in (1.3, 0.8))
    now = state.latest.life.time
    assert 0.65 * now.median < more.quantile(0.5) < 0.9 * now.median
    assert 1.1 * now.median < less.quantile(0.5) < 1.5 * now.median
    assert more.quantile(0.95) / more.quantile(0.5) > 1.02 * now.p95 / now.median
    assert "N·m lies outside those that wear has been seen under" in more.notes[0]


def test_a_mixed_duty_lies_between_its_parts(machine):
    rig, state = machine
    f, t, _ = present(state)
    whole = what_if(rig, state, [duty((f, t, 1.0))]).quantile(0.5)
    heavy = what_if(rig, state, [duty((f, 1.3 * t, 1.0))]).quantile(0.5)
    mixed = what_if(rig, state, [duty((f, t, 0.5), (f, 1.3 * t, 0.5))]).quantile(0.5)
    assert 2 / (1 / whole + 1 / heavy) == pytest.approx(mixed, rel=0.02)  # rates add up


def test_phases_follow_one_another(machine):
    """Half of the life under the present duty, the rest under a heavier one."""
    rig, state = machine
    f, t, _ = present(state)
    whole = what_if(rig, state, [duty((f, t, 1.0))]).quantile(0.5)
    heavy = what_if(rig, state, [duty((f, 1.3 * t, 1.0))]).quantile(0.5)
    found = what_if(rig, state, [duty((f, t, 1.0), duration=0.5 * whole), duty((f, 1.3 * t, 1.0))])
    assert 0.5 * whole + 0.4 * heavy < found.quantile(0.5) < 0.5 * whole + 0.6 * heavy
    late = what_if(rig, state, [duty((f, t, 1.0), duration=10 * whole), duty((f, 1.3 * t, 1.0))])
    assert late.quantile(0.5) == pytest.approx(whole)


def test_preliminary_life_gives_a_preliminary_answer(machine):
    rig, state = machine
    doubt = Preliminary(reasons=("few windows",), remedies=("more windows",))
    life = replace(state.latest.life, preliminary=doubt)
    doubted = replace(state, latest=replace(state.latest, life=life))
    assert what_if(rig, doubted, [duty(present(state))]).preliminary == doubt


def test_only_a_lower_bound_stays_one(machine):
    rig, state = machine
    bound = replace(
        state.latest.life,
        revolutions=Interval(median=None, p05=50_000.0, p95=None),
        time=Interval(median=None, p05=5000.0, p95=None),
        reason="the wear rate cannot be distinguished from zero yet",
    )
    unsure = replace(state, latest=replace(state.latest, life=bound))
    f, t, _ = present(state)
    found = what_if(rig, unsure, [duty((f, t, 1.0))], until=1000.0)
    assert found.quantile(0.5) is None and found.quantile(0.05) == pytest.approx(50_000 / f)
    assert (found.probability, found.at_least) == (0.95, True)
    assert what_if(rig, unsure, [duty((f, t, 1.0))], until=1e6).probability is None
    assert found.reason == bound.reason


def test_end_that_is_reached_stays_reached(machine):
    rig, state = machine
    life = replace(
        state.latest.life, reached=True, revolutions=Interval(median=0.0, p05=0.0, p95=300.0),
        distribution=((0.05, 0.0), (0.5, 0.0), (0.95, 300.0)),
    )  # fmt: skip
    ended = replace(state, latest=replace(state.latest, life=life))
    found = what_if(rig, ended, [duty(present(state))], until=HOUR)
    assert found.reached and found.probability == pytest.approx(0.05)
    assert found.quantile(0.5) == 0.0


@pytest.mark.parametrize(
    ("points", "why"),
    [
        (((10.0, 500.0, 1.0),), "times the largest that the rig file states"),
        (((100.0, 10.0, 1.0),), "times the fastest speed seen or stated"),
    ],
)
def test_duty_far_outside_what_was_seen_is_refused(machine, points, why):
    rig, state = machine
    with pytest.raises(NotAvailable, match=why):
        what_if(rig, state, [duty(*points)])


def test_machine_without_a_life_has_none_under_another_duty(machine):
    rig, _ = machine
    with pytest.raises(NotAvailable, match="no window has given a wear depth"):
        what_if(rig, State(), [duty((10.0, 10.0, 1.0))])


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda: DutyPoint(speed=600.0 * 10, torque=10.0), "rev/min"),
        (lambda: DutyPoint(speed=10.0, torque=-1.0), "torque"),
        (lambda: DutyPoint(speed=10.0, torque=10.0, share=70.0), "percent"),
        (lambda: duty((10.0, 10.0, 0.5), (12.0, 10.0, 0.4)), "add up to 0.9"),
        (lambda: duty((10.0, 10.0, 1.0), duration=0.0), "above 0"),
    ],
)
def test_duty_that_cannot_be_is_refused(make, why):
    with pytest.raises(ParameterError, match=why):
        make()


def test_last_phase_has_no_end_and_the_others_have_one(machine):
    rig, state = machine
    with pytest.raises(ParameterError, match="last phase"):
        what_if(rig, state, [duty(present(state), duration=HOUR)])


def test_nearer_depth_is_reached_sooner_and_the_nearest_and_farthest_are_known_least(machine):
    """What all depths are off by counts most just ahead, wander of the rate and the shape of the curve far ahead."""
    rig, state = machine
    phases = [duty(present(state))]
    now = state.latest.wear.depth["combined"].median
    whole, between, next_to = (what_if(rig, state, phases, limit=to) for to in (None, 2 * now, 1.05 * now))
    assert next_to.quantile(0.5) < 0.1 * between.quantile(0.5) < 0.1 * whole.quantile(0.5)
    ratios = [found.quantile(0.95) / found.quantile(0.5) for found in (next_to, between, whole)]
    assert ratios[0] > ratios[1] < ratios[2]
    same = what_if(rig, state, phases, limit=state.latest.life.limit)
    assert same.quantile(0.5) == whole.quantile(0.5)


@pytest.mark.parametrize("limit", [1e-6, 6e-4])
def test_limit_lies_between_the_present_depth_and_the_end_of_life(machine, limit):
    rig, state = machine
    with pytest.raises(ParameterError, match="from the present depth to the end of life"):
        what_if(rig, state, [duty(present(state))], limit=limit)
