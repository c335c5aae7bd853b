"""The report for people: what it says, one page that needs nothing else, two pages of PDF."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

import httpx
import pypdfium2
import pytest
import service_fakes as fakes

from service.cli import run
from service.json_text import plain
from service.printable import printable
from service.report import rendered
from service.report.content import report_of
from service.report.text import answer_text
from service.report.trends import trends

MADE = datetime(2026, 3, 1, 12, 30, tzinfo=UTC)
MISSING = {"status": "not available", "reason": "the rig file gives no bearings"}


@pytest.fixture
def answer(store, board):
    """A machine past its end of life, by the service's own answer."""
    fakes.campaign(store, board)
    return plain(board.get("unsw").whole)


def pdf_text(data: bytes) -> list[str]:
    document = pypdfium2.PdfDocument(data)
    return [page.get_textpage().get_text_range() for page in document]


def test_the_page_leads_with_the_state_and_needs_nothing_else(answer):
    answer["status"] = {"level": "end_of_life", "reasons": ["511 µm of 500 µm."], "action": "Stop the machine."}
    page = rendered(report_of(answer, made=MADE), "html").decode()
    text = re.sub(r"<[^>]+>", " ", page)
    assert text.index("Stop") < text.index("511 µm of 500 µm") < text.index("Wear depth") < text.index("Appendix")
    assert "Stop the machine." in text and "2026-03-01 12:30 UTC" in text
    assert not re.search(r"(src|href)=|@import|<script", page.replace("xlink:href", ""))
    assert page.count("<svg") == 2 and 'role="img" aria-label="Wear depth from' in page


def test_the_pdf_has_two_pages_whatever_there_is_to_say(answer):
    answer["status"]["reasons"] = ["A sentence about something that was found in this gearbox. " * 4] * 5
    answer["effects"] = [
        {
            "name": "misalignment", "status": "found", "onset_revolutions": 4000.0,
            "parameters": {"lead_gap": {"value": 4e-5, "unit": "m", "std": 4e-6}},
            "evidence": {"log_evidence": 344.0, "runner_up": "mesh_stiffness_loss", "over_runner_up": 134.0},
            "error_before": {"waveform_percent": 32.3}, "error_after": {"waveform_percent": 14.0},
            "wear_depth_um_before": 32.9, "wear_depth_um_after": 27.1,
        }
    ] * 9  # fmt: skip
    first, second = pdf_text(rendered(report_of(answer, made=MADE), "pdf"))
    assert "page 1 of 2" in first and "page 2 of 2" in second
    assert "Lead gap 40 ± 4 µm; since 4,000 revolutions." in " ".join(first.split())
    assert "Data quality" in second and "Latest measurements" in second


def test_the_report_says_what_could_have_been_found_in_the_words_of_the_command(answer):
    said = ["What 6 windows would have shown, where nothing was found:", "tooth crack: stiffness loss from 0.3 (basis)"]
    answer["detectable"] = {"said": said}
    assert report_of(answer).limits[-2:] == tuple(said) and "\n".join(said) in answer_text(answer)


def test_a_count_has_no_spread_and_a_share_is_in_percent(answer):
    sizes = {
        "stiffness_loss": {"value": 0.532, "unit": "", "std": 0.044},
        "tooth": {"value": 9.0, "unit": "", "std": 1e-129},
    }
    effect = {"name": "tooth_crack", "parameters": sizes, "evidence": {}, "onset_revolutions": 0.0}
    (found,) = report_of({**answer, "effects": [effect]}).findings
    assert found.sentences[0].startswith("Stiffness loss 53.2 ± 4.4 %, tooth 9; present")


def test_an_effect_is_said_with_size_onset_sureness_and_consequence(answer):
    effect = {
        "name": "misalignment", "status": "pinned", "onset_revolutions": 0.0,
        "parameters": {"lead_gap": {"value": 4e-5, "unit": "m", "std": None}},
        "evidence": {"log_evidence": 12.0, "indistinguishable_from": ["mesh_stiffness_loss"]},
        "error_before": {"transmission_error_percent": 99.4, "waveform_percent": 27.1},
        "error_after": {"transmission_error_percent": 1.07, "waveform_percent": 32.3},
        "wear_depth_um_before": 32.9, "wear_depth_um_after": 32.9,
    }  # fmt: skip
    (found,) = report_of({**answer, "effects": [effect]}).findings
    said = " ".join(found.sentences)
    assert "present from the first measurement on" in said
    assert "cannot distinguish it from: loss of mesh stiffness" in said
    assert "transmission error 99.4 → 1.1 %, vibration waveform 27.1 → 32.3 %" in said  # also where it becomes worse
    assert "An engineer has pinned this effect." in said and "changes the wear depth" not in said


