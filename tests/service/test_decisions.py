"""Decisions on effects: kept when they are taken in, carried out once, refused with a reason."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import pytest
import service_fakes as fakes
from service_streams import Service, service, wait_until, write_recording

import gear_twin
from service.cli import run
from service.contract.estimate import Estimate
from service.runtime.computing import Ask, Call, carry_out
from service.runtime.decisions import decided
from service.runtime.place import Place
from service.runtime.replay import replay
from service.runtime.twin_port import Twin
from twin.rig import Rig
from twin.tracing.decisions import Decision

WINDOWS = 3
UNSW = "/v1/assets/unsw"
COMMAND = [sys.executable, "-m", "service", "remote", "effects"]
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "short.mcap", WINDOWS)


def post(running: Service, path: str, body: dict) -> tuple[int, dict]:
    request = urllib.request.Request(
        f"http://{running.http}{path}", json.dumps(body).encode(), {"Content-Type": "application/json"}
    )
    try:
        with urllib.request.urlopen(request, timeout=40) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.load(error)


def counted(running: Service) -> float:
    """How many decisions the twin has carried out."""
    (effect,) = running.get("/v1/assets/unsw/effects")
    return 1e6 * effect["parameters"]["lead_gap"]["value"]


@pytest.mark.slow
def test_decision_is_done_when_it_is_answered_and_its_event_follows(tmp_path, recording):
    with service(tmp_path) as running:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        body = {"decision": "pin", "by": "Anna", "note": "measured"}
        status, answer = post(running, "/v1/assets/unsw/effects/misalignment", body)
        assert (status, answer["done"], answer["decision"], answer["by"]) == (200, True, "pin", "Anna")
        assert counted(running) == pytest.approx(1)
        assert [d["decision"] for d in running.get("/v1/assets/unsw/decisions")] == ["pin"]
        post(running, "/v1/assets/unsw/effects/misalignment", {"decision": "reject"})
        assert running.get("/v1/assets/unsw/effects") == []
    with running.store() as store:
        told = [
            (e.data["action"], e.data.get("by"), e.data.get("note"))
            for e in store.events("unsw", 0)
            if e.kind == "effect"
        ]
        assert told == [("pin", "Anna", "measured"), ("reject", None, None)]


@pytest.mark.slow
def test_what_cannot_be_decided_is_refused_with_its_reason(tmp_path, recording):
    with service(tmp_path) as running:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        status, answer = post(running, "/v1/assets/unsw/effects/tooth_friction", {"decision": "pin"})
        assert status == 409 and "tooth_friction is not in the twin" in answer["detail"]
        status, answer = post(running, "/v1/assets/unsw/effects/tooth_crack", {"decision": "pin"})
        assert status == 500 and answer["detail"] == "internal error: ZeroDivisionError: a fault"
        status, answer = post(running, "/v1/assets/unsw/effects/rust", {"decision": "pin"})
        assert status == 404 and "misalignment" in answer["detail"]
        status, answer = post(running, "/v1/assets/unsw/effects/misalignment", {"decision": "ignore"})
        assert status == 422 and "release" in answer["detail"]
        status, answer = post(running, "/v1/assets/other/effects/misalignment", {"decision": "pin"})
        assert status == 404 and answer["known"] == ["unsw"]


@pytest.mark.slow
def test_decision_that_was_kept_before_a_kill_is_carried_out_once_by_the_next_start(tmp_path, recording):
    running = Service(tmp_path).start()
    try:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        running.end(signal.SIGKILL)
        with running.store() as store:
            number = fakes.decide(store, "unsw", "misalignment", "pin")
        for _ in range(2):
            running.start()
            wait_until(lambda: counted(running) > 0.5)
            assert counted(running) == pytest.approx(1)
            running.end(signal.SIGKILL)
        with running.store() as store:
            assert fakes.jobs_of(store).job(number).done and not fakes.jobs_of(store).pending()
    finally:
        running.end(signal.SIGKILL)


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.slow
def test_ended_service_has_every_decision_that_it_answered_and_none_twice(tmp_path, recording, how):
    answered = []
    with service(tmp_path, slow=0.15) as running:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)

        def insist():
            while True:
                try:
                    status, answer = post(running, "/v1/assets/unsw/effects/misalignment", {"decision": "pin"})
                except OSError:  # the service is gone
                    return
                if status not in (200, 202):
                    return
                answered.append(answer["id"])

        engineers = [threading.Thread(target=insist) for _ in range(3)]
        for engineer in engineers:
            engineer.start()
        wait_until(lambda: len(answered) >= 4)
        _, _, complained = running.end(how)
        for engineer in engineers:
            engineer.join()
        assert "Traceback" not in complained
    with service(tmp_path) as again:
        wait_until(lambda: all(d["done"] for d in again.get("/v1/assets/unsw/decisions")))
        log = [d["id"] for d in again.get("/v1/assets/unsw/decisions")]
        assert set(answered) <= set(log) and len(log) <= len(answered) + len(engineers)
        wait_until(lambda: counted(again) > len(log) - 0.5)  # shown just after they have been stored
        assert counted(again) == pytest.approx(len(log))


@pytest.mark.slow
@pytest.mark.parametrize("slow", [1.0, 60.0], ids=["a short window", "a window that does not end"])
def test_decision_that_waits_does_not_hold_the_end_up_and_is_carried_out_by_the_next_start(tmp_path, recording, slow):
    with service(tmp_path) as running:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
    answers = []

    def ask(running):
        answers.append(post(running, "/v1/assets/unsw/effects/misalignment", {"decision": "pin"})[1]["id"])

    with service(tmp_path, slow=slow) as running:
        engineers = [threading.Thread(target=ask, args=(running,)) for _ in range(2)]
        for engineer in engineers:
            engineer.start()
        wait_until(lambda: len(running.get(f"{UNSW}/decisions") or ()) == 2)  # one is in work by now, the other waits
        status, _, complained = running.end(signal.SIGTERM)
        assert status == 0 and "Traceback" not in complained
        for engineer in engineers:
            engineer.join()
    with service(tmp_path) as again:
        wait_until(lambda: counted(again) > 1.5)
        assert counted(again) == pytest.approx(2)
        assert sorted(answers) == [d["id"] for d in again.get(f"{UNSW}/decisions")]  # answered: they are kept


def test_decision_keeps_name_and_note_from_rest_to_store_list_and_event(address, store, board):
    fakes.campaign(store, board)
    body = {"decision": "reject", "by": " Anna ", "note": "the shaft was measured"}
    status, answer = post(SimpleNamespace(http=address.removeprefix("http://")), f"{UNSW}/effects/misalignment", body)
    assert (status, answer["by"], answer["note"]) == (202, "Anna", "the shaft was measured")
    post(SimpleNamespace(http=address.removeprefix("http://")), f"{UNSW}/effects/misalignment", {"decision": "pin"})
    found = [(d.given["by"], d.given["note"]) for d in fakes.decisions(store, "unsw")]
    assert found == [
        ("Anna", "the shaft was measured"),
        (None, None),
    ]
    with gear_twin.Client(address) as client:
        assert [(d.decision, d.by) for d in client.decisions("unsw")] == [("reject", "Anna"), ("pin", None)]
        assert client.decide("unsw", "misalignment", "accept", by="Ben", note="seen").note == "seen"


def test_command_signs_a_decision_and_lists_them(address, store, board, capsys):
    fakes.campaign(store, board)
    url = ["--url", address]
    assert run(["remote", "effects", "decisions", *url]) == 0
    assert capsys.readouterr().out == "unsw: no decisions have been entered\n"
    assert run(["remote", "effects", "pin", "unsw", "misalignment", "--by", "Anna", "--note", "measured", *url]) == 0
    capsys.readouterr()
    assert run(["remote", "effects", "decisions", "unsw", *url]) == 0
    line = capsys.readouterr().out.splitlines()[-1].split()
    assert line[3:] == ["pin", "misalignment", "no", "Anna", "measured"]


def test_decision_and_what_it_changes_are_one_transaction(each_store):
    store = each_store
    fakes.campaign(store, None)
    number = fakes.decide(store, "unsw", "misalignment", "pin")
    waiting = fakes.jobs_of(store).job(number)
    before = store.asset("unsw").state
    with pytest.raises(ValueError):
        fakes.carry_out(
            store, waiting, state={"x": 1}, report={"y": 2}, events=[("effect", {"bad": float("nan")}), ("e",)]
        )
    assert store.asset("unsw").state == before and not fakes.jobs_of(store).job(number).done
    assert fakes.carry_out(store, waiting, state={"x": 1}, report={"y": 2}, events=[("effect", {"a": 1})])
    assert not fakes.carry_out(store, waiting, state={"x": 3}, report={"y": 4}, events=[("effect", {"a": 2})])
    assert store.asset("unsw").state == {"x": 1}


@pytest.mark.slow
def test_effects_command_lists_and_decides(tmp_path, recording):
    with service(tmp_path) as running:
        replay(recording, [running.endpoint], 0)
        running.wait_for_windows(WINDOWS)
        address = f"http://{running.http}"

        def call(*arguments):
            return subprocess.run(
                [*COMMAND, *arguments, "--url", address], cwd=ROOT, capture_output=True, text=True, timeout=60
            )

        done = call("accept", "unsw", "misalignment")
        assert done.returncode == 0 and done.stdout == "accept misalignment of unsw: done\n"
        assert call("pin", "misalignment").stdout == "pin misalignment of unsw: done\n"  # there is one asset alone
        assert "one effect at a time" in call("pin", "unsw", "misalignment", "tooth_crack").stderr
        listed = json.loads(call("list", "--json", "-").stdout)
        assert [e["name"] for e in listed["unsw"]] == ["misalignment"]
        wrong = call("pin", "unsw", "tooth_friction")
        assert wrong.returncode == 2 and wrong.stderr.count("\n") == 1 and "not in the twin" in wrong.stderr
    gone = call("list")
    assert gone.returncode == 2 and "no service answers at this address" in gone.stderr


@pytest.mark.slow
def test_asset_must_be_named_where_there_are_several(capsys, address, store, board):
    def refused(*given):
        assert run(["remote", "effects", *given, "--url", address]) == 2
        return capsys.readouterr().err

    assert "no asset has sent a frame yet" in refused("pin", "misalignment")
    fakes.campaign(store, board)
    assert run(["remote", "effects", "pin", "misalignment", "--url", address]) == 0
    assert capsys.readouterr().out.startswith("pin misalignment of unsw: queued")  # nobody carries it out here
    fakes.take(store, board, "another", 0, 10.0)
    assert "name one of its assets: another, unsw" in refused("pin", "misalignment")
    assert "no asset 'nobody'" in refused("list", "nobody")


@pytest.mark.parametrize(("level", "kept"), [("watch", True), ("alarm", False)])
def test_a_decision_leaves_since_when_the_state_holds_unless_it_changes_the_level(level, kept):
    since = {"time": "2024-05-01T10:00:00.000000000Z", "revolutions": 1000.0}
    before = {"status": {**fakes.status("watch", "Misalignment was found."), "since": since}}
    answer = Estimate(record={}, report={"status": {**fakes.status(level, "Wear."), "since": None}}, events=())
    twin = Twin(step=None, new_state=dict, load_state=dict, decide=lambda *given: ({}, answer))
    place = Place(asset="unsw", rig=Rig.from_mapping({}), twin=twin, state={}, report=before)
    ask = Ask("decide", Decision(name="misalignment", verb="reject"))
    made = carry_out(Call(asset="unsw", twin=twin, rig=place.rig, state=place.state, ask=ask))
    found = decided(place, made, 60_000_000_000).report["status"]["since"]
    assert found == since if kept else found == {"time": "1970-01-01T00:01:00.000000000Z", "revolutions": None}
