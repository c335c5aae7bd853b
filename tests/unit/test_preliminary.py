"""When a depth or a life is established, preliminary or not available: every rule with its sentence and its remedy."""

from dataclasses import replace
from functools import cache

import pytest

from tests.estimated_machines import rig_of
from tests.unit.test_step import recorded
from twin.assessment import HealthyErrors, HeldOutErrors
from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.established import LIMITS, History
from twin.features.extract import extract
from twin.preliminary import confidence_of, history_after
from twin.quantiles import Z95
from twin.rig import Rig
from twin.step import Options
from twin.tracing.state import Tracing, TwinStage
from twin.tracing.wear_alone import band_of_wear_alone
from twin.updating.history import WindowInput, replay_history
from twin.updating.inspections import MEASURED_DEPTH
from twin.updating.joint_gauge import SIZE, LineFactors
from twin.updating.memory import Memory

HEALTHY = HealthyErrors(rms=0.2, waveform=0.3, transmission_error=0.3)
GOOD = HeldOutErrors(rms=0.05, waveform=0.1, transmission_error=0.1, windows=(2, 5), healthy=HEALTHY)


@cache
def history():
    """The bundled short campaign, without effects."""
    rig, windows = recorded()
    inputs = [WindowInput(index=i, features=extract(rig, w)) for i, w in enumerate(windows)]
    _, outcomes = replay_history(rig, (), inputs, Options().updating(rig))
    return rig, outcomes


def latest(**memory):
    rig, outcomes = history()
    outcome = outcomes[-1]
    return rig, replace(outcome, memory=replace(outcome.memory, **memory))


def doubts(rig, outcome, errors=GOOD, of="depth"):
    found = getattr(confidence_of(rig, outcome, errors), of)
    return "" if found is None else "; ".join(found.reasons)


def by_level(outcome, **fit):
    """The outcome of a machine with a tachometer instead of encoders."""
    memory = outcome.memory
    track = replace(memory.track, windows=0)
    memory = replace(memory, track=track, fit=replace(memory.fit, **fit) if fit else memory.fit)
    return replace(outcome, memory=memory, method="rms", estimate=None)


def test_well_measured_campaign_is_established_from_its_third_worn_window():
    rig, outcomes = history()
    last = outcomes[-1]
    assert confidence_of(rig, last, GOOD).depth is None and confidence_of(rig, last, GOOD).life is None
    assert confidence_of(rig, last, GOOD).band == last.depth_band
    worn = [o for o in outcomes if o.kind == "measurement" and o.memory.track.windows]
    assert all(confidence_of(rig, o, None).depth is None for o in worn)
    young = [o for o in worn if o.memory.track.windows < LIMITS.least_worn_windows]
    assert young and all("of at least 3 worn windows" in doubts(rig, o, None, "life") for o in young)


def test_model_that_no_unworn_window_has_calibrated_is_in_doubt():
    rig, outcome = latest(fit=None)
    assert "no window of the new gears has calibrated the model" in doubts(rig, outcome)
    found = confidence_of(rig, outcome, GOOD)
    low, high = found.band
    first = outcome.memory.points[0].depth
    assert 0.9 * (outcome.depth - first) < low < outcome.depth - first and high >= 1.2 * outcome.depth
    assert found.depth.remedies == (MEASURED_DEPTH,)  # the gears are new no more
    assert any("when they are new" in remedy for remedy in confidence_of(rig, unworn_now(outcome), None).depth.remedies)


def unworn_now(outcome):
    """The same while the gears still are new."""
    return replace(outcome, unworn=True)


def test_poor_calibration_is_doubted_until_held_out_windows_confirm_the_twin():
    rig, outcome = latest()
    fit = outcome.memory.fit
    poor = replace(outcome, memory=replace(outcome.memory, fit=replace(fit, misfit=9.0)))
    assert "3.0 times their scatter (limit 2.0)" in doubts(rig, poor, None)
    assert not doubts(rig, poor, GOOD)
    values = replace(fit.calibration, modal_damping=3 * fit.calibration.modal_damping)
    off = replace(outcome, memory=replace(outcome.memory, fit=replace(fit, calibration=values)))
    assert "spreads of its prior" in doubts(rig, off, None) and not doubts(rig, off, GOOD)
    lines = replace(outcome, estimate=replace(outcome.estimate, misfit=16.0))
    assert "4.0 times what the rig file's tolerances allow" in doubts(rig, lines, None)


def test_held_out_windows_that_are_not_predicted_cast_doubt_on_the_depth():
    rig, outcome = latest()
    said = doubts(rig, outcome, replace(GOOD, transmission_error=0.45))
    assert "is 45 %, that of a healthy machine of this rig file 30 % at most" in said and "may change the depth" in said


def test_rate_that_cannot_be_distinguished_from_zero_casts_doubt_on_the_life_alone():
    rig, outcome = latest()
    track = replace(outcome.memory.track, var_rate=outcome.memory.track.rate**2)
    rig, outcome = latest(track=track)
    assert "distinguished from zero" in doubts(rig, outcome, of="life") and not doubts(rig, outcome)


