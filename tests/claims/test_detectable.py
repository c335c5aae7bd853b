"""Where nothing was found, the answer says what could have been, and how often a year of searches is wrong."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import inf

import numpy as np
import pytest

from service.contract.parts import Detectable
from tests.unit.test_step import recorded
from twin import assessment
from twin.assessment import Unavailable
from twin.capabilities import detectable
from twin.capabilities.context import Context, Draft
from twin.detectability.visible import ALARM_CLASS, _heard, _least_blows, _ringing, _Window, smallest_sizes
from twin.detectability.yearly import YEAR, false_alarms, searches_within
from twin.features.extract import WindowSignals, extract
from twin.features.non_gear import non_gear_features
from twin.model import Condition
from twin.options import Options
from twin.state import State
from twin.tracing.detectors.non_gear import defect_of
from twin.tracing.state import Tracing, TwinStage
from twin.updating.history import WindowInput, replay_history
from twin.updating.model_cache import nominal_model_of
from twin.updating.running_time import Mark

CONDITION = Condition(speed_hz=10.0, torque=10.0)
PHASE = 0.3


@cache
def features():
    """Of the measurement windows of the bundled short campaign."""
    rig, windows = recorded()
    return rig, tuple(extract(rig, w) for w in windows[2:])


def sizes(windows=None, phase=PHASE):
    rig, own = features()
    found = smallest_sizes(rig, nominal_model_of(rig), CONDITION, own if windows is None else windows, phase)
    return {size.name: size for size in found}


def test_each_effect_of_the_alarm_class_has_a_smallest_size_in_windows_of_all_channels():
    found = sizes()
    assert set(found) == set(ALARM_CLASS) == {"tooth_crack", "bearing_defect", "backlash_rattle"}
    assert 0.1 < found["tooth_crack"].value < 0.6
    noise = features()[1][-1].noise_rms
    assert 0.1 * noise < found["bearing_defect"].value < 8 * noise
    assert found["backlash_rattle"].value == pytest.approx(0.6 * CONDITION.torque)


def scattered(windows, size):
    """The windows whose transmission error changes from one to the next, as pitch errors that wear in make it."""
    rng, out = np.random.default_rng(4), []
    for w in windows:
        te = w.transmission_error
        more = size * (rng.standard_normal(len(te.keys)) + 1j * rng.standard_normal(len(te.keys)))
        lines = tuple(a + m if p or g else a for (k, p, g), a, m in zip(te.keys, te.amplitudes, more, strict=True))
        out.append(replace(w, transmission_error=replace(te, amplitudes=lines)))
    return out


@pytest.mark.parametrize("size", [0.05e-6, 0.1e-6])
def test_a_crack_must_be_larger_where_the_lines_of_the_teeth_change_from_window_to_window(size):
    plain, found = sizes()["tooth_crack"], sizes(scattered(features()[1], size))["tooth_crack"]
    assert found.value is None or found.value > 1.2 * plain.value


def test_a_crack_that_no_window_could_show_has_no_size_and_a_reason():
    assert "not even a loss" in sizes(scattered(features()[1], 3e-6))["tooth_crack"].basis
    assert "mesh phase" in sizes(phase=None)["tooth_crack"].basis
    deaf = [replace(w, transmission_error=None) for w in features()[1]]
    assert "encoders on both shafts" in sizes(deaf)["tooth_crack"].basis


@pytest.mark.parametrize("factor", [3.0, 10.0])
def test_the_smallest_blows_rise_with_the_noise_between_the_orders(factor):
    loud = [replace(w, noise_rms=factor * w.noise_rms) for w in features()[1]]
    assert sizes(loud)["bearing_defect"].value == pytest.approx(factor * sizes()["bearing_defect"].value)


@pytest.mark.parametrize("order", [3.05, 5.4, 7.1])
def test_blows_of_the_smallest_size_are_found_by_the_search_and_half_of_it_are_not(order):
    window = _Window(teeth=(19, 52), turns=50.0, top=200.0, speed_hz=10.0)
    least = _least_blows(window, order, 4, 20.0)
    assert least < inf
    by_size = {
        size: defect_of([(float(i), f) for i, f in enumerate(_heard(window, order, size) * 2)])
        for size in (least, least / 2)
    }
    assert by_size[least].effect.order == pytest.approx(order, rel=0.03) and by_size[least / 2] is None


def test_simulated_blows_have_the_rms_that_is_stated_and_fall_at_their_order():
    struck = _ringing(20_000, 400.0, 5.4, 140.0, 0.01, np.random.default_rng(1))
    assert np.sqrt(np.mean(struck**2)) == pytest.approx(1.0)
    power = np.abs(np.fft.rfft(struck**2))
    power[:50] = 0  # less than one order
    assert np.argmax(power[:1000]) / 50 == pytest.approx(5.4, rel=0.03)


def test_rattle_and_blows_need_a_channel_that_shows_them():
    without = [replace(w, torque=None, noise_rms=None) for w in features()[1]]
    found = sizes(without)
    assert found["backlash_rattle"].value is None and "torque meter" in found["backlash_rattle"].basis
    assert found["bearing_defect"].value is None and "accelerometer" in found["bearing_defect"].basis


# -- false alarms -----------------------------------------------------------------------------------------------


def marks(windows, apart):
    return tuple(Mark(time_ns=int(i * apart * 1e9), revolutions=i, speed=10.0, run=i * apart) for i in range(windows))


@pytest.mark.parametrize(("apart", "rate"), [(3600.0, 0.01), (86_400.0, 0.01), (86_400.0, 0.001)])
def test_false_alarms_are_counted_over_the_searches_of_a_year(apart, rate):
    found = false_alarms(rate, 10, 10, marks(10, apart))
    assert found.windows == pytest.approx(YEAR / apart)
    assert found.expected == pytest.approx(rate * found.searches) and found.searches == searches_within(
        10, found.windows
    )


def test_searches_become_rarer_as_the_history_grows():
    assert searches_within(4, 8) == 8  # each window of a short campaign
    assert searches_within(100, 100) == 3  # each time there are a quarter more
    assert searches_within(100, 10) == 0
    assert searches_within(10, 100_000) < 60


def test_one_window_says_nothing_of_a_year():
    assert isinstance(false_alarms(0.01, 1, 1, marks(1, 60.0)), Unavailable)


# -- the answer -------------------------------------------------------------------------------------------------


@cache
def explained():
    """Context and draft of the bundled short campaign, searched without a finding."""
    rig, windows = recorded()
    inputs = []
    for i, window in enumerate(windows):
        signals = WindowSignals(rig, window)
        own = extract(rig, window, signals)
        inputs.append(WindowInput(index=i, features=own, non_gear=non_gear_features(rig, window, signals=signals)))
    memory, _ = replay_history(rig, (), inputs, Options().updating(rig))
    tracing = Tracing(history=tuple(inputs), measured=6, phase=memory.phase, stages=(TwinStage(memory=memory),))
    state = State(tracing=tracing, running=marks(8, 86_400.0), windows_seen=7)
    context = Context(
        rig=rig, state=state, window=windows[-1], options=Options(), signals=None, input=inputs[-1], pair=None
    )
    missing = Unavailable(reason="not asked")
    found = assessment.Assessment(
        window=None, wear=missing, life=missing, residual=missing, effects=(), calibration=missing,
        unexplained=assessment.Unexplained(verdict="explained"),
    )  # fmt: skip
    return context, Draft(state=state, assessment=found, modelled=True)


@pytest.mark.slow
def test_an_answer_that_nothing_was_found_carries_what_could_have_been():
    context, draft = explained()
    assert detectable.applies(context, draft)
    found = Detectable.of(detectable.assess(context, draft).assessment.detectable).as_json()
    assert [e["name"] for e in found["effects"]] == list(ALARM_CLASS) and found["windows"] == 6
    assert found["false_alarms"]["rate"] == 0.01 and found["false_alarms"]["per_machine_year"] > 0
    said = "\n".join(found["said"])
    assert "tooth crack: stiffness loss from 0." in said and "a year, by" in said


def test_nothing_is_said_of_it_where_an_alarm_was_found_or_no_search_was_made():
    context, draft = explained()
    searching = replace(context, options=Options(trace=False))
    assert not detectable.applies(searching, draft)
    assert not detectable.applies(context, replace(draft, modelled=False))
    few = replace(draft, state=replace(draft.state, tracing=replace(draft.state.tracing, measured=1)))
    assert not detectable.applies(context, few)


@pytest.mark.parametrize(("size", "verdict"), [(0.0, "explained"), (0.05e-6, "explained"), (3e-6, "insufficient_data")])
def test_no_machine_is_explained_whose_windows_would_hide_a_crack_of_any_size(size, verdict):
    context, draft = explained()
    tracing = draft.state.tracing
    changed = scattered([w.features for w in tracing.history], size)
    history = tuple(replace(w, features=f) for w, f in zip(tracing.history, changed, strict=True))
    state = replace(draft.state, tracing=replace(tracing, history=history))
    found = detectable.assess(context, replace(draft, state=state)).assessment.unexplained
    assert found.verdict == verdict
    assert ("cracked tooth of any size" in found.reason) == (verdict != "explained")
