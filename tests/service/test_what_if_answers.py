"""`gear-twin what-if` and POST what-if: dates, calendars, refusals."""

from __future__ import annotations

import json
from datetime import datetime, timedelta

import pytest
import service_fakes as fakes
from test_api import Client

from benchmarks.scoring import run as run_windows
from benchmarks.scoring import windows_of
from service.api import create_app
from service.cli import run
from service.cli.answers import what_if_text
from service.contract.estimate import step
from service.contract.what_if import WhatIfIn
from service.contract.what_if_answer import answer
from service.results.sql_store import SqlStore
from tests.documentation import ROOT
from twin.options import Options

RECORDING = ROOT / "recordings" / "short-campaign.mcap"
ASSET = "unsw-short"


def assess_into(store, board):
    """The short campaign, without effects, as a service has it after its last window."""
    rig, windows = windows_of(RECORDING)
    state, _ = run_windows(rig, windows[:-1], Options(trace=False))
    state, estimate = step(rig, state, windows[-1], Options(trace=False))
    store.commit(
        ASSET, windows[-1].start_time_ns, record=estimate.record, state=state.to_dict(), report=estimate.report,
        received_ns=1,
    )  # fmt: skip
    board.update(ASSET, rig=dict(rig.values), report=estimate.report)


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    """A service's answers over a store with the short campaign in it."""
    with SqlStore(tmp_path_factory.mktemp("store") / "gear-twin.sqlite") as store:
        board = fakes.WrittenTable(store)
        assess_into(store, board)
        yield Client(create_app(board, store))


def ask(client, status=200, **body):
    reply = client.call("POST", f"/v1/assets/{ASSET}/what-if", json=body)
    assert reply.status_code == status, reply.text
    return reply.json()


@pytest.mark.slow
def test_present_duty_answers_with_the_stated_life(client):
    found = ask(client)
    assert found["hours"]["median"] == pytest.approx(found["present_hours"]["median"])
    assert found["date"]["status"] == "not available" and "hours_per_day" in found["date"]["reason"]
    assert len(found["survival"]["hours"]) == len(found["survival"]["probability"]) > 20
    assert found["target"] is None and found["notes"] == []


def test_dates_follow_from_the_running_time_per_day(client):
    found = ask(client, hours_per_day=2.0)
    since = datetime.fromisoformat(found["since"][:19])
    ahead = datetime.fromisoformat(found["date"]["median"][:19]) - since
    assert ahead == pytest.approx(timedelta(days=found["hours"]["median"] / 2.0), abs=timedelta(seconds=2))
    assert found["running"] == {"hours_per_day": 2.0, "source": "request"}
    until = (since + ahead).isoformat() + "+00:00"
    target = ask(client, hours_per_day=2.0, until=until)["target"]
    assert target["probability"] == pytest.approx(0.5, abs=0.01)
    assert target["hours"] == pytest.approx(found["hours"]["median"], rel=1e-3)


def test_probability_falls_with_the_hours_asked_for(client):
    median = ask(client)["hours"]["median"]
    chances = [ask(client, hours=factor * median)["target"]["probability"] for factor in (0.5, 1.0, 2.0)]
    assert chances[0] > 0.99 > chances[1] == pytest.approx(0.5, abs=1e-3) and chances[2] < 0.01


def test_calendar_of_the_present_duty_changes_nothing(client):
    present = {"speed_hz": 10.0, "torque_nm": 10.0}
    calendar = [{"duty": [present], "hours": 0.1}, {"duty": [{**present, "torque_nm": 10.1}]}]
    assert ask(client, calendar=calendar)["hours"]["median"] == pytest.approx(ask(client)["hours"]["median"], rel=0.01)


POINT = {"speed_hz": 10.0, "torque_nm": 10.0}
REFUSED = [
    ({"duty": [POINT, POINT]}, 422, "shares"),
    ({"duty": [{**POINT, "share": 0.4}, {**POINT, "share": 0.4}]}, 422, "add up to 0.8"),
    ({"duty": [POINT], "calendar": [{"duty": [POINT]}]}, 422, "not both"),
    ({"until": "2100-01-01T00:00:00Z"}, 409, "hours_per_day"),
    ({"until": "1999-01-01T00:00:00Z", "hours_per_day": 8}, 422, "before the latest window"),
    ({"calendar": [{"duty": [POINT], "hours": 3}]}, 422, "last phase"),
    ({"calendar": [{"duty": [POINT]}, {"duty": [POINT]}]}, 422, "needs `hours` or `until`"),
    ({"duty": [{"speed_hz": 10.0, "torque_nm": 900.0}]}, 409, "times the largest"),
    ({"duty": [{"speed_hz": -1.0, "torque_nm": 10.0}]}, 422, "speed_hz"),
    ({"duties": []}, 422, "duties"),
    ({"max_depth_um": 600.0}, 422, "end of life"),
]


@pytest.mark.parametrize(("body", "status", "why"), REFUSED)
def test_question_that_cannot_be_answered_is_refused_with_its_reason(client, body, status, why):
    assert why in json.dumps(ask(client, status, **body))


def test_asset_that_is_not_known_is_a_404(client):
    assert client.call("POST", "/v1/assets/none/what-if", json={}).status_code == 404


def test_preliminary_life_is_said_in_answer_and_text():
    rig, windows = windows_of(RECORDING)
    state, _ = run_windows(rig, windows[:4], Options(trace=False))
    assert state.latest.life.preliminary is not None  # of one worn window
    found = answer(ASSET, rig, state, WhatIfIn(hours=1.0))
    (reason,) = found["preliminary"]["reasons"]
    assert "the wear rate rests on 1 of at least 3 worn windows" in reason
    said = what_if_text(found)
    assert f"  preliminary: {reason}" in said and "  to settle it: record 2 more windows at this speed" in said


@pytest.mark.slow
def test_command_answers_from_a_recording(capsys):
    asked = ["what-if", str(RECORDING), "--no-trace", "--duty", "10,10", "--hours", "1", "--hours-per-day", "8"]
    assert run(asked) == 0
    out = capsys.readouterr().out
    assert "life to 500 µm under this duty" in out and "h of operation" in out
    assert "probability of reaching 1 h" in out and "at 8 h a day (request)" in out
    assert run([*asked, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["asset"] == ASSET


@pytest.mark.slow
@pytest.mark.parametrize(
    ("given", "why"),
    [
        (["--duty", "10;12"], "must be SPEED_HZ,TORQUE_NM"),
        (["--until", "2100-01-01"], "hours_per_day"),
        (["--until", "soon"], "until"),
        (["--hours", "-3"], "hours"),
    ],
)
def test_command_refuses_what_cannot_be(capsys, given, why):
    assert run(["what-if", str(RECORDING), "--no-trace", *given]) == 2
    assert why in capsys.readouterr().err