def test_sudden_change_of_the_wear_rate_is_doubted_until_three_windows_have_confirmed_it():
    rig, outcome = latest(track=replace(history()[1][-1].memory.track, steady=1))
    for of in ("depth", "life"):
        assert "the wear rate changed suddenly, 1 window ago" in doubts(rig, outcome, of=of)
    track = replace(outcome.memory.track, steady=4, var_work=1e-12, var_rate=1e-20)
    jumped = track.followed(track.revolutions + 1000, 3 * track.work, 1e-9)
    assert jumped.steady == 1 and track.followed(track.revolutions + 1, track.work, track.work).steady == 5


def test_effect_in_the_model_is_tested_on_held_out_windows_first():
    found = Addition(effect=EFFECTS["tooth_friction"](coefficient=0.1), onset_revolutions=0.0)
    rig, outcome = latest(effects=(found,))
    assert "has not been tested on held-out windows yet" in doubts(rig, outcome, None)
    assert not doubts(rig, outcome, GOOD)


def test_estimated_rig_file_is_named():
    rig, outcome = latest()
    estimated = {"by": "gear-twin init", "parts": ("structure",), "spread": {"structure": 0.3}}
    rig = Rig({**rig.values, "estimated": estimated})
    assert "the rig file's structure are estimates by gear-twin init" in doubts(rig, outcome)


def test_depth_by_level_is_preliminary_and_is_not_available_where_the_level_has_not_risen():
    rig, outcome = latest()
    worn = by_level(outcome)
    found = confidence_of(rig, worn, GOOD)
    assert "the vibration level alone" in found.depth.reasons[0] and found.missing is None and found.band[0] > 0
    assert found.life.reasons[0] == found.depth.reasons[0]  # however many worn windows its rate rests on
    same = replace(worn, rms_measured=outcome.memory.unworn[-1].rms)
    quiet = confidence_of(rig, same, GOOD)
    assert "it shows wear from +50 % on" in quiet.missing and quiet.depth is None
    unknown = confidence_of(rig, replace(worn, memory=replace(worn.memory, unworn=())), GOOD)
    assert "is not known" in unknown.missing and unknown.depth is None


def misfitting(misfit):
    """A depth whose encoder lines fit so badly, and no held-out window yet."""
    rig, outcome = latest()
    return rig, replace(outcome, estimate=replace(outcome.estimate, misfit=misfit))


@pytest.mark.parametrize(("misfit", "over"), [(176.0, 1.50), (609.0, 0.386), (456.0, 0.518), (474.0, 0.527)])
def test_band_of_a_depth_knows_how_badly_the_lines_of_the_encoders_fit(misfit, over):
    """Flanks that wear only above a load: true over estimated depth by misfit, outside a band of 0.5 to 1.25 once."""
    rig, outcome = misfitting(misfit)
    low, high = confidence_of(rig, outcome, None).band
    assert low < over * outcome.depth < high


@pytest.mark.parametrize("misfit", [4.5, 7.0, 9.6])
def test_band_of_a_depth_in_slight_doubt_is_no_wider_than_before(misfit):
    rig, outcome = misfitting(misfit)
    assert confidence_of(rig, outcome, None).band == pytest.approx((0.5 * outcome.depth, 1.25 * outcome.depth))


def test_life_widens_with_the_misfit_and_is_not_given_where_the_depth_is_uncertain_by_more_than_itself():
    doubts = [confidence_of(*misfitting(m), None) for m in (9.0, 35.0, 100.0)]
    spreads = [d.life_doubt.of_depth for d in doubts]
    assert spreads == sorted(spreads) and spreads[-1] > 2 * spreads[0] and all(d.no_life is None for d in doubts)
    assert "21.8 times" in confidence_of(*misfitting(474.0), None).no_life
    assert confidence_of(*misfitting(474.0), GOOD).no_life is None  # held-out windows confirm the twin


def test_band_by_level_widens_with_the_misfit_of_the_calibration():
    rig, outcome = latest()
    good, poor = (confidence_of(rig, by_level(outcome, misfit=m), GOOD).band for m in (1.0, 4.0))
    assert good == pytest.approx((0.75 * outcome.depth, 1.75 * outcome.depth))
    assert poor == pytest.approx((0.75**2 * outcome.depth, 1.75**2 * outcome.depth))


def test_machine_that_the_model_does_not_describe_has_neither_depth_nor_life():
    rig, outcome = latest()
    assert "4.0 times their scatter" in confidence_of(rig, by_level(outcome, misfit=16.0), GOOD).missing
    level = by_level(outcome)
    off = replace(level.rms_result, rms_after=3 * level.rms_measured, updated=True, converged=False)
    assert "in another unit" in confidence_of(rig, replace(level, rms_result=off), GOOD).missing
    lines = replace(outcome.estimate, misfit=36.0)
    other = replace(outcome, memory=replace(outcome.memory, fit=None), estimate=lines)
    assert "6.0 times" in confidence_of(rig, other, GOOD).missing


