"""The parts of tracing, each on figures made up for it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.mesh_pairs import UNSW_RIG
from twin.assessment import HeldOutErrors, SpectralLine
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.errors import ParameterError
from twin.features.non_gear import NonGearFeatures
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.scales import Scales
from twin.serial import from_plain, to_plain
from twin.tracing.attribution import AttributedEffect
from twin.tracing.attribution_loop import attribute_non_gear_content
from twin.tracing.change_detection import floors, is_new, widened
from twin.tracing.decisions import Decision
from twin.tracing.detectors.non_gear import find_non_gear_content
from twin.tracing.gain_change import change_of_lines, gain_step
from twin.tracing.held_out_error import ChannelComparison, HeldOutComparison, errors_of, residual_by_band_and_order
from twin.tracing.joining import same_effect
from twin.tracing.log import decision_event, event_of
from twin.tracing.state import EffectErrors, Refusal, TraceSummary, Tracing, TwinStage, relevant
from twin.tracing.summary import attribution_of, effects_of
from twin.tracing.trace import held_out, trace
from twin.tracing.transfer_path import Quotient
from twin.updating.history import WindowInput
from twin.updating.memory import Memory


def found(name="misalignment", onset=0.0, value=30e-6, std=2e-6, **values):
    effect = EFFECTS[name](**(values or {"lead_gap": value}))
    return AttributedEffect(
        addition=Addition(effect=effect, onset_revolutions=onset),
        parameters={"lead_gap": (value, "m", std)},
        log_evidence=100.0,
        runner_up="mesh_stiffness_loss",
        over_runner_up=40.0,
        numbers=(value / 30e-6,),
    )


def quotients(step=0.0, onset=3000.0, noise=0.01, seed=1):
    """Four lines in eight windows, each with its own offset, and a common step of the logarithm."""
    rng = np.random.default_rng(seed)
    offset = rng.normal(0, 0.3, 4)
    return [
        Quotient(
            frequency=190.0 * (k + 1),
            log=complex(offset[k] + step * (n > onset) + noise * rng.normal(), 0.0),
            std=noise,
            order=k + 1,
            revolutions=n,
        )
        for n in np.arange(1, 9) * 700.0
        for k in range(4)
    ]


def beside(tones=(), lines=(), kurtosis=1.0, rates=(), swelling=()):
    return NonGearFeatures(
        duration=5.0, speed_hz=10.0, tones=tones, lines=lines, kurtosis=kurtosis, rates=rates, swelling=swelling
    )


def test_step_of_the_gain_is_found_with_its_size_and_time():
    step = gain_step(quotients(np.log(0.8)), 0.2)
    assert step is not None and step.log_evidence > 100
    assert step.gain == pytest.approx(0.8, abs=0.02)
    assert step.onset == pytest.approx(3150.0)  # between 2800 and 3500


@pytest.mark.parametrize("seed", range(8))
def test_steady_gain_has_no_step_whatever_the_structure_makes_of_each_line(seed):
    step = gain_step(quotients(0.0, seed=seed), 0.2)
    assert step is not None and step.log_evidence < 8


def test_lines_that_change_alike_are_a_sensor_and_lines_that_change_apart_a_structure():
    alike = change_of_lines(quotients(np.log(0.8)), 3150.0, 0.2)
    assert alike.shared > alike.apart > 10
    own = dict(zip(range(1, 5), (0.3, 0.0, -0.1, 0.02), strict=True))
    apart = change_of_lines(
        [replace(q, log=q.log + own[q.order] * (q.revolutions > 3000)) for q in quotients()], 3150.0, 0.2
    )
    assert apart.apart > apart.shared + 10
    assert change_of_lines([q for q in quotients() if q.revolutions > 3150.0], 3150.0, 0.2).shared == 0.0


@pytest.mark.parametrize("seed", range(8))
def test_lines_that_do_not_change_speak_for_neither(seed):
    change = change_of_lines(quotients(0.0, seed=seed), 3150.0, 0.2)
    assert max(change.shared, change.apart) < 3  # Markov: at most 1 in 20 by chance


def test_line_seen_in_one_window_only_tells_no_step():
    assert gain_step([q for q in quotients(0.5) if q.revolutions == 700.0], 0.2) is None


def test_tone_steady_in_hertz_is_a_stranger_and_no_bearing():
    tone = (50.0, 0.01, 0.4, 0.01, 60.0)
    heard = find_non_gear_content(
        [(1000.0 * n, beside(tones=(tone,), lines=((5.0, 0.4),))) for n in range(1, 6)], False
    )
    assert heard.unknown and heard.defect is None
    assert [round(t.frequency) for t in heard.tones] == [50]
    assert heard.orders == ()  # the same line, by its order at this speed


def test_impacts_with_multiples_of_one_order_are_a_bearing_defect_with_its_onset():
    rates = tuple((3.6 * k * (1 + 0.001 * k), 0.2) for k in (1, 2, 3, 4))
    windows = [(1000.0 * n, beside(kurtosis=20.0 if n > 2 else 1.0, rates=rates if n > 2 else ())) for n in range(1, 7)]
    heard = find_non_gear_content(windows, False)
    assert heard.defect is not None
    assert heard.defect.effect.order == pytest.approx(3.6, rel=0.01)
    assert heard.defect.onset == pytest.approx(2500.0)


def test_evidence_of_a_defect_grows_with_its_multiples_and_windows():
    def evidence(multiples, count):
        rates = tuple((3.6 * k, 0.2) for k in range(1, multiples + 1))
        heard = find_non_gear_content([(1000.0 * n, beside(rates=rates)) for n in range(count)], False)
        return 0.0 if heard.defect is None else heard.defect.log_evidence

    assert 0 < evidence(4, 5) < evidence(6, 5) < evidence(6, 8)
    assert evidence(6, 1) == 0.0 and evidence(2, 8) == 0.0


@pytest.mark.parametrize("seed", range(20))
def test_rates_that_fall_anywhere_are_no_defect(seed):
    rng = np.random.default_rng(seed)
    windows = [(1000.0 * n, beside(rates=tuple((r, 0.3) for r in rng.uniform(0.1, 40.0, 10)))) for n in range(8)]
    assert find_non_gear_content(windows, False).defect is None


def test_noise_that_comes_and_goes_with_a_shaft_is_unknown_with_the_shaft_and_its_first_window():
    windows = [(1000.0 * n, beside(swelling=(("gear", 1.4),) if n > 2 else ())) for n in range(1, 6)]
    heard = find_non_gear_content(windows, False)
    assert heard.modulated_by == "gear" and heard.unknown and heard.first == 3000.0
    assert "every turn of the gear" in heard.sentence()
    assert find_non_gear_content(windows[:3], False).modulated_by is None  # one window is none
    assert find_non_gear_content(windows, False, struck=True).modulated_by is None
    assert not find_non_gear_content(
        [(1000.0 * n, beside(swelling=(("pinion", 0.6),))) for n in range(5)], False
    ).unknown


def test_impacts_without_an_order_are_unknown_unless_a_tooth_strikes():
    windows = [(1000.0 * n, beside(kurtosis=40.0)) for n in range(1, 6)]
    assert find_non_gear_content(windows, False).impacts
    assert not find_non_gear_content(windows, False, struck=True).unknown


def test_machine_without_a_twin_still_has_its_bearing_heard():
    rig = Rig.from_mapping({"gears": {"pinion": {"teeth": 19}, "gear": {"teeth": 52}}})
    rates = tuple((3.6 * k, 0.2) for k in (1, 2, 3, 4))
    tracing, told = Tracing(), []
    for n in range(5):
        features = WindowFeatures(
            start_time_ns=n, duration=5.0, quality="good", speed_hz=10.0, revolutions=1000.0 * n, rms=3.0
        )
        window = WindowInput(index=n, features=features, non_gear=beside(kurtosis=20.0, rates=rates))
        tracing, events = attribute_non_gear_content(rig, tracing, window)
        told += events
    assert [f.name for f in tracing.found] == ["bearing_defect"]
    assert [(event.name, event.action) for event in told] == [("bearing_defect", "found")]
    (effect,) = effects_of(rig, tracing)
    assert effect.depth_after is None
    assert effect.parameters["order"].value == pytest.approx(3.6, rel=0.01)
    assert "no model of this machine" in attribution_of(tracing).reason
    assert from_plain(Tracing, json.loads(json.dumps(to_plain(tracing)))) == tracing


def test_machine_whose_angle_is_too_coarse_for_the_mesh_has_its_bearing_heard_and_no_stray_lines():
    rates = tuple((3.6 * k, 0.2) for k in (1, 2, 3, 4, 5, 6))
    heard = beside(kurtosis=20.0, rates=rates, lines=((5.3, 0.4),))
    windows = [
        WindowInput(
            index=n,
            features=WindowFeatures(
                start_time_ns=n, duration=5.0, quality="good", speed_hz=10.0, revolutions=1000.0 * (n + 1), rms=3.0
            ),
            non_gear=heard,
        )
        for n in range(9)
    ]
    rig = Rig.from_mapping(UNSW_RIG)
    traced = trace(rig, windows, {}, None)
    assert [f.name for f in traced.found] == ["bearing_defect"]
    assert traced.non_gear.orders == () and not traced.non_gear.unknown
    assert traced.held_out == (2, 5, 8) and traced.fitted == (0, 1, 3, 4, 6, 7)
    assert trace(rig, windows, {}, None, rejected=("bearing_defect",)).found == ()
    assert trace(rig, windows[:3], {}, None).found == ()  # three windows are not sure enough without the mesh phase
    tooth = [replace(w, non_gear=beside(rates=tuple((1.0 * k, 0.2) for k in (3, 4, 5, 6)))) for w in windows]
    assert trace(rig, tooth, {}, None).found == ()


def test_quiet_machine_has_no_stranger():
    assert not find_non_gear_content([(1000.0 * n, beside()) for n in range(1, 6)], False).unknown


def test_windows_once_held_out_stay_held_out():
    whole = list(range(3, 30))
    assert held_out(whole) == set(range(5, 30, 3))  # never the first, whose flanks are unworn or nearly
    for end in range(4, len(whole)):
        assert held_out(whole[:end]) == held_out(whole) & set(whole[:end])
    assert held_out(whole[:3]) == set()


def compared(predicted, measured=None):
    y = np.array([0.5, 3.0 + 1j, 2.0j]) if measured is None else measured

    def lines(m, y):
        orders, std = np.array([18.0, 19.0, 38.0])[: y.size], np.full(y.size, 0.01)
        return ChannelComparison(orders=orders, measured=y, predicted=m * y, std=std, variance=2 * std**2)

    channels = {"acceleration": lines(predicted, y), "transmission_error": lines(0.5, np.array([1.0, 1.0]))}
    return HeldOutComparison(index=5, speed_hz=10.0, channels=channels, rms_measured=2.0, rms_predicted=2.2)


def test_waveform_error_is_nothing_for_a_perfect_twin_and_all_for_a_silent_one():
    assert errors_of([compared(1.0)]).waveform == 0.0
    silent = errors_of([compared(0.0), compared(0.0)])
    assert silent.waveform == pytest.approx(1.0)
    assert silent.rms == pytest.approx(0.1)
    assert silent.transmission_error == pytest.approx(0.5)
    assert errors_of([]).waveform is None


def test_residual_by_band_counts_the_sidebands_within_two_shaft_orders():
    shown = residual_by_band_and_order(compared(0.0), compared(1.0), 19)
    first = shown.bands[0]
    assert first.measured == pytest.approx(np.sqrt(0.5 * (0.25 + 10.0)))
    assert first.residual_before == pytest.approx(first.measured) and first.residual_after == 0.0
    assert [line.order for line in shown.lines] == [19.0, 38.0, 18.0]


def test_refit_that_says_the_same_changes_nothing():
    old = found()
    assert same_effect(old, found(value=31e-6))
    assert not same_effect(old, found(value=40e-6))
    assert not same_effect(old, found(onset=3000.0))


def test_only_effects_on_mesh_or_path_change_a_depth():
    eccentric = replace(found(), addition=Addition(effect=EFFECTS["gear_eccentricity"](eccentricity=1e-5)))
    bearing = replace(found(), addition=Addition(effect=EFFECTS["bearing_defect"](blow=1.0, order=3.5)))
    assert relevant([eccentric, found(), bearing]) == (found().addition,)


def test_memory_of_the_tracing_is_plain_data_and_comes_back_whole():
    state = Tracing(
        measured=7,
        next_search=9,
        next_trace=8,
        signs={"misfit": 0.3},
        found=(found(), found(onset=4000.0)),
        stages=(TwinStage(memory=Memory(), depth=1e-5, depths={3: 1e-6, 4: 2e-6}, life=None),),
        decisions={"misalignment": "pinned", "tooth_friction": "rejected"},
        refuted={"mesh_damping": Refusal(reason="chance", windows=(2,), onset=1.0, measured=5)},
        errors=(EffectErrors(before=HeldOutErrors(rms=0.2, windows=(2,)), after=HeldOutErrors(note="none")),),
        error=HeldOutErrors(waveform=0.1, windows=(2, 5)),
        unattributed=(SpectralLine(order=5.0, frequency=50.0, share=None),),
        unknown="tones",
        latest=TraceSummary(candidates=(("misalignment", 12.0),), held_out=(2, 5)),
        log=(event_of(Tracing(), "found", found()), decision_event(Tracing(), "rejected", "tooth_friction")),
    )
    text = json.dumps(to_plain(state), allow_nan=False)
    assert from_plain(Tracing, json.loads(text)) == state
    assert state.rejected == ("tooth_friction",)


def test_sign_is_new_where_it_stands_out_from_what_was_traced_and_from_its_floor():
    traced = widened({"misfit": 0.4}, {"misfit": 2.0, "kurtosis": 3.0})
    assert traced == {"misfit": 2.0, "kurtosis": 3.0}
    scales = Scales.of(Rig.from_mapping(UNSW_RIG))
    assert not is_new({"misfit": 2.9, "kurtosis": 7.0}, traced, scales)
    assert is_new({"misfit": 3.1}, traced, scales)
    assert is_new({"kurtosis": 9.0}, traced, scales)
    assert is_new({"pinion": 1e-6}, {}, scales)


def test_floors_of_signs_follow_the_instruments_of_the_machine():
    tolerances = {"pinion_graduation": 6e-6, "gear_graduation": 16e-6, "acceleration_floor": 0.02}
    fine = floors(Scales.of(Rig.from_mapping(UNSW_RIG)))
    coarse = floors(Scales.of(Rig.from_mapping({**UNSW_RIG, "tolerances": tolerances})))
    assert {k: coarse[k] / fine[k] for k in fine} == pytest.approx(
        {k: 10 if k in ("pinion", "gear", "unattributed") else 1 for k in fine}
    )


@pytest.mark.parametrize(("name", "verb"), [("rust", "pin"), ("none", "pin"), ("misalignment", "ignore")])
def test_decision_that_means_nothing_is_refused_with_what_would_be_right(name, verb):
    with pytest.raises(ParameterError, match=r"misalignment|release"):
        Decision(name=name, verb=verb)
