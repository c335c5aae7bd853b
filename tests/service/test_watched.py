"""What a plant watches the service by: liveness, readiness, the watchdog of systemd, storage trouble in the status."""

from __future__ import annotations

import json
import os
import signal
import socket
import threading
import time
import urllib.error
from types import SimpleNamespace

import pytest
import service_fakes as fakes
from service_streams import service, wait_until, write_recording
from test_api import Client
from test_health import get

from service.api import create_app
from service.operation.health import HTTP, LOOPS, RECEPTION, WEBHOOKS, Health
from service.operation.systemd import ALIVE, READY, STOPPING, Watchdog, notify, watchdog_pause
from service.runtime.receiver import Receiver
from service.runtime.replay import replay
from service.runtime.role_process import Others, RoleState
from service.runtime.storage_status import StorageStatus
from service.runtime.storage_watch import StorageWatch
from service.runtime.work_processes import MOST_DEATHS, WORK, WorkProcesses


@pytest.fixture
def clock():
    class Clock:
        now = 100.0

        def __call__(self):
            return self.now

    return Clock()


@pytest.fixture
def told(tmp_path, monkeypatch):
    """What systemd is told, line by line."""
    address = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as received:
        received.bind(str(address))
        received.settimeout(20.0)
        monkeypatch.setenv("NOTIFY_SOCKET", str(address))

        def told() -> str:
            return received.recv(4096).decode()

        told.socket = received
        yield told


def test_loop_that_does_not_turn_makes_the_service_not_alive_with_name_and_time(store, board, clock):
    health = Health(30.0, clock)
    turn, _ = health.loop(RECEPTION), health.loop(HTTP)
    client = Client(create_app(board, store, health=health))
    clock.now += 29.0
    turn()
    assert client.get("/healthz").json() == {"status": "ok"}
    clock.now += 29.0
    answer = client.get("/healthz")
    assert answer.status_code == 503 and answer.headers["content-type"] == "application/problem+json"
    (loop,) = answer.json()["loops"]
    assert loop["loop"] == HTTP and loop["since"] in answer.json()["detail"]
    assert set(LOOPS) >= {RECEPTION, HTTP}


@pytest.mark.parametrize("what", ["a loop that hangs", "a thread that has ended"])
def test_a_service_is_not_ready_long_before_a_hung_loop_makes_it_not_alive(clock, what):
    """Reception hung for more than a minute, and everybody was told that frames were taken."""
    health = Health(120.0, clock)
    beat, ended = health.loop(RECEPTION), threading.Thread(target=lambda: None)
    of = SimpleNamespace(
        _reason=None, _lost=lambda: None, _storage=StorageWatch("data"), _health=health,
        _workers=SimpleNamespace(unusable=lambda: None),
    )  # fmt: skip
    assert Receiver.not_ready(of) is None
    if what == "a loop that hangs":
        clock.now += 11.0
        assert f"{RECEPTION}: no turn since" in Receiver.not_ready(of) and health.late() == []
        beat()
        assert Receiver.not_ready(of) is None
    else:
        health.thread(WEBHOOKS, ended)
        assert f"{WEBHOOKS}: no turn since" in Receiver.not_ready(of)


def test_thread_that_has_ended_makes_the_service_not_alive_and_one_that_waits_for_work_does_not(clock):
    health, over = Health(30.0, clock), threading.Event()
    thread = threading.Thread(target=over.wait)
    thread.start()
    health.thread(WEBHOOKS, thread)
    clock.now += 1000.0
    assert health.late() == []
    over.set()
    thread.join()
    assert [late.name for late in health.late()] == [WEBHOOKS]


def test_watchdog_is_told_a_third_of_its_time_before_it_bites_and_not_while_a_loop_hangs(told, monkeypatch, clock):
    monkeypatch.setenv("WATCHDOG_USEC", "60000000")
    assert watchdog_pause() == pytest.approx(20.0)
    health = Health(30.0, clock)
    health.loop(RECEPTION)
    watchdog = Watchdog(health, clock=clock)
    watchdog()
    assert told() == ALIVE
    watchdog()
    notify("STATUS=nothing more was told")
    assert told() == "STATUS=nothing more was told"
    clock.now += 31.0
    watchdog()
    notify("STATUS=nor this time")
    assert told() == "STATUS=nor this time"


def test_systemd_that_does_not_read_holds_up_no_loop(told):
    """The loop of HTTP once stopped for good behind ten unread lines."""
    sent = 0
    while notify(ALIVE):
        sent += 1
        assert sent < 100_000
    assert not notify(ALIVE)
    assert told() == ALIVE and notify(ALIVE)


def test_nothing_is_told_outside_of_systemd_or_where_the_watchdog_is_of_another_process(monkeypatch):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not notify(READY)
    monkeypatch.setenv("NOTIFY_SOCKET", "/nowhere/at/all")
    assert not notify(READY)
    monkeypatch.setenv("WATCHDOG_USEC", "1000000")
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid() + 1))
    assert watchdog_pause() is None


