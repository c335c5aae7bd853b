"""Sentences that a person reads: actions and remedies begin with a verb, figures have units, kinds are in words."""

import ast
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from service.alarms.quantities import QUANTITIES
from service.cli.assets import change_line
from service.cli.diagnosis import verdict
from service.contract import effect_findings, findings
from service.contract.effects import Effect
from service.contract.status import data_of, status_of
from service.report.findings import findings as report_findings
from tests.estimated_machines import rig_of
from tests.unit.test_status import HEALTHY, effect, wear
from twin import grounds
from twin.assessment import Preliminary, Unexplained
from twin.baseline.diagnosis import _parameters
from twin.effects import EFFECTS
from twin.effects.channel_faults import CHANNEL_FAULTS
from twin.features.window_features import WindowFeatures
from twin.rig import Rig
from twin.tracing.summary import _caveats
from twin.updating.measurement import _remaining_difference

ROOT = Path(__file__).parents[2]
VERBS = {
    "answer",
    "check",
    "compare",
    "complete",
    "confirm",
    "find",
    "inspect",
    "measure",
    "mount",
    "plan",
    "prepare",
    "raise",
    "record",
    "remove",
    "renew",
    "replace",
    "run",
    "send",
    "stop",
    "write",
}
NONE = "No action needed."
CAVEAT = "Cause and size are preliminary, because the values of the rig file for structure are estimates."


def texts(node):
    """The beginning of every text that an expression of constants, names and f-strings can give."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else []
    if isinstance(node, ast.JoinedStr):
        return texts(node.values[0])
    if isinstance(node, ast.Name) and isinstance(getattr(grounds, node.id, None), str):
        return [getattr(grounds, node.id)]
    if isinstance(node, (ast.Tuple, ast.List)):
        return [text for item in node.elts for text in texts(item)]
    return [*texts(node.body), *texts(node.orelse)] if isinstance(node, ast.IfExp) else []


def given(folder, name):
    """Every text that is given for an argument of this name."""
    for file in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.keyword) and node.arg == name:
                yield from texts(node.value)


def first_word(text):
    return text.split()[0].lower().strip(",.:")


@pytest.mark.slow
def test_every_remedy_begins_with_a_verb():
    remedies = list(given("twin", "remedies"))
    assert len(remedies) > 15 and {r for r in remedies if first_word(r) not in VERBS} == set()
    doubt = Preliminary(reasons=("the rate is young",), remedies=tuple(remedies))
    status = status_of(replace(HEALTHY, wear=replace(wear(), preliminary=doubt)))
    assert first_word(status.action) in VERBS and status.action[0].isupper()


@pytest.mark.slow
def test_every_action_begins_with_a_verb():
    actions = [kind.facts.action for kind in EFFECTS.values()] + [fault.action for fault in CHANNEL_FAULTS.values()]
    actions += [quantity.action for quantity in QUANTITIES.values() if quantity.action]
    actions += [
        *effect_findings.OTHER_ACTIONS.values(),
        effect_findings.UNNAMED_ACTION,
        findings.INCOMPLETE,
        findings.UNJUDGED,
    ]
    actions += [text for text in given("service", "action") if " " in text.strip()]
    assert len(actions) > 25
    assert {a for a in actions if first_word(a) not in VERBS and a != NONE} == set()


def test_change_against_a_baseline_has_its_unit_in_the_status():
    change = SimpleNamespace(shaft=Fraction(1), ratio=np.array([9.0]), strong=np.array([True]), kind="run_out")
    seen = replace(effect("mesh_change", ("a1",)), status=None, parameters=_parameters(change, 0.343))
    assert "rms 0.343 m/s²." in status_of(replace(HEALTHY, effects=(seen,))).reasons[0]


def test_kinds_of_faults_and_changes_are_shown_in_words():
    fault = {"kind": "counter_reset", "channel": "encoder/pinion"}
    record = {"quality": "degraded", "start_time": "t", "faults": [fault]}
    assert data_of([record]).reason == "the latest window is degraded: counter reset in encoder/pinion"
    made = {"kind": "gears_replaced", "received": "2026-01-01T10:00:00", "done": True}
    assert change_line(made) == "2026-01-01 10:00  gears replaced"


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
