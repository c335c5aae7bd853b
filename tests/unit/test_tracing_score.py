"""The score of a tracing: right and wrong names, parameters in the truth's units, errors before and after."""

from __future__ import annotations

import copy

import pytest

from benchmarks.ablation import cell, matrix, needs
from benchmarks.evaluate_tables import campaign_table, figure_table, size_table, summary
from benchmarks.realised import with_draws
from benchmarks.trace_campaigns.table import CONTRACT_EFFECTS
from benchmarks.tracing_score import SAME, figures, no_answer, score_tracing
from recordings.generator.effects import EFFECTS as GENERATED
from recordings.generator.effects import knobs_at
from tests.generator_instances import pair
from twin.effects import EFFECTS

TRUTH = {
    "id": "X1",
    "kind": "single",
    "levels": ["medium"],
    "expected_names": ["misalignment"],
    "tolerated_names": [],
    "effects": [{"name": "misalignment", "onset_revolutions": 3000.0, "parameters": {"lead_um": -32.0}}],
    "windows": [
        {"kind": "measurement", "revolutions": 9000.0, "speed_hz": 12.0, "depth": {"combined_um": 40.0}},
    ],
    "end_of_life": {"revolutions": 99000.0},
}
FOUND = {
    "name": "misalignment",
    "parameters": {"lead_gap": {"value": 30e-6, "unit": "m", "std": 1e-6}},
    "evidence": {"runner_up": "pitch_error", "over_runner_up": 12.0, "indistinguishable_from": []},
    "error_before": {"rms_percent": 20.0, "waveform_percent": 60.0},
    "error_after": {"rms_percent": 2.0, "waveform_percent": 25.0},
    "wear_depth_um_before": 50.0,
    "wear_depth_um_after": 40.5,
    "onset_revolutions": 3100.0,
}
ANSWER = {
    "effects": [FOUND],
    "residual": {"waveform_error_percent": 24.0, "rms_error_percent": 1.0},
    "unexplained": {"verdict": "explained", "orders": []},
    "wear": {"max_depth_um": {"combined": {"median": 40.5, "p05": 39.0, "p95": 42.0}}},
    "rul": {"revolutions": {"median": 81000.0, "p05": 1.0, "p95": 2.0}},
}

PROFILE = {"tip_relief_um": 6.0, "gear_tip_relief_um": None, "relief_length_mm": 1.0, "slope_um": 2.0}


def changed(base, **more):
    return {**copy.deepcopy(base), **more}


def scored(truth=TRUTH, answer=ANSWER, without=None):
    return score_tracing(truth, answer, without, name="X1")


def test_the_right_name_with_its_errors_depth_and_life():
    r = scored()
    assert r.right and not r.false and r.named == ("misalignment",) and r.runner_up == "pitch_error"
    assert (r.waveform_before, r.waveform_after, r.rms_before, r.rms_after) == (60.0, 25.0, 20.0, 2.0)
    assert r.visible and r.halved
    assert (r.depth_before, r.depth_after) == (50.0, 40.5) and r.depth_met and not r.depth_worse
    assert (r.life_true, r.life_after) == (90000.0, 81000.0)
    assert (r.onset_true, r.onset_said) == ((3000.0,), (3100.0,))


def test_an_answer_without_tracing_gives_what_was_before():
    wear = {"max_depth_um": {"combined": {"median": 55.0}}}
    without = changed(ANSWER, effects=[], wear=wear, rul={"revolutions": {"median": 45000.0}})
    r = scored(without=without)
    assert (r.depth_before, r.life_before) == (55.0, 45000.0)


def test_the_sign_of_a_misalignment_does_not_count_and_its_unit_does():
    (f,) = scored().figures
    assert (f.true, f.said, f.std) == pytest.approx((32.0, 30.0, 1.0))
    assert f.error_percent == pytest.approx(-6.25)
    in_um = changed(FOUND, parameters={"lead_gap": {"value": 30.0, "unit": "µm", "std": 1.0}})
    assert figures(TRUTH["effects"][0], in_um)[0].said == pytest.approx(30.0)


