"""A verdict belongs to the windows that it was made from: which window it rests on, and when it no longer holds."""

from dataclasses import replace
from itertools import pairwise

import pytest

from service.contract.answer import assemble
from service.contract.base import iso_time
from service.contract.finding import cause
from service.contract.status import status_after, status_of, with_status_since
from service.contract.window import refused_record
from tests.unit.test_status import HEALTHY, effect, life
from twin.held_level import HeldLevel
from twin.verdict_window import Rhythm

S = 10**9
START = 1_700_000_000 * S

NOT_ASSESSED = (
    "the twin is not available: torque = -9.8 N·m does not drive the pinion forward",
    "the twin is not available: the pinion turns backwards",
    "the twin is not available: torque = 0 N·m does not drive the pinion forward",
    "the model found no steady state for this window and was not updated: no steady state at 10 Hz",
    "the twin is not available: the speed is not known: neither an encoder nor mesh lines",
    "wear is not available: the window has no absolute revolution count (no encoder)",
    "the twin is not available: y6 reads nothing (0 m/s²): cable, supply?, and no encoder measures the depth either",
    "the twin is not available: torque = 900 N·m is 40 times the rated one: unit?",
)
REFUSED = ("the shaft stood still", "too many samples are missing")
RHYTHMS = {
    "every 10 s": [10.0] * 8,
    "every hour": [3600.0] * 8,
    "every week, then every day": [604_800.0] * 2 + [86_400.0] * 6,
    "in shifts": [600.0] * 4 + [54_000.0] + [600.0] * 6,
}


def followed(rhythm: Rhythm, begin_ns: int, steps, missing=None, index=0):
    """The rhythm after windows that begin so many seconds after one another."""
    at = begin_ns
    for n, step in enumerate(steps):
        at += round(step * S)
        rhythm = rhythm.with_window(index + n, at, missing)
    return rhythm, at


def judged(rhythm: Rhythm, found=HEALTHY):
    verdict = rhythm.verdict_window()
    window = replace(HEALTHY.window, start_time_ns=verdict.latest_ns)
    return status_of(replace(found, verdict=verdict, window=window))


@pytest.mark.parametrize("steps", RHYTHMS.values(), ids=RHYTHMS)
@pytest.mark.parametrize("reason", NOT_ASSESSED)
def test_machine_whose_latest_windows_cannot_be_assessed_is_never_normal(steps, reason):
    rhythm, at = followed(Rhythm(), START, steps)
    assert judged(rhythm).level == "normal"
    usual = steps[-1]
    once, later = followed(rhythm, at, [usual], reason, index=len(steps))
    said = " ".join(judged(once).reasons)
    assert judged(once).level == "normal" and "The latest window was not assessed: " in said, said
    old, _ = followed(once, later, [usual] * 4, reason, index=len(steps) + 1)
    status = judged(old)
    assert status.level == "no_verdict" and f"window {len(steps) - 1}, " in status.reasons[0], status
    assert status.reasons[0].startswith("The latest 5 windows were not assessed: ")
    assert cause(reason) in status.reasons[0]
    assert status.verdict.window == len(steps) - 1 and status.verdict.age_s == pytest.approx(5 * usual)


@pytest.mark.parametrize("steps", RHYTHMS.values(), ids=RHYTHMS)
@pytest.mark.parametrize("reason", REFUSED)
def test_machine_whose_latest_windows_are_refused_is_never_normal(steps, reason):
    rhythm, at = followed(Rhythm(), START, steps)
    report = {"status": judged(rhythm).as_json()}
    records = [{"index": len(steps) - 1, "quality": "good", "start_time": iso_time(at)}]
    for n in range(5):
        at += round(steps[-1] * S)
        records.append(
            {**refused_record(reason), "index": len(steps) + n, "quality": "refused", "start_time": iso_time(at)}
        )
        assert assemble("m", records, report, {})["status"]["level"] == "no_verdict"
    status = assemble("m", records, report, {})["status"]
    assert status["reasons"][0].startswith(f"The latest 5 windows were not assessed: {reason}")
    assert status["verdict"]["window"] == len(steps) - 1 and status["verdict"]["not_assessed"] == 5


@pytest.mark.parametrize("steps", RHYTHMS.values(), ids=RHYTHMS)
@pytest.mark.parametrize("times", range(1, 11))
def test_machine_whose_windows_are_assessed_stays_normal(steps, times):
    rhythm, at = Rhythm(), START
    for n in range(times):
        rhythm, at = followed(rhythm, at, steps, index=n * len(steps))
        status = judged(rhythm)
        assert status.level == "normal" and len(status.reasons) == 1 and status.verdict.not_assessed == 0


@pytest.mark.parametrize(("up", "down"), [(1, 1), (2, 3), (4, 4), (10, 10), (30, 12)])
def test_hoist_keeps_its_verdict_by_its_own_rhythm(up, down):
    rhythm, at, levels = Rhythm(), START, []
    for _ in range(6):
        rhythm, at = followed(rhythm, at, [10.0] * up)
        for _ in range(down):
            rhythm, at = followed(rhythm, at, [10.0], NOT_ASSESSED[0])
            levels.append(judged(rhythm).level)
    assert set(levels[3 * down :]) == {"normal"}
    rhythm, at = followed(rhythm, at, [10.0] * (9 * (down + 1) + 40), NOT_ASSESSED[0])
    assert judged(rhythm).level == "no_verdict"


