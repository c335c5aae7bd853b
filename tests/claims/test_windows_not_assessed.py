"""Real windows that the model cannot use, in ways of their own: the verdict of the windows before does not stand."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from service.contract.estimate import step
from tests.unit.test_step import recorded
from twin.attention import StatusLimits
from twin.options import Options
from twin.state import State
from twin.windows import Window

ALONE = Options(trace=False, status_limits=StatusLimits(horizon=0.0))  # the campaign's whole life is some hours
MINUTE = 60 * 10**9


@lru_cache(maxsize=1)
def assessed() -> State:
    """The state after six windows that were assessed."""
    rig, windows = recorded()
    state = State()
    for window in windows[:6]:
        state, _ = step(rig, state, window, ALONE)
    return state


def torque_times(factor):
    def changed(window: Window) -> Window:
        torques = {name: replace(one, values=factor * one.values) for name, one in window.torques.items()}
        return replace(window, torques=torques)

    return changed


def braking(window):
    """A torque about zero that turns negative."""
    own = window.torques["pinion"]
    return replace(window, torques={"pinion": replace(own, values=own.values - 1.2 * np.mean(own.values))})


def without_encoders(window):
    return replace(window, encoders={})


WAYS = {
    "reversed": torque_times(-1.0),
    "braking": braking,
    "idle": torque_times(0.0),
    "absurd torque": torque_times(1000.0),
    "no encoders": without_encoders,
}


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_windows_that_the_model_cannot_use_leave_no_verdict(way):
    rig, windows = recorded()
    state, reports = assessed(), []
    assert state.rhythm.index == 5 and state.rhythm.since == 0
    for n in range(1, 5):
        window = replace(windows[5], start_time_ns=windows[5].start_time_ns + n * MINUTE)
        state, estimate = step(rig, state, way(window), ALONE)
        reports.append(estimate.report["status"])
    status = reports[-1]
    assert status["verdict"] | {"reason": ""} == {
        "window": 5, "start_time": reports[0]["verdict"]["start_time"], "age_s": 240.0,
        "usual_s": pytest.approx(42.6, abs=1.0), "not_assessed": 4, "reason": "",
    }  # fmt: skip
    assert status["level"] == "no_verdict"
    assert status["reasons"][0].startswith("The latest 4 windows were not assessed: "), status["reasons"]
    assert "the verdict is of window 5, 2026-02-02 08:02 UTC (4 min earlier)" in status["reasons"][0]


def test_window_that_is_assessed_again_renews_the_verdict():
    rig, windows = recorded()
    state = assessed()
    for n in range(1, 5):
        window = replace(windows[5], start_time_ns=windows[5].start_time_ns + n * 10**9)
        state, _ = step(rig, state, WAYS["reversed"](window), ALONE)
    state, estimate = step(rig, state, windows[6], ALONE)
    verdict = estimate.report["status"]["verdict"]
    assert (verdict["window"], verdict["not_assessed"], verdict["age_s"]) == (10, 0, 0.0)
    assert not any("not assessed" in reason for reason in estimate.report["status"]["reasons"])