BEFORE = History(latest=4, windows=4, revolutions=1000.0, depth=30e-6, depth_high=32e-6)
HELD_OUT = replace(GOOD, waveform=0.45)


def of(rig, history=BEFORE):
    return replace(history, rig=history.of_rig(rig).rig)


def test_earlier_windows_support_a_figure_where_the_doubt_has_arisen_since():
    rig, outcome = latest()
    found = confidence_of(rig, outcome, HELD_OUT, of(rig))
    assert found.depth.before.windows == 4 and found.life.before == found.depth.before
    assert confidence_of(rig, outcome, HELD_OUT).depth.before is None
    lines = replace(outcome, estimate=replace(outcome.estimate, misfit=16.0))
    assert confidence_of(rig, lines, HELD_OUT, of(rig)).depth.before is not None


def test_nothing_supports_what_was_as_doubtful_before_or_may_be_no_wear():
    """Stand-ins, estimated rig files, a calibration that fits badly, a prior wear coefficient: never an alarm."""
    rig, outcome = latest()
    fit, track = outcome.memory.fit, outcome.memory.track
    values = replace(fit.calibration, modal_damping=3 * fit.calibration.modal_damping)
    found = Addition(effect=EFFECTS["tooth_friction"](coefficient=0.1), onset_revolutions=0.0)
    for why, doubted, errors in (
        ("not calibrated", {"fit": None}, HELD_OUT),
        ("poor calibration", {"fit": replace(fit, misfit=9.0)}, HELD_OUT),
        ("far from the rig file", {"fit": replace(fit, calibration=values)}, HELD_OUT),
        ("untested effect", {"effects": (found,)}, None),
        ("sudden change", {"track": replace(track, steady=1)}, HELD_OUT),
    ):
        _, now = latest(**doubted)
        found_now = confidence_of(rig, now, errors, of(rig))
        assert found_now.depth is not None and found_now.depth.before is None, why
        assert found_now.life.before is None, why
    assert confidence_of(rig, by_level(outcome), HELD_OUT, of(rig)).depth.before is None
    _, young = latest(track=replace(track, windows=2, steady=2))  # the wear coefficient is still that of the rig file
    judged = confidence_of(rig, young, HELD_OUT, of(rig))
    assert judged.depth.before is not None and judged.life.before is None
    estimated = Rig({**rig.values, "estimated": {"by": "gear-twin init", "parts": ("mesh",), "spread": {"mesh": 0.3}}})
    assert confidence_of(estimated, outcome, HELD_OUT, of(estimated)).depth.before is None


def test_earlier_windows_support_a_depth_that_has_grown_as_before_or_up_to_twice_as_fast():
    rig, _ = latest()
    history = of(rig)
    assert history.supports(61e-6, 2000.0) is not None
    assert history.supports(95e-6, 2000.0) is None and history.supports(40e-6, 1001.0) is None


def test_history_counts_each_window_with_an_established_depth_once():
    rig, outcomes = history()
    state = History()
    for index, outcome in enumerate(outcomes):
        for _ in range(2):
            state = history_after(rig, state, outcome, confidence_of(rig, outcome, None, state), index)
    worn = [o for o in outcomes if o.kind == "measurement" and o.memory.track.windows]
    assert state.windows == len(worn) and state.depth == outcomes[-1].depth
    poor = confidence_of(rig, outcomes[-1], HELD_OUT, state)
    after = history_after(rig, state, outcomes[-1], poor, 99)
    assert replace(after, doubts=state.doubts) == state and after.doubts != state.doubts


def test_wear_alone_is_as_likely_as_effects_where_the_structure_is_estimated():
    """D02 with the rig file of init: with three effects that are not there, 17 µm lay outside a band of 4 to 10 µm."""
    rig, outcomes = history()
    last = outcomes[-1]
    alone = (0.5 * last.depth, 2.0 * last.depth)
    both, usual = confidence_of(rig, last, GOOD, alone=alone), confidence_of(rig, last, GOOD)
    assert both.band == pytest.approx(alone) and usual.band == last.depth_band
    assert both.life_doubt.of_depth > 0.4 and usual.life_doubt.of_depth == 0
    inner = (0.999 * last.depth, last.depth)
    assert confidence_of(rig, last, GOOD, alone=inner).band == last.depth_band


def test_band_of_wear_alone_is_that_of_the_stage_without_effects():
    factors = LineFactors(speed_hz=10.0, mean=(0.0,) * SIZE, covariance=((0.0,) * SIZE,) * SIZE, depth_std=2e-6)
    alone = TwinStage(memory=Memory(line_factors=factors), depth=20e-6)
    tracing = Tracing(stages=(alone, TwinStage(memory=Memory(), depth=8e-6)))
    assert band_of_wear_alone(rig_of("lab"), tracing) == pytest.approx((20e-6 - Z95 * 2e-6, 20e-6 + Z95 * 2e-6))
    assert band_of_wear_alone(rig_of("lab"), Tracing(stages=(alone,))) is None  # no effect changes the depth
    assert band_of_wear_alone(history()[0], tracing) is None  # the structure is known
