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

from service.cli.diagnosis import effect_table, sentences, text
from service.cli.diagnosis_figures import page

ROOT = Path(__file__).parents[2]


@pytest.fixture
def answer():
    found = fakes.traced_report(9000.0, 8)
    records = [fakes.record(i, 1000.0 * i) for i in range(8)]
    return {"asset": "unsw", "windows": records, **found, "data_quality": {"windows": {"good": 8}}}


def test_sentences_tell_size_onset_evidence_rival_errors_and_depth(answer):
    told = sentences(answer)
    assert told[0].startswith("Gear eccentricity, from the start: eccentricity 79.5 ± 1 µm (ln evidence 390 over")
    line = told[1]
    for part in (
        "Misalignment of the shafts, since 4095 revolutions: lead gap 40.1 ± 4.3 µm",
        "next best loss of mesh stiffness, 134 behind (certain)",
        "waveform error on held-out windows 24.0 % without, 9.0 % with it",
        "wear depth 180.0 µm without, 152.0 µm with it",
        "pinned by an engineer",
    ):
        assert part in line
    assert "windows 2, 5" in told[-1]


def test_unknown_effect_is_named_by_its_lines_and_by_no_effect(answer):
    answer["effects"] = []
    answer["unexplained"] = {
        "share_percent": 8.0,
        "verdict": "unknown_effect",
        "reason": "tones steady in hertz: 50.00 Hz",
        "orders": [{"order": 5.0, "frequency_hz": 50.0, "share_percent": 7.0}],
    }
    told = " ".join(sentences(answer))
    assert "no name fits" in told and "50.00 Hz (order 5.000)" in told


def test_healthy_machine_and_one_that_was_not_traced_are_told_apart(answer):
    healthy = copy.deepcopy(answer)
    healthy["effects"] = []
    assert sentences(healthy)[0] == "Wear alone explains this machine; no effect was added."
    healthy["tracing"] = {"status": "not available", "reason": "effects have not been sought"}
    assert sentences(healthy) == ["No effect has been sought: effects have not been sought."]


def test_text_holds_candidates_bands_and_the_log(answer):
    told = text(answer)
    assert "misalignment               304.0" in told
    assert "window 6 at 7029 revolutions: misalignment found, ln evidence 304" in told
    assert "Window 5, held out, by mesh harmonic" in told


def test_page_is_self_contained_and_has_a_figure_each(answer):
    html = page(answer)
    assert html.count('class="plotly-graph-div"') == 3
    assert "http://" not in html.split("<h2>Effects</h2>")[0] and '<script src="' not in html
    bare = page({**answer, "effects": [], "tracing": {"status": "not available", "reason": "none"}})
    assert "plotly-graph-div" not in bare


def test_table_has_a_row_an_effect(answer):
    assert effect_table(answer["effects"], "effects").row_count == 2


def test_diagnose_command_reads_the_json_of_an_assess(answer, tmp_path):
    source, out = tmp_path / "answer.json", tmp_path / "diagnosis.html"
    source.write_text(json.dumps(answer))
    done = subprocess.run(
        [sys.executable, "-m", "service", "diagnose", str(source), "--out", str(out)],
        cwd=ROOT, capture_output=True, text=True, env=os.environ, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0 and done.stdout.startswith("Diagnosis of unsw\n")
    assert out.read_text().startswith("<!doctype html>")
