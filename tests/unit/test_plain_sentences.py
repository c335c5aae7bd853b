"""Sentences that a person reads: actions and remedies begin with a verb, figures have units, kinds are in words."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from service.contract import effect_findings
from service.contract.parts import Effect
from service.contract.status import data_of, status_of
from service.report.findings import findings as report_findings
from service.report.findings import verdict
from tests.estimated_machines import rig_of
from tests.unit.test_status import HEALTHY, effect
from twin.assessment import Unexplained
from twin.baseline.diagnosis import _parameters
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.tracing.summary import _caveats
from twin.updating.measurement import _remaining_difference

CAVEAT = "Cause and size are preliminary, because the values of the rig file for structure are estimates."


def test_change_against_a_baseline_has_its_unit_in_the_status():
    change = SimpleNamespace(shaft=Fraction(1), ratio=np.array([9.0]), strong=np.array([True]), kind="run_out")
    seen = replace(effect("mesh_change", ("a1",)), status=None, parameters=_parameters(change, 0.343))
    assert "rms 0.343 m/s²." in status_of(replace(HEALTHY, effects=(seen,))).reasons[0]


def test_kinds_of_faults_are_shown_in_words():
    fault = {"kind": "counter_reset", "channel": "encoder/pinion"}
    record = {"quality": "degraded", "start_time": "t", "faults": [fault]}
    assert data_of([record]).reason == "the latest window is degraded: counter reset in encoder/pinion"


def test_machine_without_an_accelerometer_is_not_said_to_vibrate():
    rest = Unexplained(verdict="insufficient_data", reason="the acceleration of held-out windows is not available")
    silent = replace(HEALTHY.window, rms_measured=None)
    status = status_of(replace(HEALTHY, window=silent, unexplained=rest))
    assert status.reasons == [f"The model of the machine is not confirmed yet: {rest.reason}."]
    assert "vibration" not in status.action and "mount an accelerometer" in status.action
    assert "vibration is not explained yet" in status_of(replace(HEALTHY, unexplained=rest)).reasons[0]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (2.0, "make 1.41 m/s²; the vibration measured in the band is 3 m/s²"),
        (10.0, "make 7.07 m/s², which is more than all that was measured in the band: 3 m/s²"),
    ],
)
def test_mesh_lines_of_the_model_are_no_part_of_what_was_measured(line, said):
    features = WindowFeatures(start_time_ns=0, duration=1.0, quality="good", rms=3.0)
    note = _remaining_difference(features, np.array([line + 0j]), np.array([190.0]), (10.0, 1000.0))
    assert note == f"after the update the mesh lines of the model {said}"


def test_model_that_gives_no_wear_depth_is_not_said_to_be_missing():
    answer = {
        "wear": {"status": "not available", "reason": "the rig file does not describe this machine"},
        "effects": [], "tracing": {"fitted": []}, "calibration": {"status": "not available"},
        "windows": [{"rms_predicted": 3.0}],
    }  # fmt: skip
    assert verdict(answer)[0] == "The model of this machine gives no wear depth, so no effects were evaluated."
    answer["windows"] = [{"rms_predicted": None}]
    assert verdict(answer)[0] == "No model is available for this machine, so no effects were evaluated."


# -- effects found with an estimated structure ---------------------------------------------------------------


def test_effect_with_an_estimated_structure_is_at_most_a_watch_until_it_is_accepted():
    crack = replace(effect("tooth_crack"), caveats=(CAVEAT,))
    status = status_of(replace(HEALTHY, effects=(crack,)))
    assert status.level == "watch"
    assert status.reasons[0].endswith(f"; c{CAVEAT[1:]}")
    assert status.action == f"Confirm the effect (a cracked tooth) before acting on it: {effect_findings.CONFIRMATION}."
    assert "stop" not in status.action.lower()
    assert status_of(replace(HEALTHY, effects=(replace(crack, status="accepted"),))).level == "alarm"


def test_cause_and_size_are_preliminary_where_the_structure_is_estimated():
    rig = rig_of("lab")
    (said,) = _caveats(rig, "mesh", "found", "")
    assert said.startswith("Cause and size are preliminary, because the values of the rig file for structure")
    assert said.endswith(" are estimates.") and "wear" not in said
    assert _caveats(rig, "mesh", "accepted", "")[0].startswith("The size is preliminary")
    assert _caveats(rig, "non_gear", "found", "") == ()  # a bearing is found by lines of its own
    known = {key: value for key, value in rig.values.items() if key != "estimated"}
    assert _caveats(Rig.from_mapping(known), "mesh", "found", "") == ()


def test_caveat_is_said_in_the_answer_the_commands_and_the_report():
    shown = Effect.of(replace(effect("misalignment"), caveats=(CAVEAT,))).as_json()
    assert shown["caveats"] == [CAVEAT] and "caveats" not in Effect.of(effect("misalignment")).as_json()
    answer = {"effects": [shown], "wear": {}, "tracing": {}, "unexplained": {}}
    assert verdict(answer) == ["Effects besides wear: misalignment of the shafts.", CAVEAT]
    (finding,) = report_findings(answer)
    assert CAVEAT in finding.sentences
