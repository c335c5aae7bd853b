"""Server-sent events over a real socket: in order, from where the reader left off."""

from __future__ import annotations

import json
import re
import socket
import struct
import threading
import time

import httpx
import pytest
import service_fakes as fakes
from service_streams import ROOT

from service.api.events import KINDS


def read_events(address, asset, count, headers=None, query="", ready=None):
    """The next `count` events as (id, kind, data)."""
    events, current = [], {}
    url = f"{address}/v1/assets/{asset}/events{query}"
    with httpx.Client(timeout=10) as client, client.stream("GET", url, headers=headers) as answer:
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/event-stream")
        for line in answer.iter_lines():
            if ready is not None:
                ready.set()
            key, _, value = line.partition(": ")
            if line == "" and "data" in current:
                events.append((int(current["id"]), current["event"], json.loads(current["data"])))
                current = {}
                if len(events) == count:
                    return events
            elif key in ("id", "event", "data"):
                current[key] = value
    return events


def test_reader_from_the_start_gets_every_event_in_order(address, store, board):
    fakes.campaign(store, board)
    kept = [(e.id, e.kind, e.data) for e in store.events("unsw", 0)]
    assert {kind for _, kind, _ in kept} == {"window", "rul", "update", "data_fault"}
    assert read_events(address, "unsw", len(kept), query="?after=0") == kept


def test_reader_that_comes_back_goes_on_behind_its_last_event(address, store, board):
    fakes.campaign(store, board)
    kept = [(e.id, e.kind, e.data) for e in store.events("unsw", 0)]
    first = read_events(address, "unsw", 5, headers={"Last-Event-ID": "0"})
    rest = read_events(address, "unsw", len(kept) - 5, headers={"Last-Event-ID": str(first[-1][0])})
    assert first + rest == kept


def test_reader_without_an_id_gets_what_happens_from_now_on(address, store, board):
    fakes.campaign(store, board)
    ready, got = threading.Event(), []
    reader = threading.Thread(target=lambda: got.extend(read_events(address, "unsw", 4, ready=ready)), daemon=True)
    reader.start()
    assert ready.wait(5)
    fakes.take(store, board, "other", 0, 5.0)  # another asset's events are none of this reader's
    fakes.take(store, board, "unsw", 90, 18500.0)
    fakes.take(store, board, "unsw", 91, 18600.0)
    reader.join(10)
    assert [(kind, data.get("revolutions")) for _, kind, data in got if kind == "window"] == [
        ("window", 18500.0),
        ("window", 18600.0),
    ]
    assert len(got) == 4


@pytest.mark.slow
def test_more_events_than_one_page_are_all_told(address, store, board):
    for index in range(260):
        store.note("unsw", [("window", {"n": index}), ("rul", {})])
    board.update("unsw", last_event_id=store.last_event_id("unsw"))
    told = read_events(address, "unsw", 520, query="?after=0")
    assert [data["n"] for _, kind, data in told if kind == "window"] == list(range(260))


def test_the_last_event_under_a_former_name_says_the_present_one(address, store, board):
    """A reader heard nothing more for ever, and nobody told it."""
    fakes.take(store, board, "unsw", 0, 100.0)
    before = store.last_event_id("unsw")
    ready, got = threading.Event(), []
    reader = threading.Thread(target=lambda: got.extend(read_events(address, "unsw", 4, ready=ready)), daemon=True)
    reader.start()
    assert ready.wait(5)
    for name in ("press-7", "press-8"):
        fakes.rename(store, board, "unsw", name)
    fakes.take(store, board, "unsw", 1, 200.0)
    kept = [(e.id, e.kind, e.data) for e in store.events("unsw", before)]
    assert kept[0][1] == "change" and kept[0][2]["effect"] == {"asset": "press-7", "was": "unsw"} and len(kept) == 4
    reader.join(30)
    assert got == kept
    headers = {"Last-Event-ID": str(before)}  # of the former name: nothing is missed under the present one
    assert read_events(address, "press-8", len(kept), headers=headers) == kept


@pytest.mark.parametrize("part", ["", "/events", "/trend", "/changes"])
def test_a_former_name_is_a_404_that_names_the_present_one(address, store, board, part):
    fakes.take(store, board, "unsw", 0, 100.0)
    for name in ("press-7", "press-8"):
        fakes.rename(store, board, "unsw", name)
    for former in ("unsw", "press-7"):
        answer = httpx.get(f"{address}/v1/assets/{former}{part}")
        assert (answer.status_code, answer.json()["renamed"], answer.json()["known"]) == (404, "press-8", ["press-8"])
        assert answer.json()["detail"] == f"asset '{former}' has another name now: 'press-8'"
    answer = httpx.get(f"{address}/v1/assets/nobody{part}")
    assert answer.status_code == 404 and "renamed" not in answer.json()


def test_a_former_name_whose_stream_is_another_machines_is_that_of_the_renamed_one_all_the_same(address, store, board):
    fakes.take(store, board, "unsw", 0, 100.0)
    fakes.Names(store.database).give_streams("unsw", "bench-2")
    fakes.rename(store, board, "unsw", "press-7")
    answer = httpx.get(f"{address}/v1/assets/unsw")
    assert (answer.status_code, answer.json()["renamed"]) == (404, "press-7")


@pytest.mark.parametrize("bad", ["-1", "last", str(2**63)])
def test_last_event_id_that_cannot_be_is_a_problem(address, store, board, bad):
    fakes.take(store, board, "unsw", 0, 10.0)
    answer = httpx.get(f"{address}/v1/assets/unsw/events", headers={"Last-Event-ID": bad})
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


def test_open_reader_does_not_hold_the_service_up(store, board):
    from conftest import serving

    fakes.take(store, board, "unsw", 0, 10.0)
    ready, got = threading.Event(), []
    with serving(board, store) as address:
        reader = threading.Thread(target=lambda: got.append(read_events(address, "unsw", 9, ready=ready)), daemon=True)
        reader.start()
        assert ready.wait(5)
    reader.join(5)
    assert got == [[]]


@pytest.mark.slow
def test_readers_that_vanish_leave_no_complaint_in_the_log(store, board, caplog):
    """A browser that is closed resets its connections, with events still to be sent."""
    for index in range(400):
        store.note("unsw", [("window", {"n": index, "text": "x" * 2000})])
    board.update("unsw", last_event_id=store.last_event_id("unsw"))
    from conftest import serving

    with serving(board, store) as address:
        host, port = address.removeprefix("http://").split(":")
        for _ in range(5):
            with socket.create_connection((host, int(port))) as reader:
                reader.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # close is a reset
                reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                reader.sendall(b"GET /v1/assets/unsw/events?after=0 HTTP/1.1\r\nHost: twin\r\n\r\n")
                reader.recv(1000)
        time.sleep(0.5)
        assert httpx.get(f"{address}/healthz").status_code == 200
    assert [r.getMessage() for r in caplog.records if r.name == "asyncio"] == []


def test_page_listens_to_every_kind_of_event():
    script = (ROOT / "service" / "page" / "machine.js").read_text(encoding="utf-8")
    listened = re.search(r"KINDS = \[([^\]]*)\]", script)
    assert listened and set(re.findall(r'"(\w+)"', listened[1])) == set(KINDS)