def test_a_crack_is_told_by_its_loss_and_a_list_of_teeth_by_its_spread():
    crack = {"name": "tooth_crack", "parameters": {"tooth": 3, "remaining_stiffness": 0.4}}
    (f,) = figures(crack, {"parameters": {"stiffness_loss": {"value": 0.5, "unit": "", "std": 0.1}}})
    assert (f.true, f.said) == pytest.approx((0.6, 0.5))
    pitch = {"name": "pitch_error", "parameters": {"pinion_um": 2.0, "gear_um": 1.0}}
    (f,) = figures(pitch, {"parameters": {"pinion": {"value": [2e-6, -2e-6], "unit": "m", "std": None}}})
    assert (f.true, f.said, f.std) == (2.0, pytest.approx(2.0), None)


@pytest.mark.slow
def test_pitch_errors_are_compared_with_what_was_drawn():
    """The campaign's own teeth, found again from its seed; others' truths stay as they are."""
    sizes = {"pinion_um": 4.0, "gear_um": 0.0}
    pitch = {"name": "pitch_error", "onset_revolutions": 0.0, "parameters": sizes}
    effects = [{"name": "profile_error", "onset_revolutions": 0.0, "parameters": PROFILE}, pitch]
    drawn = with_draws(changed(TRUTH, seed=7, effects=effects))["effects"]
    rows = ({"name": "profile_error", "onset_revolutions": 0.0, **PROFILE}, {**pitch, **sizes})
    form = knobs_at(rows, 0.0, pair(), 7)[0].pinion_form[:, 0]
    assert drawn[1]["parameters"]["pinion_um"] == pytest.approx(1e6 * form.std(), rel=1e-9)
    assert 2.0 < drawn[1]["parameters"]["pinion_um"] < 6.0 and drawn[1]["parameters"]["gear_um"] == 0.0
    assert drawn[0] == effects[0]
    other = changed(TRUTH, effects=[{**pitch, "parameters": {"p1_um": 4.0}}])
    assert with_draws(other) == other


def test_every_effect_has_parameters_to_compare_that_both_sides_know():
    assert set(SAME) == set(CONTRACT_EFFECTS)
    for name, known in SAME.items():
        mine = {p.name for p in EFFECTS[name].parameters}
        assert any(mine & set(names) for _, names, _ in known), name
        theirs = set(GENERATED[name].parameters) | ({"loss"} if name == "tooth_crack" else set())
        assert any(key in theirs for key, *_ in known), name


def test_a_name_that_is_not_there_is_false_even_beside_the_right_one():
    more = changed(FOUND, name="tooth_friction", parameters={})
    r = scored(answer=changed(ANSWER, effects=[FOUND, more]))
    assert r.false == ("tooth_friction",) and not r.right
    tolerant = changed(TRUTH, tolerated_names=["tooth_friction"])
    assert scored(tolerant, changed(ANSWER, effects=[FOUND, more])).right


def test_a_name_may_be_one_of_those_that_are_reported_as_indistinguishable():
    soft = changed(TRUTH, expected_names=["mesh_stiffness_loss"])
    assert not scored(soft).in_class
    unsure = changed(FOUND, evidence={"runner_up": None, "indistinguishable_from": ["mesh_stiffness_loss"]})
    r = scored(soft, changed(ANSWER, effects=[unsure]))
    assert r.in_class and not r.right and r.false == ("misalignment",)
    assert "indistinguishable from mesh_stiffness_loss" in campaign_table([r])[2]
    more = changed(FOUND, name="tooth_friction", parameters={})
    assert not scored(soft, changed(ANSWER, effects=[unsure, more])).in_class
    assert scored().in_class


def test_one_of_a_pair_is_not_the_pair():
    pair = changed(TRUTH, kind="pair", expected_names=["gear_eccentricity", "misalignment"])
    r = scored(pair)
    assert not r.right and not r.false and cell(r) == "part"


