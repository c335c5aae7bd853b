"""The diagnosis: sentences that say what the answer holds, a table and a page with its figures."""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import service_fakes as fakes

from service.cli import run
from service.report.findings import growth_text, verdict
from service.report.pages import diagnosis_page as page
from service.report.text import answer_text, diagnosis_text, effect_lines, report_text
from service.report.text import diagnosis_sentences as sentences
from service.report.words import size

ROOT = Path(__file__).parents[2]


@pytest.fixture
def answer():
    found = fakes.traced_report(9000.0, 8)
    records = [fakes.record(i, 1000.0 * i) for i in range(8)]
    return {"asset": "unsw", "windows": records, **found, "data_quality": {"windows": {"good": 8}}}


def test_sentences_tell_size_onset_evidence_rival_errors_and_depth(answer):
    told = sentences(answer)
    assert told[1].startswith("Gear eccentricity: Eccentricity 79.5 ± 1 µm; present from the first measurement on.")
    line = told[2]
    for part in (
        "Misalignment of the shafts: Lead gap 40.1 ± 4.3 µm; since 4,095 revolutions.",
        "Clearly distinguished from the next best explanation, loss of mesh stiffness (log evidence",
        "134 over the next best)",
        "vibration waveform 24.0 → 9.0 %, vibration RMS 7.5 → 2.5 %",
        "changes the wear depth 180.0 → 152.0 µm; remaining life 9,800 → 11,400 revolutions.",
        "An engineer has pinned this effect.",
    ):
        assert part in line
    assert told[3].startswith("Wear depth with all effects: ") and "with wear alone 180.0 µm" in told[3]
    assert "windows 2, 5" in told[-1]
    assert line in report_text(answer)


def test_effect_that_grows_or_was_taken_back_says_so_in_every_place(answer):
    effect = answer["effects"][1]
    assert effect["name"] == "misalignment"
    effect["onset_std_revolutions"] = 310.0
    now = {"value": 0.0, "unit": "m", "std": 1.2e-6}
    again = {"value": 5656.0, "unit": "rev", "std": 240.0}
    effect["growth"] = {
        "law": "second_change", "parameter": "lead_gap", "size_at_latest_window": now, "second_change_at": again,
    }  # fmt: skip
    taken_back = "Its lead gap changed again at 5,656 ± 240 revolutions, at the latest window 0 ± 1.2 µm"
    assert taken_back in sentences(answer)[2] and "since 4,095 ± 310 revolutions" in sentences(answer)[2]
    assert growth_text({}) == ""
    rate = {"value": 2e-4, "unit": "m/1e6 rev", "std": 4e-5}
    now = {"value": 8e-6, "unit": "m", "std": 1e-6}
    effect["growth"] = {
        "law": "linear", "parameter": "lead_gap", "size_at_latest_window": now, "rate_per_million_revolutions": rate,
    }  # fmt: skip
    grows = "Its lead gap grows by 200 ± 40 µm per million revolutions, at the latest window 8 ± 1 µm"
    assert grows in sentences(answer)[2]


def test_errors_of_the_lines_that_an_effect_moves_are_said_in_every_place(answer):
    effect = answer["effects"][1]
    effect["moved_lines"] = [
        {"channel": "torque", "lines": 2, "before_percent": 100.0, "after_percent": 6.6},
        {"channel": "transmission_error", "lines": 9, "before_percent": 48.2, "after_percent": 3.1},
    ]
    said = "torque 100 → 7 %, transmission error 48 → 3 %"
    assert f"Of the lines that it moves, on the same measurements: {said}." in sentences(answer)[2]


def test_figures_that_an_answer_does_not_give_are_left_out_of_the_words(answer):
    effect = answer["effects"][0]
    effect |= {"onset_revolutions": None, "wear_depth_um_before": None, "rul_revolutions_before": None}
    effect["evidence"]["log_evidence"] = None
    effect["parameters"]["eccentricity"]["value"] = None
    effect["error_before"] = effect["error_after"] = {"rms_percent": None, "waveform_percent": None}
    assert sentences(answer)[1].startswith("Gear eccentricity: Eccentricity –; present from the first measurement on.")
    assert "held-out" not in sentences(answer)[1] and "log evidence" not in sentences(answer)[1]
    assert page(answer).count("plotly-graph-div") and len(effect_lines("unsw", answer["effects"])) >= 4


@pytest.mark.parametrize(
    ("unit", "value", "shown"),
    [("m", 4e-5, "40 ± 4 µm"), ("rad", 1.0, "57.3 ± 5.7°"), ("kg·m", 1e-4, "100 ± 10 g·mm"), ("", 0.2, "0.2 ± 0.02")],
)
def test_parameters_are_told_in_the_units_of_the_workshop(unit, value, shown):
    assert size({"value": value, "unit": unit, "std": 0.1 * value}) == shown


def test_unknown_effect_is_named_by_its_lines_and_by_no_effect(answer):
    answer["effects"] = []
    answer["unexplained"] = {
        "share_percent": 8.0,
        "verdict": "unknown_effect",
        "reason": "tones steady in hertz: 50.00 Hz",
        "orders": [{"order": 5.0, "frequency_hz": 50.0, "share_percent": 7.0}],
    }
    told = " ".join(sentences(answer))
    assert "Unknown effect: tones steady" in told and "50.00 Hz (order 5.000)" in told


