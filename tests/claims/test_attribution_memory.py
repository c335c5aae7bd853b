"""Held-out windows judge an effect by the same windows, and what they have said is not forgotten."""

from dataclasses import replace

import numpy as np
import pytest

from tests.mesh_pairs import UNSW_RIG
from tests.stored_states import stored_state
from twin.assessment import HealthyErrors, HeldOutErrors
from twin.errors import NotAvailable, NotConverged
from twin.rig import Rig
from twin.tracing import attribution_loop, earned
from twin.tracing.context import TracingContext
from twin.tracing.earned import refused, with_errors
from twin.tracing.held_out_error import ChannelComparison, HeldOutComparison
from twin.tracing.state import Refusal
from twin.tracing.summary import attribution_of
from twin.tracing.unexplained import does_not_fit, unexplained_of
from twin.updating.history import UpdateOptions
from twin.updating.residual import WindowResidual

RIG = Rig.from_mapping(UNSW_RIG)
OPTIONS = UpdateOptions(threshold=0.05, update="fused", update_until=float("inf"))


@pytest.fixture
def tracing():
    return stored_state("unsw-rig").tracing


def comparison(window, left):
    y = np.array([1.0, 1.0])
    lines = ChannelComparison(
        orders=np.array([19.0, 38.0]), measured=y, predicted=y - left, std=np.zeros(2), variance=np.full(2, 1e-4)
    )
    channels = {"acceleration": lines, "transmission_error": lines}
    return HeldOutComparison(
        index=window.index, speed_hz=10.0, channels=channels, rms_measured=1.0, rms_predicted=1.0
    )  # fmt: skip


def failing_with_the_effect(hard):
    """Comparisons that the twin with the effect cannot make on the hard window, where the twin without it is bad."""

    def compare(rig, memory, additions, learned, window, depth):
        if additions and window.index == hard:
            raise NotConverged("no steady state at 10 Hz with 1 effects")
        return comparison(window, 0.9 if window.index == hard else 0.2 if additions else 0.1)

    return compare


def test_window_that_one_twin_cannot_predict_is_left_out_of_both_errors_and_named(tracing, monkeypatch):
    hard = 2
    monkeypatch.setattr(earned, "compare", failing_with_the_effect(hard))
    errors = with_errors(RIG, tracing).errors[0]
    assert errors.before.windows == errors.after.windows and hard not in errors.after.windows
    assert errors.before.waveform == pytest.approx(0.1) and errors.after.waveform == pytest.approx(0.2)
    assert f"window {hard} is left out: no steady state" in errors.after.note


def test_effect_is_refused_by_the_windows_on_which_it_fails_and_says_why(tracing, monkeypatch):
    monkeypatch.setattr(earned, "compare", failing_with_the_effect(2))
    judged = with_errors(RIG, tracing)
    ((item, reason),) = refused(judged)
    assert item.name == "misalignment" and "does not fall with it" in reason


def test_what_an_engineer_has_accepted_stays_whatever_held_out_windows_say(tracing, monkeypatch):
    monkeypatch.setattr(earned, "compare", failing_with_the_effect(2))
    assert refused(with_errors(RIG, replace(tracing, decisions={"misalignment": "accepted"}))) == []


def test_errors_of_the_twin_in_use_are_computed_without_any_effect_too(tracing, monkeypatch):
    monkeypatch.setattr(
        earned, "compare", lambda rig, memory, additions, learned, window, depth: comparison(window, 0.1)
    )
    alone = with_errors(RIG, replace(tracing, found=(), stages=tracing.stages[:1]))
    assert alone.errors == () and alone.error.waveform == pytest.approx(0.1) and alone.residual is None


def test_trace_that_fails_forgets_neither_the_misfit_nor_what_held_out_windows_have_refuted(tracing, monkeypatch):
    def fails(*given):
        raise NotAvailable("effects are not traced before two measurement windows")

    known = replace(tracing, refuted={"tooth_friction": Refusal(reason="chance")}, next_trace=0)
    window = known.history[-1]
    outcome = outcome_of(known)
    monkeypatch.setattr(attribution_loop, "trace_over_remounts", fails)
    monkeypatch.setattr(attribution_loop, "advanced", lambda rig, stage, window, options: stage)
    monkeypatch.setattr(attribution_loop, "staged", lambda rig, stage, window, outcome: stage)
    monkeypatch.setattr(attribution_loop, "change_indicators", lambda rig, window, outcome: {})
    after = attribution_loop.attribute_window(RIG, known, window, outcome, OPTIONS).tracing
    assert after.refuted == known.refuted and after.latest.misfit_after == known.latest.misfit_after
    assert after.latest.reason == "effects are not traced before two measurement windows"
    said = attribution_of(after)
    assert said.not_confirmed == ("tooth_friction",) and said.held_out == known.latest.held_out


def outcome_of(tracing):
    """As much of an outcome as the loop itself reads."""

    class Outcome:
        kind = "measurement"
        memory = tracing.memory

    return Outcome()


RESIDUAL = WindowResidual(
    rms_error=0.01, measured=1.0, left=0.01, noise=0.0, between=0.0, phase_known=True, bands=(), lines=()
)  # fmt: skip
HEALTHY = HealthyErrors(rms=0.1, waveform=0.12, transmission_error=0.3)
GOOD = HeldOutErrors(rms=0.01, waveform=0.05, transmission_error=0.1, windows=(2, 5, 8), healthy=HEALTHY)


def test_machine_is_explained_where_held_out_windows_lie_within_what_a_healthy_machine_leaves():
    found = unexplained_of([RESIDUAL], [], GOOD)
    assert found.verdict == "explained" and found.reason == "" and found.limits == HEALTHY


