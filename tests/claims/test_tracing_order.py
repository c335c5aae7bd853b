"""The order in which the detectors are asked does not decide what is found."""

import random
from dataclasses import replace
from functools import lru_cache

import pytest

from benchmarks.scoring import windows_of
from tests.mesh_pairs import UNSW_RIG
from twin.effects import EFFECTS
from twin.rig import Rig
from twin.scales import Scales
from twin.step import Options, State, step
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import TracingContext
from twin.tracing.detectors import DETECTORS, Detector
from twin.tracing.findings import ShaftForce
from twin.tracing.settling import ask, settled
from twin.tracing.trace import trace

RIG = Rig.from_mapping(UNSW_RIG)
CONTEXT = TracingContext(
    rig=RIG, windows=(), measurement=frozenset(), held_out=frozenset(), depths={}, phase=0.0, scales=Scales.of(RIG),
    worn=None,
)  # fmt: skip
PITCH = AttributedEffect.of(EFFECTS["pitch_error"](pinion=(1e-6,) * 19), parameters={}, log_evidence=1.0)
RUN_OUT = AttributedEffect.of(EFFECTS["gear_eccentricity"](eccentricity=1e-5), parameters={}, log_evidence=1.0)


def finds_pitch(context):
    return context.findings.adding(PITCH)


def finds_run_out_unless_teeth_differ(context):
    return context.findings if context.findings.has("pitch_error") else context.findings.adding(RUN_OUT)


TWO = (
    Detector(name="tooth_errors", detect=finds_pitch),
    Detector(name="eccentricity", detect=finds_run_out_unless_teeth_differ, consults=("tooth_errors",)),
)


def asked(detectors):
    context, known = CONTEXT, {}
    for detector in detectors:
        context = ask(context, detector, known)
    return settled(context, known, detectors)


def test_detector_asked_too_early_is_asked_again_with_what_was_found_since():
    for order in (TWO, TWO[::-1]):
        assert [e.name for e in asked(order).findings.effects] == ["pitch_error"]


def test_in_the_usual_order_nothing_is_asked_twice():
    count = []

    def counted(detector):
        return replace(detector, detect=lambda c: count.append(detector.name) or detector.detect(c))

    asked([counted(d) for d in TWO])
    assert count == ["tooth_errors", "eccentricity"]


RIPPLE = AttributedEffect.of(EFFECTS["torque_ripple"](amplitude=1.0, order=7.0), parameters={}, log_evidence=1.0)
SUSPECTED = ShaftForce(effect=RIPPLE.addition.effect, parameters={}, log_evidence=1.0, order=7.0)
BETTER = AttributedEffect.of(EFFECTS["pitch_error"](pinion=(2e-6,) * 19), parameters={}, log_evidence=1.0)


def suspects_ripple(context):
    return replace(context.findings, forces=(SUSPECTED,))


def confirms_ripple(context):
    return context.findings.adding(RIPPLE)


def refines_pitch(context):
    return replace(context.findings, effects=tuple(BETTER if e is PITCH else e for e in context.findings.effects))


FORCES_AND_TEETH = (
    Detector(name="shaft_forces", detect=suspects_ripple),
    Detector(name="tooth_errors", detect=finds_pitch, consults=("shaft_forces", "eccentricity")),
    Detector(
        name=next(d.name for d in DETECTORS if d.refines == "tooth_errors"),
        detect=refines_pitch,
        finds="none",
        refines="tooth_errors",
        consults=("tooth_errors",),
    ),
    Detector(name="shaft forces that nothing else explains", detect=confirms_ripple, finds="shaft_forces"),
)


def test_a_suspected_force_that_is_confirmed_is_no_new_finding():
    """Pitch errors were fitted again without the effects on the mesh, and came out twice as large."""
    effects = asked(FORCES_AND_TEETH).findings.effects
    assert {e.name for e in effects} == {"torque_ripple", "pitch_error"}
    assert any(e is BETTER for e in effects)


def test_what_a_later_step_has_refined_is_refined_again_after_a_second_answer():
    eccentric = Detector(name="eccentricity", detect=lambda c: c.findings.adding(RUN_OUT))
    effects = asked((*FORCES_AND_TEETH, eccentric)).findings.effects  # what tooth errors consult comes last
    assert any(e is BETTER for e in effects) and not any(e is PITCH for e in effects)


def test_every_detector_consults_detectors_that_there_are():
    names = {d.name for d in DETECTORS}
    assert all(set(d.consults) <= names for d in DETECTORS)


@lru_cache(maxsize=3)
def followed(recording):
    rig, windows = windows_of(recording)
    state = State()
    for window in windows:
        state, _ = step(rig, state, window, Options())
    return rig, state


@pytest.mark.shared
@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("D02", {"misalignment"}),
        ("D05", {"tooth_crack"}),
        ("D06", {"pitch_error"}),
        ("D07", {"gear_eccentricity", "misalignment"}),
    ],
)
def test_reference_campaign_has_the_same_effects_in_any_order_of_detectors(shared, name, expected):
    rig, state = followed(shared / "campaigns" / f"{name}.mcap")
    tracing = state.tracing
    mixed = list(DETECTORS)
    random.Random(4).shuffle(mixed)
    results = [
        trace(rig, tracing.history, dict(tracing.stages[-1].depths), tracing.phase, detectors=order).found
        for order in (DETECTORS, DETECTORS[::-1], tuple(mixed))
    ]
    for found in results:
        assert {f.name for f in found} == expected
        for one, other in zip(found, results[0], strict=True):
            assert one.parameters.keys() == other.parameters.keys()
            for parameter, (value, _, std) in one.parameters.items():
                assert value == pytest.approx(other.parameters[parameter][0], abs=0.05 * std + 1e-9)
