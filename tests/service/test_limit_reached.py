"""A machine at its limit is called normal nowhere: contract, list, Zenoh state, metrics, command line, report, page."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from html import unescape
from types import SimpleNamespace

import pypdfium2
import pytest
import service_fakes as fakes
from test_health import get, report_of

from service.report import rendered
from service.report.content import report_of as made_report
from service.report.text import answer_text
from service.runtime.state_publication import StatePublication
from tests.unit.test_status import HEALTHY, life, wear
from twin.assessment import Preliminary

DOUBT = Preliminary(reasons=("the wear rate changed suddenly",), remedies=("measure the wear depth",))
REACHED = replace(HEALTHY, wear=wear(511e-6), life=life(0.0, reached=True))
MACHINES = {
    "worn": REACHED,
    "worn-preliminary": replace(
        HEALTHY,
        wear=replace(wear(511e-6, spread=2.0), preliminary=DOUBT),
        life=replace(life(0.0, reached=True), preliminary=DOUBT),
    ),
    "nearly-worn": replace(HEALTHY, wear=wear(497e-6), life=life(3.0)),  # the limit is within the horizon
    "nearly-worn-preliminary": replace(
        HEALTHY, wear=replace(wear(497e-6), preliminary=DOUBT), life=replace(life(3.0), preliminary=DOUBT)
    ),
}


@pytest.fixture
def shown(store, board):
    for name, found in MACHINES.items():
        for index in range(3):
            fakes.take(store, board, name, index, 6000.0 * (index + 1), report=report_of(found))
    return board


@pytest.mark.parametrize(
    "name", [n if n.startswith("worn") else pytest.param(n, marks=pytest.mark.slow) for n in MACHINES]
)
def test_machine_at_its_limit_is_called_normal_nowhere(name, shown, store):
    listed = next(a for a in get(shown, store, "/v1/assets").json() if a["asset"] == name)
    whole = get(shown, store, f"/v1/assets/{name}").json()
    network = SimpleNamespace(announce=lambda asset: None)
    state = json.loads(StatePublication(network, shown).state_text(name))
    for status in (listed["status"], whole["status"], state["status"]):
        assert status["level"] not in ("normal", "no_verdict") and status["action"] != "No action needed."
    metrics = get(shown, store, "/metrics").text.splitlines()
    assert f'gear_twin_status{{asset="{name}",level="normal"}} 0.0' in metrics

    answer = shown.get(name).whole
    said = answer_text(answer)
    assert "status: normal" not in said.lower() and "no action needed" not in said.lower()
    page = unescape(rendered(made_report(answer), "html").decode())
    document = pypdfium2.PdfDocument(io.BytesIO(rendered(made_report(answer), "pdf")))
    paper = "".join(document[i].get_textpage().get_text_bounded() for i in range(len(document)))
    for text in (page, paper):
        assert "Normal" not in text and "No action needed" not in text
        assert whole["status"]["action"].split(":")[0] in " ".join(text.split())


@pytest.mark.slow
def test_page_calls_no_machine_at_its_limit_normal(shown, open_page):
    page = open_page("/")
    assert "Normal" not in page.inner_text(".fleet") and "normal" not in page.inner_text(".counts")
    for name in MACHINES:
        for view, drawn in (("", "overview"), ("/alarms", "alarms"), ("/life", "life"), ("/data", "data")):
            page.evaluate("hash => { location.hash = hash }", f"#/asset/{name}{view}")
            page.wait_for_selector(f"main[data-view={drawn}]")
            assert "normal" not in page.inner_text("main").lower() and "normal" not in page.title().lower(), (
                name,
                view,
            )