def test_of_an_unknown_effect_no_name_and_the_verdict_are_right_and_its_tones_are_counted():
    tones = {"name": "mains_interference", "onset_revolutions": 0.0, "parameters": {"freqs": [50.0, 150.0, 250.0]}}
    truth = changed(TRUTH, kind="unknown", expected_names=["unknown_effect"], effects=[tones])
    lines = [{"order": 4.2, "frequency_hz": 50.3, "share_percent": 3.0}, {"frequency_hz": 152.0}]
    silent = changed(ANSWER, effects=[], unexplained={"verdict": "unknown_effect", "orders": lines})
    r = scored(truth, silent)
    assert r.right and r.lines_found == 1 and r.foreign_hz == (50.0, 150.0, 250.0)
    assert not scored(truth, changed(silent, unexplained={"verdict": "explained"})).right
    named = scored(truth, changed(silent, effects=[FOUND]))
    assert named.false == ("misalignment",) and not named.right


def test_a_belts_tone_is_where_the_speed_puts_it():
    belt = {"name": "order_tone", "onset_revolutions": 0.0, "parameters": {"order": 7.5, "amplitude": 1.0}}
    assert scored(changed(TRUTH, expected_names=["unknown_effect"], effects=[belt])).foreign_hz == (90.0,)


def test_a_clean_campaign_is_right_when_nothing_is_added():
    clean = changed(TRUTH, kind="clean", expected_names=[], effects=[], levels=[])
    assert scored(clean, changed(ANSWER, effects=[])).right
    assert not scored(clean).right


@pytest.mark.parametrize(
    ("true", "said", "met"), [(40.0, 41.9, True), (40.0, 42.1, False), (80.0, 83.9, True), (80.0, 75.9, False)]
)
def test_the_depth_may_be_off_by_five_percent_or_two_micrometres(true, said, met):
    truth = changed(TRUTH, windows=[changed(TRUTH["windows"][0], depth={"combined_um": true})])
    answer = changed(ANSWER, wear={"max_depth_um": {"combined": {"median": said}}})
    assert scored(truth, answer).depth_met is met


def test_reference_campaigns_without_a_kind_are_sorted_by_what_they_expect():
    plain = {k: v for k, v in TRUTH.items() if k not in ("kind", "levels")}
    assert scored(plain).kind == "single"
    assert scored({**plain, "expected_names": []}).kind == "clean"
    assert scored({**plain, "expected_names": ["unknown_effect"]}).kind == "unknown"


def test_a_recording_without_an_answer_is_not_right_and_says_why():
    r = no_answer(TRUTH, "no whole window", name="X1")
    assert r.failed == "no whole window" and not r.right and r.depth_met is None and cell(r) == "no answer"
    assert "no answer: no whole window" in campaign_table([r])[-1]


def test_the_tables_show_what_was_found_beside_the_aims():
    clean = changed(TRUTH, id="X2", kind="clean", expected_names=[], effects=[], levels=[])
    results = [scored(), scored(clean)]
    assert "misalignment (m) → misalignment (runner-up pitch_error; explained)" in campaign_table(results)[2]
    assert "FALSE: misalignment" in campaign_table(results)[3]
    assert any("-6.2" in line and "lead_um" in line for line in figure_table(results))
    assert any(line.split()[:4] == ["misalignment", "–", "1/1", "–"] for line in size_table(results))
    lines = {line[:46].strip(): line for line in summary(results)}
    assert "100 %  ( 1 of  1)  ≥ 90 %" in lines["single effects named right, all sizes"]
    assert lines["clean campaigns given an effect"].endswith("≤ 1 %   missed")
    assert "1 in 2 campaigns" in lines["names given to what is not there"]
    assert "both of a pair named" not in lines  # no such campaign, no line


def test_the_ablation_says_with_which_channels_an_effect_is_named():
    nothing = scored(answer=changed(ANSWER, effects=[]))
    results = {("accel", "one"): [nothing], ("all", "one"): [scored()]}
    table = matrix(results)
    assert table[1].split() == ["X1", "nothing", "right"]
    assert needs(results) == [f"{'misalignment':22s}all, one: medium"]