@pytest.mark.slow
def test_systemd_is_told_of_readiness_life_and_the_end(tmp_path, told, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "3000000")
    with service(tmp_path / "data") as running:
        assert told() == READY
        assert [told(), told(), told()] == [ALIVE] * 3
        status, _, complained = running.end(signal.SIGTERM)
    assert status == 0 and not complained
    while (line := told()) == ALIVE:
        pass
    assert line == STOPPING


def test_storage_that_cannot_be_used_is_in_the_status_of_every_asset_until_it_is_back(store, board):
    for asset in ("one", "two"):
        fakes.take(store, board, asset, 0, 100.0)
    before, storage = board.get("one").whole, StorageWatch("/data")
    show = StorageStatus(storage, board)
    with board.follow(fleeting=False) as published:
        published.take(0)
        show()
        assert before["storage"] is None and published.take(0) == ()
        storage.failed(OSError(28, "No space left on device"))
        show()
        assert sorted(published.take(0)) == ["one", "two"]
        show()
        assert published.take(0) == ()
    answer = get(board, store, "/v1/assets/one").json()
    assert "No space left" in answer["storage"]["reason"] and answer["storage"]["since"].endswith("Z")
    (found,) = [f for f in answer["status"]["findings"] if f["subject"] == "storage"]
    assert found["level"] == "no_verdict" and answer["status"]["level"] != "normal"
    assert answer["data"] == before["data"]
    storage.worked()
    show()
    assert board.get("one").whole == before


def test_workers_that_die_of_everything_make_the_service_not_ready():
    others, state = Others(), RoleState(process=1, lives=True)
    processes = WorkProcesses(1, others)
    assert processes.unusable() == "the first worker process is being started"
    others.take(WORK, state, {"living": 1, "in_a_row": 0})
    assert processes.unusable() is None
    others.take(WORK, state, {"living": 1, "in_a_row": MOST_DEATHS})
    assert "ended their worker processes" in processes.unusable()
    others.take(WORK, RoleState(unstarted="OSError: no memory"), {"living": 1, "in_a_row": 0})
    assert processes.unusable() == "no worker process can be started: OSError: no memory"


def test_deaths_of_workers_are_counted_over_the_processes_that_fork_them():
    others = Others()
    processes = WorkProcesses(1, others)
    for deaths in (2, 3, 0, 1):
        others.take(WORK, RoleState(process=1), {"deaths": deaths})
        last = processes.figures()["worker_deaths"]
    assert last == 4


@pytest.mark.slow
def test_service_that_was_suspended_is_alive_again_at_once(tmp_path):
    with service(tmp_path / "data", LOOP_LIMIT="5") as running:
        assert running.get("/healthz") == {"status": "ok"}
        running.process.send_signal(signal.SIGSTOP)
        time.sleep(7.0)
        running.process.send_signal(signal.SIGCONT)
        wait_until(lambda: running.get("/healthz") == {"status": "ok"})


def health_of(running):
    """The status of /healthz and the loops that are named."""
    try:
        running.text("/healthz")
    except urllib.error.HTTPError as error:
        return error.code, {each["loop"] for each in json.load(error)["loops"]}
    return 200, set()


@pytest.mark.slow
def test_loop_that_hangs_in_a_running_service_is_named_no_watchdog_is_told_and_it_is_alive_again_afterwards(
    tmp_path, told, monkeypatch
):
    """The disk does not answer, as with a hung NFS server."""
    pipe = tmp_path / "disk"
    monkeypatch.setenv("WATCHDOG_USEC", "900000")
    monkeypatch.setenv("FAKE_TWIN_DISK", str(pipe))
    recording = write_recording(tmp_path / "a.mcap", 2)
    with service(tmp_path / "data", LOOP_LIMIT="5") as running:
        assert told() == READY and told() == ALIVE and health_of(running) == (200, set())
        os.mkfifo(pipe)
        sender = threading.Thread(target=replay, args=(recording, [running.endpoint], 0))
        sender.start()
        wait_until(lambda: health_of(running) == (503, {RECEPTION}), 30.0)
        drained(told, 1.0)  # what had been told before
        assert drained(told, 2.0) == [] and health_of(running)[0] == 503
        assert running.get("/v1/assets") is not None  # HTTP answers
        with pipe.open("rb") as disk:  # it answers again
            pipe.unlink()
            disk.read()
        wait_until(lambda: health_of(running) == (200, set()), 30.0)
        assert ALIVE in drained(told, 3.0)
        sender.join(60.0)
        assert len(running.wait_for_windows(2)) == 2 and not sender.is_alive()
        running.end(signal.SIGTERM)


def drained(told, seconds):
    """What systemd is told within a time [s]."""
    lines, until = [], time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        told.socket.settimeout(left)
        try:
            lines.append(told())
        except TimeoutError:
            break
    told.socket.settimeout(20.0)
    return lines