@pytest.mark.parametrize(
    ("errors", "said"),
    [
        (None, "no held-out window"),
        (HeldOutErrors(), "no held-out window"),
        (replace(GOOD, waveform=0.5, windows=(2, 5)), "the error of the acceleration on held-out windows is 50 %"),
        (replace(GOOD, transmission_error=None), "the transmission error of held-out windows is not available"),
    ],
)
def test_machine_is_not_explained_without_held_out_windows_that_confirm_it(errors, said):
    found = unexplained_of([RESIDUAL], [], errors)
    assert found.verdict == "insufficient_data" and said in found.reason


@pytest.mark.parametrize(
    ("channel", "error", "said"),
    [
        ("waveform", 0.2, "the error of the acceleration on held-out windows is 20 %, that of a healthy machine"),
        ("transmission_error", 0.31, "the transmission error on held-out windows is 31 %, that of a healthy machine"),
        ("rms", 0.63, "the error of the level on held-out windows is 63 %"),  # a mount's resonance, "explained" once
        ("rms", 4.7, "the model does not fit: it misses the level of held-out windows by 4.7 ×"),
    ],
)
def test_what_no_healthy_machine_leaves_in_three_windows_is_content_without_a_name(channel, error, said):
    found = unexplained_of([RESIDUAL], [], replace(GOOD, **{channel: error}))
    assert found.verdict == "unknown_effect" and said in found.reason


@pytest.mark.parametrize("channel", ["rms", "waveform", "transmission_error"])
@pytest.mark.parametrize("most", [1.0, 1.37, 4.0])
def test_channel_of_which_a_healthy_machine_may_miss_all_confirms_nothing(channel, most):
    """A 60 % crack beside pitch errors: the acceleration off by 54 %, a healthy machine's limit 137 %, "explained"."""
    wide = replace(GOOD, healthy=replace(HEALTHY, **{channel: most}), **{channel: 0.5})
    found = unexplained_of([RESIDUAL], [], wide)
    assert found.verdict == "insufficient_data" and f"may leave {100 * most:.0f} % of the" in found.reason


def test_limit_is_this_machines_own_and_no_constant():
    """28 % of the transmission error: explained near a resonance where healthy machines reach 45 %, nowhere else."""
    near = replace(GOOD, transmission_error=0.28, healthy=replace(HEALTHY, transmission_error=0.45))
    away = replace(GOOD, transmission_error=0.28, healthy=replace(HEALTHY, transmission_error=0.12))
    assert unexplained_of([RESIDUAL], [], near).verdict == "explained"
    assert unexplained_of([RESIDUAL], [], away).verdict == "unknown_effect"
    few = replace(away, windows=(2,))
    assert unexplained_of([RESIDUAL], [], few).verdict == "insufficient_data"


def test_model_that_predicts_worse_than_nothing_gives_no_life():
    assert does_not_fit(replace(GOOD, rms=4.7)) and does_not_fit(replace(GOOD, waveform=1.2))
    assert does_not_fit(GOOD) is None and does_not_fit(replace(GOOD, transmission_error=1.2)) is None


@pytest.mark.parametrize(("between", "verdict"), [
    (0.01, "explained"), (0.15, "unknown_effect"), (0.3, "unknown_effect"), (0.6, "unknown_effect"),
])  # fmt: skip
def test_noise_between_the_lines_counts_into_what_is_unexplained(between, verdict):
    """Noise that is 39 % of the level holds 15 % of the energy; counted by lines alone it was 0.35 %."""
    noisy = replace(RESIDUAL, left=0.0035, measured=1 - between, between=between)
    found = unexplained_of([noisy], [], GOOD)
    assert found.share == pytest.approx(between + 0.0035) and found.verdict == verdict
    assert verdict == "explained" or f"of the shafts is {100 * between**0.5:.0f} % of the level" in found.reason


@pytest.mark.parametrize(("share", "times"), [(33.6, "5.8 ×"), (21.0, "4.6 ×"), (1.3, "1.1 ×")])
def test_model_that_leaves_more_than_was_measured_is_said_not_to_fit_and_no_share_over_100_per_cent(share, times):
    """2.1e+03 % of the measured energy, where the model made 12.5 m/s² of 2.66."""
    found = unexplained_of([replace(RESIDUAL, left=share)], [], None)
    assert f"the model does not fit: the lines that it leaves are {times} the measured level" in found.reason
    assert found.verdict == "insufficient_data" and "%" not in found.reason


def test_doubt_leaves_a_machine_unexplained():
    doubted = unexplained_of([RESIDUAL], ["the mesh is too soft"], GOOD)
    assert (doubted.verdict, doubted.reason) == ("insufficient_data", "the mesh is too soft")
    assert unexplained_of([], [], GOOD).share is None


def test_window_whose_torque_is_not_known_is_neither_traced_nor_compared(tracing):
    """The lines of the mesh depend on the load: effects would explain what a saturated torque meter hides."""
    fault = "torque/pinion: stuck, every sample is 50: cable or supply?"
    history = tuple(replace(w, torque_unknown=fault) if w.index == 2 else w for w in tracing.history)
    context = TracingContext.of(RIG, history, tracing.stages[0].depths, tracing.phase)
    assert [w.index for w in context.windows] == [w.index for w in tracing.history if w.index != 2]
    assert context.skipped == ((2, f"the torque that its lines depend on is not known: {fault}"),)
    errors = with_errors(RIG, replace(tracing, history=history)).error
    assert 2 not in errors.windows
    with pytest.raises(NotAvailable, match=r"before two measurement windows \(.*torque that its lines depend on"):
        TracingContext.of(RIG, [replace(w, torque_unknown=fault) for w in history], {}, tracing.phase)
