"""Health is never shown as `normal` where a limit is reached or a fault is found: in the contract and wherever it goes.

The three machines are those that once showed a green "ok": worn past the end of life, with two effects, with a broken
tooth.
"""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from html import unescape
from types import SimpleNamespace

import httpx
import pytest
import service_fakes as fakes

from service.api import create_app
from service.contract.answer import assemble
from service.contract.status import status_of
from service.report import rendered
from service.report.content import report_of as made_report
from service.report.text import answer_text
from service.results.window_jobs import WindowJobs
from service.runtime.commits import Commits
from service.runtime.outcomes import Outcome
from service.runtime.state_publication import StatePublication
from tests.unit.test_status import HEALTHY, effect, life, wear
from twin.assessment import Unavailable

WORN = replace(HEALTHY, wear=wear(511e-6), life=life(0.0, reached=True))
TWO_EFFECTS = replace(HEALTHY, effects=(effect("gear_eccentricity"), effect("misalignment")))
BROKEN_TOOTH = replace(
    HEALTHY,
    wear=Unavailable(reason="no module given"),
    life=Unavailable(reason="no module given"),
    effects=(effect("tooth_crack", ("a4",)),),
)
MACHINES = {"worn": (WORN, "end_of_life"), "two-effects": (TWO_EFFECTS, "watch"), "broken": (BROKEN_TOOTH, "alarm")}
FIRST = "Stop the machine and replace the gear pair: 511 µm of 500 µm."


def report_of(found):
    return {**fakes.report(18_000.0, 14), "status": status_of(found).as_json()}


@pytest.fixture
def shown(store, board):
    for name, (found, _) in MACHINES.items():
        for index in range(3):
            fakes.take(store, board, name, index, 6000.0 * index, report=report_of(found))
    return board


def get(board, store, url):
    async def once():
        transport = httpx.ASGITransport(app=create_app(board, store), raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://twin") as client:
            return await client.get(url)

    return asyncio.run(once())


@pytest.mark.parametrize("name", MACHINES)
def test_contract_list_and_zenoh_state_give_the_level_and_what_to_do(name, shown, store):
    level = MACHINES[name][1]
    listed = next(a for a in get(shown, store, "/v1/assets").json() if a["asset"] == name)
    whole = get(shown, store, f"/v1/assets/{name}").json()
    network = SimpleNamespace(announce=lambda asset: None)
    state = json.loads(StatePublication(network, shown).state_text(name))
    for status in (listed["status"], whole["status"], state["status"]):
        assert status["level"] == level
        assert status["action"].endswith(".") and status["action"] != "No action needed."
        assert status["findings"][0]["level"] == level
    assert listed["data"] == "ok" and whole["data"]["level"] == "ok" and state["data"] == whole["data"]


@pytest.mark.parametrize("name", MACHINES)
def test_metrics_have_one_at_the_level_and_zero_elsewhere(name, shown, store):
    lines = get(shown, store, "/metrics").text.splitlines()
    status = {line for line in lines if line.startswith(f'gear_twin_status{{asset="{name}"')}
    assert len(status) == 5
    assert {line for line in status if line.endswith(" 1.0")} == {
        f'gear_twin_status{{asset="{name}",level="{MACHINES[name][1]}"}} 1.0'
    }
    assert f'gear_twin_data{{asset="{name}",level="ok"}} 1.0' in lines


@pytest.mark.parametrize("name", MACHINES)
def test_command_line_and_report_say_health_action_and_data_apart(name, shown):
    answer = shown.get(name).whole
    level = MACHINES[name][1].replace("_", " ")
    text = answer_text(answer)
    assert f"Status: {level}." in text and "Data: ok: the latest window is good" in text
    assert "Action: " in text and "Status: normal" not in text
    report = made_report(answer)
    page = rendered(report, "html").decode()
    assert report.level == MACHINES[name][1] and report.action == answer["status"]["action"] in unescape(page)
    assert report.data == "ok: the latest window is good" in page and "Normal" not in page


def test_action_of_a_worn_pair_is_to_stop_and_replace_it_with_the_depth_and_its_limit(shown):
    status = shown.get("worn").whole["status"]
    assert status["action"] == FIRST and "511 µm of 500 µm" in status["reasons"][0]


def test_assess_gives_the_same_words_for_the_data():
    answer = assemble("unsw", [{"index": 0, "quality": "refused", "reason": "no torque"}], report_of(HEALTHY), {})
    assert answer["data"] == {"level": "degraded", "reason": "the latest window is refused: no torque", "since": None}
    assert answer["status"]["level"] == "no_verdict"


# -- the event -----------------------------------------------------------------------------------------------


def outcome(index, found, quality="good"):
    window = SimpleNamespace(start_time_ns=fakes.START_NS + index * 600_000_000_000)
    record = {**fakes.record(index, 100.0 * index), "quality": quality, "faults": []}
    report = report_of(found)
    return Outcome(
        asset="unsw", index=index, window=window, record=record, state=SimpleNamespace(to_dict=dict),
        report=report, events=(("window", record),), 
    )  # fmt: skip


def test_change_of_level_is_an_event_that_is_committed_with_its_window(store):
    board = fakes.WrittenTable(store)
    commits = Commits(store, board, WindowJobs(store.database))
    for index, found in enumerate([HEALTHY, HEALTHY, TWO_EFFECTS, TWO_EFFECTS, WORN]):
        fakes.commit(commits, outcome(index, found))
    told = [e.data for e in store.events("unsw", 0) if e.kind == "status"]
    assert [(t["before"], t["level"]) for t in told] == [
        ("no_verdict", "normal"), ("normal", "watch"), ("watch", "end_of_life")
    ]  # fmt: skip
    assert told[-1]["action"] == FIRST and told[-1]["data"]["level"] == "ok"
    fakes.commit(commits, outcome(5, WORN, "degraded"))
    last = store.events("unsw", 0)[-1]
    assert (last.kind, last.data["before"], last.data["data"]["level"]) == ("status", "end_of_life", "degraded")
