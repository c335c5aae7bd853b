"""The search for effects on the mesh: what is there is found whatever the order, and what is not needed goes again.

The windows are the twin's own predictions with the wear that the effects cause, so that the truth is known exactly.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from tests.dynamics_cases import RIG, TEN, model
from twin.effects.response import Effect
from twin.tracing import mesh_search
from twin.tracing.joint_problem import predict
from twin.tracing.mesh_fits import AlikeTeeth, Candidate
from twin.tracing.mesh_pruning import pruned, told_from_nothing
from twin.tracing.mesh_search import MeshFindings, rivals, search_mesh
from twin.tracing.mesh_trials import mesh_trials, started
from twin.tracing.mesh_wear import curve_with
from twin.tracing.mesh_windows import MeshWindows
from twin.tracing.observed import Observed
from twin.tracing.scatter import HealthyScatter

DEPTHS = (0.0, 8e-6, 16e-6, 24e-6)
TRIALS = mesh_trials()
SIZES = {"misalignment": 1.0, "tooth_friction": 0.6, "mesh_stiffness_loss": 2.0}  # in units of the priors


def trial(name: str):
    """The trial of an effect with its size here, or where it usually starts."""
    return started(TRIALS[name], np.array([SIZES[name]]), 0.0) if name in SIZES else TRIALS[name]


def window(index: int, depth: float, effects: tuple[Effect, ...]) -> Observed:
    o = Observed(
        index=index, condition=TEN, revolutions=1000.0 * index + 1, worn=depth > 0, pinion_only=False, lines={}, std={},
        mean=None, torque_known=True,
    )  # fmt: skip
    shaping = tuple(e for e in effects if e.facts.shapes_wear)
    curve = curve_with(model(), shaping, TEN)
    profile = curve.profile(max(depth, curve.start_depth)).slices if depth else model().unworn
    found = predict(model(), effects, profile, o)
    std = {channel: 1e-3 * np.abs(lines) + 1e-12 for channel, lines in found.lines.items()}
    return replace(o, lines=found.lines, std=std, mean=found.mean)


@lru_cache
def fits(*names: str) -> AlikeTeeth:
    """Windows of a machine with these effects."""
    effects = tuple(trial(n).make(np.array([SIZES[n]])) for n in names)
    windows = tuple(window(i, depth, effects) for i, depth in enumerate(DEPTHS))
    mesh = MeshWindows(
        model=model(), windows=windows, depth=np.array(DEPTHS), phase=0.0, scatter=HealthyScatter.of_rig(RIG)
    )
    return AlikeTeeth(windows=mesh)


@lru_cache
def found(*names: str) -> MeshFindings:
    return search_mesh(fits(*names))


def names(findings: MeshFindings) -> set[str]:
    return {c.trial.name for c in findings.found}


def test_machine_with_wear_alone_has_nothing_added():
    assert found().found == () and found().base.misfit < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", SIZES)
def test_effect_that_is_there_is_found_with_its_size(name):
    findings = found(name)
    assert names(findings) == {name}
    assert findings.found[0].numbers[0] == pytest.approx(SIZES[name], rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("there", [("misalignment",), ("tooth_friction", "mesh_stiffness_loss")])
def test_order_in_which_effects_are_tried_does_not_decide_what_is_found(there, monkeypatch):
    one = found(*there)
    monkeypatch.setattr(mesh_search, "mesh_trials", lambda: dict(reversed(TRIALS.items())))
    other = search_mesh(fits(*there))
    assert names(one) == names(other) == set(there)
    for c in one.found:
        (same,) = (d for d in other.found if d.trial.name == c.trial.name)
        np.testing.assert_allclose(same.numbers, c.numbers, rtol=0.02)
        assert same.gain == pytest.approx(c.gain, abs=0.5)


@pytest.mark.parametrize("first", ["mesh_stiffness_loss", "tooth_friction"])
def test_effect_taken_for_want_of_the_right_one_goes_again(first):
    """Found before, say when only few windows were there; later windows show misalignment, which explains all."""
    findings = search_mesh(fits("misalignment"), kept=(trial(first), trial("misalignment")))
    assert names(findings) == {"misalignment"} and findings.pruned == (first,)
    (alone,) = found("misalignment").found
    np.testing.assert_allclose(findings.found[0].numbers, alone.numbers, rtol=0.02)


def test_order_of_what_was_found_before_does_not_matter():
    pair = (trial("mesh_stiffness_loss"), trial("tooth_friction"))
    one, other = (search_mesh(fits("tooth_friction"), kept=kept) for kept in (pair, pair[::-1]))
    assert names(one) == names(other) == {"tooth_friction"}


def test_what_an_engineer_keeps_stays_and_says_that_it_adds_nothing():
    kept = (trial("mesh_stiffness_loss"), trial("misalignment"))
    findings = search_mesh(fits("misalignment"), kept=kept, fixed=("mesh_stiffness_loss",))
    assert names(findings) == {"mesh_stiffness_loss", "misalignment"} and findings.pruned == ()
    gain = {c.trial.name: c.gain for c in findings.found}
    assert gain["mesh_stiffness_loss"] < 1 < 20 < gain["misalignment"]


@pytest.mark.slow
def test_two_effects_that_are_both_there_both_stay_and_each_with_what_leaving_it_out_loses():
    findings = found("tooth_friction", "mesh_stiffness_loss")
    assert names(findings) == {"tooth_friction", "mesh_stiffness_loss"}
    machine = fits("tooth_friction", "mesh_stiffness_loss")
    for c in findings.found:
        (other,) = (d for d in findings.found if d is not c)
        without = machine.windows.fitted((started(other.trial, other.numbers, 0.0),), findings.base, 2).fit
        # a fit that leaves as much unexplained as this one ends where a step promises 5 % of its misfit
        assert c.gain == pytest.approx(findings.best.log_evidence - without.log_evidence, rel=0.01)


def test_pruning_of_nothing_is_nothing():
    base = fits().windows.plain()
    best, losses, gone = pruned(fits(), base, base)
    assert best is base and losses == {} and gone == ()


def test_number_within_its_interval_is_not_told_from_nothing():
    (candidate,) = found("misalignment").found
    assert told_from_nothing(candidate.fit, candidate.trial)
    fit = candidate.fit
    at = len(fit.shared) - 1
    nothing = replace(fit, shared=np.where(np.arange(at + 1) == at, 1.5 * np.sqrt(fit.covariance[at, at]), fit.shared))
    assert not told_from_nothing(nothing, candidate.trial)


def test_explanation_within_what_an_effect_must_add_is_said_to_be_indistinguishable():
    (chosen,) = found("misalignment").found

    def other(gain: float) -> Candidate:
        stiffness = trial("mesh_stiffness_loss")
        fit = replace(chosen.fit, trials=(stiffness,))
        return Candidate(trial=stiffness, fitted=replace(chosen.fitted, fit=fit), gain=gain)

    assert rivals(chosen, [other(chosen.gain - 5)]) == (
        ("mesh_stiffness_loss", pytest.approx(5)),
        ("mesh_stiffness_loss",),
    )
    assert rivals(chosen, [other(chosen.gain - 7)]) == (("mesh_stiffness_loss", pytest.approx(7)), ())


@pytest.mark.slow
def test_effects_that_are_not_needed_do_not_keep_out_the_one_that_is():
    kept = (trial("mesh_stiffness_loss"), trial("mesh_damping"), trial("profile_error"))
    findings = search_mesh(fits("tooth_friction"), kept=kept)
    assert names(findings) == {"tooth_friction"} and set(findings.pruned) == {t.name for t in kept}
