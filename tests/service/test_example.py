"""`gear-twin example misalignment`: text, JSON and page of the published study, here on a coarse grid."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

import studies.misalignment.study
from service.cli import run
from studies.misalignment.dabrowski_2012 import ESTIMATES


@pytest.fixture(scope="module")
def found():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(studies.misalignment.study, "ESTIMATES", ESTIMATES[:2])
        return studies.misalignment.study.study(fine=(96, 3), coarse=(96, 3), draws=1)


@pytest.fixture
def coarse(monkeypatch, found):
    monkeypatch.setattr(studies.misalignment.study, "study", lambda progress, draws: found)


@pytest.mark.slow
def test_the_example_prints_its_table_and_writes_page_and_numbers(capsys, coarse, tmp_path):
    out, numbers = tmp_path / "page.html", tmp_path / "numbers.json"
    assert run(["example", "misalignment", "--out", str(out), "--json", str(numbers), "--draws", "1"]) == 0
    captured = capsys.readouterr()
    assert captured.err == f"gear-twin: figures written to {out}\n"
    for said in (
        "experiment, about",
        "rigid (authors' model)",
        "sidebands",
        "estimated",
        "1 sets",
        "reading of K",
        "reading of 'vertical'",
        "Harmonics 2–4 rise by more than harmonic 1",
    ):
        assert said in captured.out, said
    answer = json.loads(numbers.read_text())
    assert {r["compliant"] for r in answer["rises"]} == {"rigid", "bearings", "shafts", "both", "teeth", "all"}
    assert len([r for r in answer["rises"] if (r["compliant"], r["tilt"]) == ("rigid", "normal")]) == 4
    assert all(e["reason"] and e["low"] < e["high"] for e in answer["estimated"])
    assert len(answer["draws"]) == 1 and len(answer["sensitivities"]) == 6
    page = out.read_text()
    assert page.count("plotly-graph-div") == 10 and "http" not in page.partition("<script")[0]
    for title in (
        "sets of estimates",
        "The same band by band",
        "nominal estimates",
        "Vertical force",
        "Spectrum of the force",
        "Lines about the second",
        "GMF5",
    ):
        assert title in page, title


@pytest.mark.slow
def test_the_example_prints_its_numbers_alone_where_asked(capsys, coarse):
    assert run(["example", "misalignment", "--json", "-"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["experiment_rise_percent"] == {"400 rpm": 20.0, "800 rpm": 30.0}
    assert {r["reference_state"] for r in answer["relative_to_a_misaligned_state"]} == {"tilt 0.1°", "tilt 0.2°"}


@pytest.mark.slow
def test_without_draws_it_says_that_its_figures_are_those_of_the_nominal_estimates(capsys, monkeypatch, found):
    monkeypatch.setattr(
        studies.misalignment.study, "study", lambda progress, draws: replace(found, draws=found.draws[:draws])
    )
    assert run(["example", "misalignment", "--draws", "0"]) == 0
    said = capsys.readouterr().out
    assert said.split("\n\n")[1].startswith("at the nominal estimates") and "drawn" not in said


def test_an_example_that_is_not_there_and_a_wrong_number_are_refused(capsys):
    assert run(["example", "unknown"]) == 2
    assert run(["example", "misalignment", "--draws", "-1"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 2