def test_what_is_not_available_or_preliminary_is_said_once_with_its_cure(answer):
    preliminary = {"reasons": ["the wear coefficient is a prior"], "remedies": ["a run at 2 Hz on unworn gears"]}
    answer["wear"]["preliminary"] = answer["rul"]["preliminary"] = preliminary
    answer["residual"] = answer["calibration"] = MISSING
    report = report_of(answer)
    assert [line for line in report.limits if line.startswith("Not available")] == [
        "Not available: residual, calibration. The rig file gives no bearings."
    ]
    assert report.limits.count("What would settle it: A run at 2 Hz on unworn gears.") == 1
    assert all(
        detail.startswith("Preliminary. ") for name, _, detail in report.figures if name != "Vibration level (RMS)"
    )


def test_a_machine_without_a_model_has_a_report_too(answer):
    answer |= {"wear": MISSING, "rul": MISSING, "residual": MISSING, "calibration": MISSING, "effects": []}
    for record in answer["windows"]:
        for key in ("wear_depth_um", "rms_predicted", "rms_after", "error_percent"):
            record.pop(key, None)
    report = report_of(answer)
    assert [name for name, *_ in report.figures] == ["Vibration level (RMS)"] and report.limit_um is None
    assert rendered(report, "html").count(b"<svg") == 1 and len(pdf_text(rendered(report, "pdf"))) == 2


@pytest.mark.slow
def test_rest_gives_both_formats_and_names_the_file(address, store, board):
    fakes.campaign(store, board)
    with httpx.Client(base_url=address, timeout=60) as client:
        page = client.get("/v1/assets/unsw/report")
        assert page.status_code == 200 and page.headers["content-type"].startswith("text/html")
        file = client.get("/v1/assets/unsw/report?format=pdf")
        assert file.content.startswith(b"%PDF") and "unsw-13.pdf" in file.headers["content-disposition"]
        assert "500 µm" in pdf_text(file.content)[1]  # the machine's limit, from its rig file
        assert client.get("/v1/assets/unsw/report?format=doc").status_code == 422
        assert client.get("/v1/assets/other/report").status_code == 404


@pytest.mark.slow
def test_the_command_writes_both_formats_and_refuses_others(capsys, tmp_path, answer):
    source = tmp_path / "answer.json"
    source.write_text(json.dumps(answer))
    given = [str(tmp_path / "report.html"), str(tmp_path / "report.pdf")]
    assert run(["report", str(source), "--out", given[0], "--out", given[1]]) == 0
    assert capsys.readouterr().out == ""
    assert Path(given[0]).read_text().startswith("<!doctype html>") and Path(given[1]).read_bytes()[:4] == b"%PDF"
    assert run(["report", str(source), "--out", str(tmp_path / "report.docx")]) == 2
    assert "report.docx: a report is written as .html or .pdf" in capsys.readouterr().err


@pytest.mark.slow
def test_the_trends_have_tick_labels_and_units_on_both_axes_and_the_limit(answer):
    answer["rul"] = {**answer["rul"], "limit_um": 500.0}
    report = report_of(answer, made=MADE)
    assert report.limit_um == 500.0
    for (said, figure), unit in zip(trends(report), ("[µm]", "[m/s²]"), strict=True):
        (axes,) = figure.axes
        figure.canvas.draw()
        for axis in (axes.xaxis, axes.yaxis):
            labels = [t.get_text() for t in axis.get_ticklabels() if t.get_text()]
            assert len(labels) >= 3, (said, labels)
        assert unit in axes.get_ylabel() and "revolutions" in axes.get_xlabel()
    depth = trends(report)[0][1].axes[0]
    assert any("limit 500 µm" in text.get_text() for text in depth.get_legend().get_texts())


@pytest.mark.parametrize(
    "name", ["<script>alert(1)</script>", "a & b <i", "\x1b[2Jx", 'q"onload="x', "%s {0} \\input{a} $x$ #", "a\u202eb"]
)
def test_what_others_wrote_is_text_in_the_report_and_nothing_else(answer, name):
    plain = Tags(rendered(report_of(answer, made=MADE), "html").decode()).tags
    pages = len(pdf_text(rendered(report_of(answer, made=MADE), "pdf")))
    answer["status"] = {**answer["status"], "reasons": [f"reason {name}", *answer["status"]["reasons"][1:]]}
    shown = Tags(rendered(report_of({**answer, "asset": name}, made=MADE), "html").decode())
    assert shown.tags == plain and shown.text.count(printable(name)) >= 3
    text = pdf_text(rendered(report_of({**answer, "asset": name}, made=MADE), "pdf"))
    assert len(text) == pages and printable(name).split()[0] in text[0]


class Tags(HTMLParser):
    """The tags and the text of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, *(name for name, _ in attrs)))

    def handle_data(self, data):
        self.text += data
