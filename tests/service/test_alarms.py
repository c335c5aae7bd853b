"""Alarms of the service: one transaction with the window, signed by people, over REST, Zenoh and webhooks."""

from __future__ import annotations

import json
import signal
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import httpx
import pytest
import service_fakes as fakes
from memory_transport import MemoryNetwork
from pytest_httpserver import HTTPServer
from service_streams import Service, write_recording
from sqlalchemy import select
from test_api import Client
from test_health import outcome

from service.alarms.keeper import AlarmKeeper
from service.alarms.rules import DEFAULT_RULES, Rule
from service.api import create_app
from service.contract.base import not_available
from service.results.alarm_store import AlarmStore
from service.results.schema import WINDOWS
from service.results.sql_store import SqlStore
from service.results.window_jobs import WindowJobs
from service.runtime import webhooks
from service.runtime.commits import Commits
from service.runtime.replay import replay
from service.runtime.state_publication import StatePublication
from service.runtime.webhooks import WebhookSender
from service.transport.zenoh import open_session
from tests.unit.test_status import HEALTHY, effect, life, wear
from twin.assessment import Unavailable

WORN = replace(HEALTHY, wear=wear(511e-6), life=life(0.0, reached=True))
NEAR = replace(HEALTHY, wear=wear(420e-6))
CRACKED = replace(HEALTHY, effects=(effect("tooth_crack"),))
ANNA = {"by": "Anna", "note": "oil sample taken"}
HOOK = "/hook"


class Bench:
    """Store, board, network, keeper, sink and REST, as the service puts them together."""

    def __init__(self, path, rules=DEFAULT_RULES, webhooks=()):
        self.store = SqlStore(path)
        self.keeper = AlarmKeeper(AlarmStore(self.store.database), rules, webhooks)
        self.board = fakes.WrittenTable(self.store, self.keeper)
        self.network = MemoryNetwork()
        self.publication = StatePublication(self.network, self.board)
        self.commits = Commits(self.store, self.board, WindowJobs(self.store.database), alarms=self.keeper)
        self.client = Client(create_app(self.board, self.store, alarms=self.keeper))
        self.index = len(self.board.get("unsw").records) if self.board.get("unsw") else 0

    def window(self, found=HEALTHY, quality="good", indicators=None, index=None, set_back_s=0):
        given = outcome(self.index if index is None else index, found, quality)
        given.window.start_time_ns -= set_back_s * 10**9
        if indicators is not None:
            given = replace(given, record={**given.record, "indicators": indicators})
        if isinstance(found.wear, Unavailable):
            given = replace(given, report={**given.report, "wear": not_available(found.wear.reason)})
        fakes.commit(self.commits, given)
        self.publication.publish("unsw")
        self.index = self.board.latest("unsw").windows_total

    def alarms(self, query=""):
        return self.client.get(f"/v1/assets/unsw/alarms{query}").json()

    def sign(self, number, verb, body=ANNA):
        return self.client.call("POST", f"/v1/assets/unsw/alarms/{number}/{verb}", json=body)

    def told(self):
        return [e.data["verb"] for e in self.store.events("unsw", 0) if e.kind == "alarm"]


@pytest.fixture
def bench(where):
    made = Bench(where)
    yield made
    made.store.close()


@pytest.fixture
def receiver():
    with HTTPServer() as server:
        yield server


def received(server):
    return [json.loads(request.get_data()) for request, _ in server.log]


def wait_until(true, seconds=15.0):
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.slow
def test_alarm_is_raised_escalated_ended_and_closed_once_it_is_acknowledged(bench):
    for found in (HEALTHY, NEAR, WORN):
        bench.window(found)
    (alarm,) = bench.alarms()
    assert (alarm["quantity"], alarm["level"], alarm["state"]) == ("depth", "alarm", "active_unacknowledged")
    assert alarm["reason"].endswith("511 µm of 500 µm.") and alarm["action"].startswith("Stop the machine")
    assert alarm["window"] == 1 and alarm["raised_at"] < alarm["history"][-1]["at"]
    bench.window(HEALTHY)
    (returned,) = bench.alarms()
    assert returned["state"] == "returned_unacknowledged" and returned["ended_at"], "stays listed until acknowledged"
    signed = bench.sign(alarm["id"], "acknowledge")
    assert signed.status_code == 200 and signed.json()["state"] == "closed"
    assert signed.json()["acknowledgement"]["by"] == "Anna"
    assert bench.alarms() == [] and len(bench.alarms("?state=all")) == 1
    (closed,) = bench.alarms("?state=all")
    assert [h["verb"] for h in closed["history"]] == ["raised", "escalated", "ended", "acknowledged"]
    assert closed["history"][-1]["note"] == ANNA["note"]
    assert bench.told() == ["raised", "escalated", "ended", "acknowledged"]