def test_one_long_outage_does_not_make_the_next_one_usual():
    rhythm, at = followed(Rhythm(), START, [10.0] * 20)
    rhythm, at = followed(rhythm, at, [10.0] * 500, NOT_ASSESSED[0])
    rhythm, at = followed(rhythm, at, [10.0] * 3)
    rhythm, at = followed(rhythm, at, [10.0] * 20, NOT_ASSESSED[0])
    assert judged(rhythm).level == "no_verdict"


def test_usual_time_is_not_that_of_windows_which_were_not_assessed():
    rhythm, at = followed(Rhythm(), START, [60.0] * 8)
    levels = []
    for n in range(6):
        rhythm, at = followed(rhythm, at, [7200.0], NOT_ASSESSED[0], index=8 + n)
        levels.append(judged(rhythm).level)
    assert levels == ["no_verdict"] * 6


def test_verdict_that_rests_on_one_window_alone_does_not_hold_for_the_next():
    rhythm, at = followed(Rhythm(), START, [10.0])
    rhythm, _ = followed(rhythm, at, [10.0], NOT_ASSESSED[0])
    assert judged(rhythm).level == "no_verdict"


@pytest.mark.parametrize("name", ["tooth_crack", "backlash_rattle"])
def test_standing_alarm_stays_and_its_age_is_said_beside_it(name):
    rhythm, at = followed(Rhythm(), START, [10.0] * 8)
    rhythm, _ = followed(rhythm, at, [10.0] * 5, NOT_ASSESSED[0], index=8)
    found = replace(HEALTHY, effects=(effect(name), effect("misalignment")))
    status = judged(rhythm, found)
    assert status.level == "alarm" and "found" in status.reasons[0] and "not assessed" in status.reasons[1]
    assert status.action == status_of(found).action


def test_window_number_of_the_verdict_is_that_of_the_record():
    """The twin does not count windows that were refused; records do."""
    rhythm, at = followed(Rhythm(), START, [10.0] * 3)
    report = {"status": judged(rhythm).as_json()}
    kept = with_status_since(None, report, at, 1.0, index=7)
    assert kept["status"]["verdict"]["window"] == 7
    rhythm, later = followed(rhythm, at, [10.0], NOT_ASSESSED[0], index=3)
    after = with_status_since(kept, {"status": judged(rhythm).as_json()}, later, 1.0, index=9)
    assert after["status"]["verdict"]["window"] == 7 and after["status"]["verdict"]["not_assessed"] == 1
    assert with_status_since(after, report, later, None)["status"]["verdict"]["window"] == 7


# -- levels rise at once, and fall after some windows --------------------------------------------------------

ALARM = replace(HEALTHY, effects=(effect("tooth_crack"),))
WATCH = replace(HEALTHY, effects=(effect("misalignment"),))


def levels_of(*found):
    """The level after each of these assessments, in windows that follow one another."""
    held, out, rhythm = HeldLevel(), [], Rhythm()
    for n, one in enumerate(found):
        missing = None if one is not None else NOT_ASSESSED[0]
        rhythm = rhythm.with_window(n, START + n * 10 * S, missing)
        last = one or next(f for f in reversed(found[:n]) if f is not None)
        window = replace(HEALTHY.window, index=n, start_time_ns=START + n * 10 * S)
        status, held = status_after(replace(last, window=window, verdict=rhythm.verdict_window()), held)
        out.append(status.level)
    return out


@pytest.mark.parametrize(
    ("found", "levels"),
    [
        ([HEALTHY, ALARM, HEALTHY, HEALTHY, HEALTHY], ["normal", "alarm", "alarm", "alarm", "normal"]),
        ([WATCH, ALARM, WATCH, WATCH, WATCH], ["watch", "alarm", "alarm", "alarm", "watch"]),
        ([ALARM, HEALTHY, HEALTHY, ALARM, HEALTHY, HEALTHY], ["alarm"] * 6),
        ([HEALTHY, WATCH, ALARM], ["normal", "watch", "alarm"]),
    ],
)
def test_levels_rise_at_once_and_fall_after_three_windows_in_a_row(found, levels):
    assert levels_of(*found) == levels


def test_windows_that_were_not_assessed_do_not_let_a_level_fall():
    assert levels_of(HEALTHY, ALARM, HEALTHY, None, None, None, None, HEALTHY, HEALTHY)[-2:] == ["alarm", "normal"]


def test_level_that_is_held_says_until_when_its_reason_was_found():
    held = status_after(replace(ALARM, window=HEALTHY.window), HeldLevel())[1]
    status, held = status_after(HEALTHY, held)
    assert status.reasons[0].startswith("A tooth crack was found") or "crack" in status.reasons[0].lower()
    assert "lower since in 1 of the 3 windows" in status.reasons[0] and status.action == status_of(ALARM).action
    assert status.findings[0].subject == "effect/tooth_crack" and held.lower == 1


def test_what_people_decide_ends_a_level_at_once():
    held = status_after(ALARM, HeldLevel())[1]
    assert status_after(replace(HEALTHY, window=None), held)[0].level == "normal"


def test_no_verdict_ends_with_the_first_window_that_can_be_judged():
    unsure = replace(HEALTHY, life=life(), unexplained=replace(HEALTHY.unexplained, verdict="insufficient_data"))
    assert levels_of(unsure, HEALTHY) == ["no_verdict", "normal"]
    assert all(a != b for a, b in pairwise(levels_of(unsure, HEALTHY)))
