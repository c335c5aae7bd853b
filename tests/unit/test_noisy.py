"""Quantities that scatter about their limit: what they say changes once at most, and not at every window."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.unit.test_preliminary import GOOD, HEALTHY, by_level, doubts, latest
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.established import LIMITS, History
from twin.preliminary import confidence_of, history_after
from twin.serial import from_plain, to_plain
from twin.tracing.unexplained import VERDICT_LIMITS
from twin.updating.remaining_life import LIFE

SCATTER = 0.08  # relative, one standard deviation: less than the margin of every release


def held_out(channel):
    return lambda outcome, value: (outcome, replace(GOOD, **{channel: value}))


def misfit(outcome, value):
    return replace(outcome, estimate=replace(outcome.estimate, misfit=value)), None


def rate(outcome, value):
    track = outcome.memory.track
    memory = replace(outcome.memory, track=replace(track, var_rate=(track.rate / value) ** 2))
    return replace(outcome, memory=memory), GOOD


def rise(outcome, value):
    worn = by_level(outcome)
    return replace(worn, rms_measured=outcome.memory.unworn[-1].rms * (1 + value)), GOOD


def other_gears(outcome, value):
    lines = replace(outcome.estimate, misfit=value)
    return replace(outcome, memory=replace(outcome.memory, fit=None), estimate=lines), None


def unreachable(outcome, value):
    level = by_level(outcome)
    found = replace(level.rms_result, rms_after=(1 + value) * level.rms_measured, updated=True, converged=False)
    return replace(level, rms_result=found), GOOD


QUANTITIES = {
    "held-out transmission error": (held_out("transmission_error"), HEALTHY.transmission_error, "depth"),
    "held-out acceleration": (held_out("waveform"), HEALTHY.waveform, "depth"),
    "mesh lines": (misfit, VERDICT_LIMITS.doubtful_misfit, "depth"),
    "wear rate": (rate, LIFE.measurable, "life"),
    "level rise": (rise, LIMITS.level_rise, "missing"),
    "other gears": (other_gears, LIMITS.other_gears, "missing"),
    "unreachable level": (unreachable, LIMITS.unreachable, "missing"),
}


def said(put, values, of):
    """What is said of a figure window by window, each judged after those before it."""
    rig, outcome = latest()
    history, out = History(), []
    for index, value in enumerate(values):
        now, errors = put(outcome, float(value))
        found = confidence_of(rig, now, errors, history)
        history = history_after(rig, history, now, found, index)
        history = from_plain(History, to_plain(history))  # as it is stored
        out.append(getattr(found, of) is not None)
    return out


def changes(flags):
    return sum(a != b for a, b in pairwise(flags))


@pytest.mark.slow
@pytest.mark.parametrize("name", QUANTITIES)
@pytest.mark.parametrize("seed", range(5))
def test_quantity_that_scatters_about_its_limit_changes_what_is_said_once_at_most(name, seed):
    put, limit, of = QUANTITIES[name]
    values = limit * (1 + SCATTER * np.random.default_rng(seed).uniform(-1.7, 1.7, 40))
    alone = [said(put, [value], of)[0] for value in values]
    assert changes(alone) > 5  # without what was before
    assert changes(said(put, values, of)) <= 1


@pytest.mark.parametrize("name", QUANTITIES)
def test_quantity_well_within_its_limit_ends_the_doubt_and_one_well_beyond_it_begins_it(name):
    put, limit, of = QUANTITIES[name]
    below = name in ("wear rate", "level rise")
    good, bad = (2 * limit, 0.5 * limit) if below else (0.5 * limit, 2 * limit)
    flags = said(put, [bad] * 4 + [good] * 4 + [bad] * 4, of)
    assert flags[0] and not flags[7] and flags[11]


def test_errors_of_the_published_campaign_change_what_is_said_twice_instead_of_four_times():
    """A held-out window that joins, deeper than any learned from, raises the error until the next trace."""
    errors = [0.31, 0.11, 0.06, 0.44, 0.12, 0.10, 0.66, 0.41, 0.34, 0.34]
    put = held_out("waveform")
    assert changes(said(put, [error], "depth")[0] for error in errors) == 4
    flags = said(put, errors, "depth")
    assert flags == [True, True, False, False, False, False, False, True, True, True]


def test_reason_says_the_limit_at_which_a_doubt_ends():
    rig, outcome = latest()
    history = History()
    for index, value in enumerate((0.4, 0.4, 0.27)):
        errors = replace(GOOD, waveform=value)
        found = confidence_of(rig, outcome, errors, history)
        history = history_after(rig, history, outcome, found, index)
    assert "is 27 %" in found.depth.reasons[0]
    assert "30 % at most, and 75 % of it once it was exceeded" in found.depth.reasons[0]
    assert not doubts(rig, outcome, errors)


def test_window_that_is_judged_again_counts_once():
    rig, outcome = latest()
    history = History()
    for index, value in enumerate((0.1, 0.1, 0.4)):
        errors = replace(GOOD, waveform=value)
        history = history_after(rig, history, outcome, confidence_of(rig, outcome, errors, history), index)
    for _ in range(3):
        assert confidence_of(rig, outcome, errors, history, again=True).depth is None
    assert confidence_of(rig, outcome, errors, history).depth is not None  # one window more


def test_doubt_ends_with_the_model_that_it_was_of():
    rig, outcome = latest()
    high, within = replace(GOOD, waveform=0.5), replace(GOOD, waveform=0.27)
    history = history_after(rig, History(), outcome, confidence_of(rig, outcome, high), 0)
    assert confidence_of(rig, outcome, within, history).depth is not None
    found = Addition(effect=EFFECTS["tooth_friction"](coefficient=0.1), onset_revolutions=0.0)
    _, other = latest(effects=(found,))
    assert confidence_of(rig, other, within, history).depth is None