def test_windows_that_raise_or_end_an_alarm_stay_when_a_history_is_thinned(bench):
    for found in (HEALTHY, HEALTHY, HEALTHY, NEAR, NEAR, NEAR, HEALTHY, HEALTHY):
        bench.window(found)
    rows = bench.store.database.rows(select(WINDOWS.c.number).where(WINDOWS.c.notable > 0).order_by(WINDOWS.c.number))
    changed = {entry["window"] for entry in bench.alarms()[0]["history"]}
    assert len(changed) == 2 and changed <= {number for (number,) in rows} < set(range(8))


def test_acknowledged_alarm_stays_while_it_is_active_and_is_unacknowledged_again_when_it_escalates(bench):
    bench.window(NEAR)
    number = bench.alarms()[0]["id"]
    bench.sign(number, "acknowledge")
    assert bench.alarms()[0]["state"] == "active_acknowledged"
    bench.window(NEAR)
    assert bench.alarms()[0]["state"] == "active_acknowledged"
    bench.window(WORN)
    assert bench.alarms()[0]["state"] == "active_unacknowledged"
    bench.sign(number, "acknowledge")
    bench.window(HEALTHY)
    assert bench.alarms() == []


def test_alarm_that_returns_before_it_is_acknowledged_is_the_same_alarm(bench):
    for found in (NEAR, HEALTHY, NEAR):
        bench.window(found)
    (alarm,) = bench.alarms()
    assert [h["verb"] for h in alarm["history"]] == ["raised", "ended", "raised"] and alarm["active"]


def test_cleared_alarm_is_raised_again_while_its_cause_lasts(bench):
    bench.window(CRACKED)
    first = bench.alarms()[0]["id"]
    cleared = bench.sign(first, "clear", {"by": "Ben", "note": "gears replaced"})
    assert cleared.json()["state"] == "closed" and cleared.json()["clearance"]["by"] == "Ben"
    assert bench.alarms() == []
    bench.window(CRACKED)
    (again,) = bench.alarms()
    assert again["id"] != first and again["active"]


def test_what_cannot_be_signed_is_refused_with_the_reason(bench):
    bench.window(CRACKED)
    number = bench.alarms()[0]["id"]
    assert bench.sign(number, "acknowledge").status_code == 200
    twice = bench.sign(number, "acknowledge")
    assert twice.status_code == 409 and "acknowledged by Anna" in twice.json()["detail"]
    assert bench.sign(99, "clear").status_code == 404 and "open alarms: 1" in bench.sign(99, "clear").json()["detail"]
    for body in ({"note": "who?"}, {"by": " "}, {"by": "Anna", "colour": "red"}):
        assert bench.sign(number, "clear", body).status_code == 422
    assert bench.client.get("/v1/assets/nobody/alarms").status_code == 404
    bench.sign(number, "clear")
    assert "closed already" in bench.sign(number, "clear").json()["detail"]


def test_alarms_of_all_assets_are_listed_most_urgent_first(bench):
    bench.window(NEAR)
    bench.keeper.window("other", 1, {"index": 0, "quality": "good"}, {**fakes.report(1.0, 1), **status(CRACKED)}, OK)
    assert [(a["asset"], a["level"]) for a in bench.client.get("/v1/alarms").json()] == [
        ("other", "alarm"), ("unsw", "watch")
    ]  # fmt: skip


OK = {"level": "ok", "reason": "the latest window is good"}


def status(found):
    from service.contract.status import status_of

    return {"status": status_of(found).as_json()}


def test_summary_metrics_and_zenoh_carry_the_alarms(bench):
    bench.window(WORN)
    summary = bench.client.get("/v1/assets").json()[0]
    assert summary["alarms"] == {"active": 1, "unacknowledged": 1}
    assert bench.client.get("/v1/assets/unsw").json()["alarms"] == summary["alarms"]
    line = 'gear_twin_alarms{asset="unsw",level="alarm",state="active_unacknowledged"} 1.0'
    assert line in bench.client.get("/metrics").text.splitlines()
    asset, text = bench.network.alarms[-1]
    assert asset == "unsw" and json.loads(text)["alarms"][0]["quantity"] == "depth"
    count = len(bench.network.alarms)
    bench.window(WORN)
    assert len(bench.network.alarms) == count, "published only where they are others than before"