def test_healthy_machine_and_one_that_was_not_traced_are_told_apart(answer):
    healthy = copy.deepcopy(answer)
    healthy["effects"] = []
    assert sentences(healthy)[0] == "Wear alone explains this machine; no effect was added."
    healthy["unexplained"]["verdict"] = "unknown_effect"
    assert sentences(healthy)[0] == "The model contains wear alone; no effect was added."
    healthy["tracing"] = {"status": "not available", "reason": "effects have not been sought"}
    assert sentences(healthy)[0] == "No effects were evaluated: effects have not been sought."


def test_effects_in_the_model_are_named_although_the_latest_search_failed(answer):
    answer["tracing"]["reason"] = "a steady state did not converge"
    shown = sentences(answer)
    assert shown[0] == "The latest search for effects was not completed: a steady state did not converge."
    assert shown[1] == "Effects besides wear: gear eccentricity, misalignment of the shafts."
    assert shown[2].startswith("Gear eccentricity") and not any("No effects were evaluated" in s for s in shown)


def test_assess_and_diagnose_give_one_verdict_in_the_same_words(answer):
    unknown = copy.deepcopy(answer)
    unknown["effects"], unknown["unexplained"] = [], {"verdict": "unknown_effect", "reason": "lines spaced by 39.6 Hz"}
    unjudged = copy.deepcopy(answer)
    unjudged["unexplained"] = {"verdict": "insufficient_data", "reason": "too few windows"}
    bare = copy.deepcopy(unknown)
    bare["wear"], bare["tracing"] = {"status": "not available", "reason": "no module"}, {"fitted": []}
    bare["calibration"] = bare["wear"]
    for record in bare["windows"]:
        record["rms_predicted"] = None
    for given in (answer, unknown, unjudged, bare):
        said, shown = verdict(given), diagnosis_text(given)
        assert said and all(line in answer_text(given).splitlines() and line in shown for line in said)
    assert "none found" not in answer_text(unknown)
    assert verdict(bare)[0] == "No model is available for this machine, so no effects were evaluated."
    bare["unexplained"] = {"verdict": "insufficient_data", "reason": "no module"}  # said of the wear already
    assert verdict(bare) == verdict(bare)[:1] and diagnosis_text(bare).count("no module") == 1


def test_text_holds_candidates_bands_and_the_log(answer):
    told = diagnosis_text(answer)
    assert "misalignment               304.0" in told
    assert "window 6 at 7029 revolutions: misalignment found, ln evidence 304" in told
    assert "Window 5, held out, by mesh harmonic" in told


def test_page_is_self_contained_and_has_a_figure_each(answer):
    html = page(answer)
    assert html.count('class="plotly-graph-div"') == 3
    assert "http://" not in html.split("<h2>Effects</h2>")[0] and '<script src="' not in html
    assert html.count('"showSendToCloud": false') == 3  # of Plotly, which offers to upload charts
    bare = page({**answer, "effects": [], "tracing": {"status": "not available", "reason": "none"}})
    assert "plotly-graph-div" not in bare


def test_report_shows_effects_and_the_same_figures(answer, tmp_path, capsys):
    source, out = tmp_path / "answer.json", tmp_path / "report.html"
    source.write_text(json.dumps(answer))
    assert run(["report", str(source), "--out", str(out)]) == 0
    assert "Misalignment" in out.read_text() and "<svg" in out.read_text()
    capsys.readouterr()
    assert run(["report", str(source)]) == 0
    assert "Lead gap 40.1 ± 4.3 µm" in capsys.readouterr().out


def test_table_has_a_row_an_effect(answer):
    heading, _, first, second = effect_lines("unsw", answer["effects"])
    assert heading == "Effects in the twin of unsw"
    assert first.startswith("gear_eccentricity") and "lead_gap 40.1 ± 4.3 µm" in second


@pytest.mark.slow
def test_diagnose_command_reads_the_json_of_an_assess(answer, tmp_path):
    source, out = tmp_path / "answer.json", tmp_path / "diagnosis.html"
    source.write_text(json.dumps(answer))
    done = subprocess.run(
        [sys.executable, "-m", "service", "diagnose", str(source), "--out", str(out)],
        cwd=ROOT, capture_output=True, text=True, env=os.environ, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0 and done.stdout.startswith("Diagnosis of unsw\n")
    assert out.read_text().startswith("<!doctype html>")


@pytest.mark.slow
def test_no_figure_of_the_page_offers_to_upload_it(answer, browser, tmp_path):
    (tmp_path / "diagnosis.html").write_text(page(answer), encoding="utf-8")
    shown = browser.new_page()
    shown.goto((tmp_path / "diagnosis.html").as_uri())
    shown.wait_for_selector(".js-plotly-plot .modebar-btn", state="attached", timeout=20_000)
    titles = shown.locator(".modebar-btn").evaluate_all(
        "buttons => buttons.map(b => b.dataset.title || b.ariaLabel || '')"
    )
    assert any("Download" in title for title in titles)
    assert not [t for t in titles if any(word in t.lower() for word in ("share", "cloud", "upload"))], titles