LITTLE = replace(HEALTHY, wear=Unavailable(reason="no module given"), life=Unavailable(reason="no module given"))


def levels(rms, kurtosis=3.0):
    return {"a1": {"rms": rms, "kurtosis": kurtosis, "crest_factor": 4.0}}


def test_learned_level_raises_an_alarm_that_is_part_of_the_status_and_says_how_far_it_has_learned(bench):
    for index in range(9):
        bench.window(LITTLE, indicators=levels(2.0 + 0.01 * (index % 3)))
    learning = bench.client.get("/v1/assets/unsw/alarm-rules").json()["learning"]
    assert {(p["rule"], p["text"]) for p in learning} == {
        ("rms", "learning: 9 of 10 windows"), ("kurtosis", "learning: 9 of 10 windows")
    }  # fmt: skip
    bench.window(LITTLE, indicators=levels(2.0))
    learned = bench.client.get("/v1/assets/unsw/alarm-rules").json()["learning"][0]
    assert "learned from 10 windows; at most 0.001 of healthy windows" in learned["text"]
    for _ in range(3):
        assert bench.alarms() == []
        bench.window(LITTLE, indicators=levels(9.0))
    (alarm,) = bench.alarms()
    assert (alarm["quantity"], alarm["place"], alarm["level"]) == ("rms", "a1", "alarm")
    status = bench.board.get("unsw").whole["status"]
    assert status["level"] == "alarm" and status["reasons"][0] == alarm["reason"]
    assert "learned from the first 10 windows" in alarm["reason"]
    last = [e.data for e in bench.store.events("unsw", 0) if e.kind == "status"][-1]
    assert (last["before"], last["level"]) == ("no_verdict", "alarm")
    bench.sign(alarm["id"], "clear")
    assert bench.board.get("unsw").whole["status"]["level"] == "no_verdict"


def test_rules_of_an_asset_are_set_by_name_and_followed(bench):
    body = {
        "by": "Anna",
        "note": "as agreed",
        "rules": [{"name": "deep", "quantity": "depth", "watch": 50, "alarm": 90}],
    }
    answer = bench.client.call("PUT", "/v1/assets/unsw/alarm-rules", json=body)
    assert answer.status_code == 404, "the asset must be known"
    bench.window(NEAR)
    assert bench.client.call("PUT", "/v1/assets/unsw/alarm-rules", json=body).json()["own"] is True
    said = bench.client.get("/v1/assets/unsw/alarm-rules").json()
    assert (said["by"], said["note"], [r["name"] for r in said["rules"]]) == ("Anna", "as agreed", ["deep"])
    bench.window(NEAR)
    assert {(a["rule"], a["state"]) for a in bench.alarms()} == {
        ("depth", "returned_unacknowledged"), ("deep", "active_unacknowledged")
    }  # fmt: skip
    oil = {"name": "x", "quantity": "temperature", "watch": 70}
    for wrong, code, said in (
        ({"rules": []}, 422, "body.by"),
        ({"by": "Anna", "rules": [{"name": "x", "quantity": "noise"}]}, 422, "'noise' is not known"),
        ({"by": "Anna", "rules": [{**oil, "alarm": 60}]}, 409, "rule.0: alarm = 60 must lie beyond watch = 70"),
        ({"by": "Anna", "rules": [oil, oil]}, 409, "more than one rule is called x"),
    ):
        refused = bench.client.call("PUT", "/v1/assets/unsw/alarm-rules", json=wrong)
        assert refused.status_code == code and said in refused.json()["detail"]


def test_alarm_of_a_rule_that_watches_another_quantity_is_named_by_that(bench):
    indicators = {"a1": {"rms": 25.0, "kurtosis": 7.0}}
    for quantity, limit in (("rms", 10.0), ("kurtosis", 6.0)):
        bench.keeper.set_rules("unsw", [Rule(name="level", quantity=quantity, watch=limit)], "Anna", "")
        bench.window(LITTLE, indicators=indicators)
    (alarm,) = bench.alarms()
    assert (alarm["quantity"], alarm["value"], alarm["active"]) == ("kurtosis", 7.0, True)
    assert bench.told() == ["raised", "ended", "raised"]


def test_window_that_was_committed_before_changes_no_alarm(bench):
    bench.window(NEAR)
    bench.window(WORN, index=0)
    (alarm,) = bench.alarms()
    assert alarm["level"] == "watch" and bench.told() == ["raised"]


def test_alarms_go_on_after_the_clock_of_the_stream_was_set_back(bench):
    bench.window(HEALTHY)
    for found in (NEAR, WORN, HEALTHY):
        bench.window(found, set_back_s=36_000)
    assert bench.told() == ["raised", "escalated", "ended"]


def test_window_and_alarm_are_kept_together_or_not_at_all(where, monkeypatch):
    bench = Bench(where, webhooks=["http://127.0.0.1:9/"])
    bench.window(HEALTHY)

    def killed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(bench.store, "note", killed)
    with pytest.raises(KeyboardInterrupt):
        bench.window(WORN)
    monkeypatch.undo()
    bench.store.close()
    again = Bench(where, webhooks=["http://127.0.0.1:9/"])
    assert again.store.asset("unsw").windows == 1 and again.alarms() == [] and again.keeper.store.waiting() == 0
    again.window(WORN)
    assert again.told() == ["raised"] and again.keeper.store.waiting() == 1
    again.store.close()
    third = Bench(where)
    assert third.alarms()[0]["quantity"] == "depth", "a restart keeps the alarms"
    third.window(WORN)
    assert third.told() == ["raised"]
    third.store.close()


# -- as a process --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_killed_service_keeps_its_alarms_and_delivers_each_message_under_one_id(tmp_path, receiver):
    receiver.expect_request(HOOK).respond_with_data("", status=503)
    rules = tmp_path / "rules.toml"
    rules.write_text('[[rule]]\nname = "depth"\nquantity = "depth"\nwatch = 40\nalarm = 80\n')
    recording = write_recording(tmp_path / "campaign.mcap")
    hooks = json.dumps([receiver.url_for(HOOK)])
    running = Service(tmp_path / "data", slow=0.2, ALARM_RULES=str(rules), WEBHOOKS=hooks).start()
    threading.Thread(target=_ignoring, args=(replay, recording, [running.endpoint], 0), daemon=True).start()
    try:
        running.wait_for_windows(5)
        wait_until(lambda: receiver.log)
    finally:
        running.end(signal.SIGKILL)
    receiver.clear_all_handlers()
    receiver.expect_request(HOOK).respond_with_data("")
    running.slow = 0.0
    try:
        running.start()
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(8)
        (alarm,) = running.get("/v1/alarms")
        assert [h["verb"] for h in alarm["history"]] == ["raised", "escalated"]
        with open_session(connect=[running.endpoint]) as session:
            (reply,) = session.get("gearbox/unsw/twin/alarms", timeout=10.0)
            assert json.loads(reply.ok.payload.to_string())["alarms"][0]["id"] == alarm["id"]
            assert len(list(session.get("gearbox/*/twin/*", timeout=10.0))) == 2, "state and alarms, once each"
        wait_until(lambda: "gear_twin_webhooks_waiting 0.0" in running.text("/metrics"), 40.0)
        ids = {}
        for message in received(receiver):
            ids.setdefault(message["verb"], set()).add(message["id"])
        assert {verb: len(found) for verb, found in ids.items()} == {"raised": 1, "escalated": 1}
    finally:
        running.end(signal.SIGKILL)


def _ignoring(call, *given):
    try:
        call(*given)
    except Exception as error:  # the service is killed under it
        assert error is not None


# -- webhooks ------------------------------------------------------------------------------------------------


def test_every_change_is_sent_to_every_address_in_order(tmp_path, receiver):
    receiver.expect_request(HOOK).respond_with_data("")
    bench = Bench(tmp_path / "twin.sqlite", webhooks=[receiver.url_for(HOOK)])
    for found in (NEAR, WORN, HEALTHY):
        bench.window(found)
    sender = WebhookSender(bench.keeper.store, bench.keeper.waiting)
    with httpx.Client() as client:
        while sender.turn(lambda: client):
            pass
    told = received(receiver)
    assert [t["verb"] for t in told] == ["raised", "escalated", "ended"]
    assert told[1]["alarm"]["action"].startswith("Stop the machine") and told[0]["asset"] == "unsw"
    assert len({t["id"] for t in told}) == 3 and bench.keeper.store.waiting() == 0
    assert receiver.log[0][0].headers["Idempotency-Key"] == told[0]["id"]
    assert sender.figures()["webhooks_delivered"] == 3
    bench.store.close()


def test_message_waits_for_an_address_that_is_down_and_is_sent_by_the_next_start(tmp_path, receiver):
    receiver.expect_request(HOOK).respond_with_data("", status=503)
    bench = Bench(tmp_path / "twin.sqlite", webhooks=[receiver.url_for(HOOK)])
    bench.window(WORN)
    sender = WebhookSender(bench.keeper.store, bench.keeper.waiting, first_pause=0.0)
    with httpx.Client() as client:
        assert not sender.turn(lambda: client)
    assert sender.figures()["webhook_failures"] == 1 and bench.keeper.store.waiting() == 1
    tried = {t["id"] for t in received(receiver)}
    bench.store.close()
    receiver.clear()
    receiver.expect_request(HOOK).respond_with_data("")
    again = Bench(tmp_path / "twin.sqlite")
    sender = WebhookSender(again.keeper.store, again.keeper.waiting)
    sender.start()
    wait_until(lambda: again.keeper.store.waiting() == 0)
    sender.end()
    assert {t["id"] for t in received(receiver)} == tried and len(tried) == 1, "the same id, however often it is sent"
    again.store.close()


@pytest.mark.slow
def test_address_that_hangs_holds_up_neither_windows_nor_the_end(tmp_path, receiver):
    hanging = threading.Event()
    receiver.expect_request(HOOK).respond_with_handler(lambda request: hanging.wait(300) and None)
    bench = Bench(tmp_path / "twin.sqlite", webhooks=[receiver.url_for(HOOK)])
    sender = WebhookSender(bench.keeper.store, bench.keeper.waiting)
    sender.start()
    begun = time.monotonic()
    for found in (WORN, HEALTHY, WORN):
        bench.window(found)
    sender.end()
    assert time.monotonic() - begun < 150 and bench.keeper.store.waiting() == 3
    hanging.set()
    bench.store.close()


def test_message_that_cannot_be_delivered_for_days_is_given_up_and_counted(tmp_path):
    now = [1_700_000_000 * 10**9]
    bench = Bench(tmp_path / "twin.sqlite")
    bench.keeper.store.enqueue("unsw", "http://127.0.0.1:1/", {"kind": "alarm"}, now[0])
    sender = WebhookSender(bench.keeper.store, bench.keeper.waiting, clock=lambda: now[0])
    with httpx.Client() as client:
        sender.turn(lambda: client)
        assert bench.keeper.store.due(now[0]) == [], "not again at once"
        now[0] += 4 * 86_400 * 10**9
        sender.turn(lambda: client)
    assert sender.figures()["webhooks_given_up"] == 1 and bench.keeper.store.waiting() == 0
    bench.store.close()


@pytest.mark.slow
def test_a_message_that_is_announced_before_it_is_there_is_sent_soon_and_an_empty_outbox_is_asked_seldom(monkeypatch):
    """It is announced within the transaction that keeps it."""
    for name, seconds in (("LOOK_EVERY", 0.02), ("SAID", 0.5), ("LOOK_SELDOM", 60.0)):
        monkeypatch.setattr(webhooks, name, seconds)
    looks, there = [], []
    store = SimpleNamespace(due=lambda now: looks.append(list(there)) or [], waiting=lambda: len(there))
    announced = threading.Event()
    sender = WebhookSender(store, announced)
    sender.start()
    try:
        wait_until(lambda: len(looks) > 3)
        time.sleep(1.5)
        count = len(looks)
        time.sleep(0.5)
        assert len(looks) == count  # nothing waits, and nobody has said otherwise
        announced.set()
        wait_until(lambda: len(looks) > count)
        there.append("committed")
        wait_until(lambda: looks[-1] == there, 5.0)
    finally:
        sender.end()


def test_rule_names_of_the_defaults_are_unique_and_each_quantity_is_known():
    assert len({rule.name for rule in DEFAULT_RULES}) == len(DEFAULT_RULES)
    assert all(isinstance(rule, Rule) for rule in DEFAULT_RULES)
