"""What waits to be assessed is shown: how many windows, for how long, and behind which machine."""

from __future__ import annotations

import time
from types import SimpleNamespace

import pytest
import service_fakes as fakes

from service.contract.answer import assemble
from service.contract.status import Backlog as Shown
from service.contract.status import data_of
from service.results.snapshot import Snapshot, Waiting
from service.results.window_jobs import Backlog
from service.runtime.backlog_watch import BacklogWatch, waiting_of
from service.runtime.positions import ClosedWindows, Positions
from service.stream.inbox import Inbox

S = 10**9
BACKLOG = Shown(windows=6, since="2026-03-01T12:03:20.000000000Z", behind=["pump-3"])


def waits(windows=6, waited=85.0, held=0):
    since_ns = time.time_ns() - round(waited * S) if windows else None
    return Backlog(windows=windows, held=held, since_ns=since_ns)


def test_machine_whose_windows_wait_is_not_told_to_send_some():
    """For 85 s it said "no whole measurement window has been received yet", while six windows waited."""
    whole = assemble("fan", [], None, {}, backlog=BACKLOG)
    said = "6 windows wait to be assessed since 12:03:20 UTC, behind pump-3"
    assert whole["data"]["level"] == "waiting" and whole["data"]["reason"] == said
    assert whole["status"]["level"] == "no_verdict" and whole["status"]["reasons"] == [f"{said}."]
    assert whole["status"]["action"].startswith("Wait until the windows that have come are assessed")
    assert whole["data"]["waiting"] == {"windows": 6, "since": BACKLOG.since, "behind": ["pump-3"]}


def test_newer_windows_that_wait_are_said_beside_the_latest():
    good = {"index": 0, "quality": "good", "start_time": "t0"}
    data = data_of([good], backlog=BACKLOG.model_copy(update={"windows": 1, "behind": []}))
    assert (
        data.level == "ok"
        and data.reason == "the latest window is good; 1 window waits to be assessed since 12:03:20 UTC"
    )
    assert data_of([good]).waiting is None and "waiting" not in data_of([good]).as_json()


@pytest.mark.parametrize(
    ("given", "at_work", "expected"),
    [
        (waits(), {"pump-3"}, (6, ("pump-3",))),
        (waits(), {"pump-3", "mill"}, (6, ("mill", "pump-3"))),
        (waits(), {"fan"}, (6, ())),
        (waits(), set(), (6, ())),
        (waits(4, held=2), {"pump-3"}, (4, ("pump-3",))),
        (waits(waited=-3600.0), {"pump-3"}, None),
        (waits(0), {"pump-3"}, None),
        (waits(0, held=6), {"pump-3"}, None),
    ],
)
def test_what_waits_is_what_can_be_assessed_and_has_waited(given, at_work, expected):
    found = waiting_of(given, Snapshot(asset="fan"), "fan", at_work)
    assert (None if found is None else (found.windows, found.behind)) == expected
    assert waiting_of(given, Snapshot(asset="fan", question={"kind": "gears_differ"}), "fan", at_work) is None


def test_board_shows_what_waits_and_that_it_no_longer_does():
    board, now = fakes.scratch_table(), [0.0]
    board.update("fan", quality={})
    board.update("pump-3", quality={})
    waiting = {"fan": waits(), "unknown": waits()}
    backlogs = SimpleNamespace(all=waiting, of=lambda asset: waiting.get(asset, Backlog()))
    unusable = [None]
    workers = SimpleNamespace(at_work=lambda: ("pump-3",), unusable=lambda: unusable[0])
    watch = BacklogWatch(backlogs, workers, board, clock=lambda: now[0])
    watch()
    assert board.get("fan").whole["data"]["waiting"]["behind"] == ["pump-3"]
    assert board.get("fan").summary()["reason"].startswith("6 windows wait") and board.get("unknown") is None
    now[0], unusable[0] = 1.0, "no worker process can be started: no memory"
    watch()
    assert board.get("fan").summary()["reason"].endswith("UTC: no worker process can be started: no memory")
    now[0], unusable[0] = 1.5, None
    waiting.clear()
    watch()
    assert board.get("fan").waiting is not None  # not looked at yet
    now[0] = 2.5
    watch()
    assert board.get("fan").waiting is None and board.get("fan").whole["data"]["level"] == "waiting"
    assert "no whole measurement window" in board.get("fan").whole["data"]["reason"]


def test_position_says_how_many_windows_wait_now():
    """It kept `backlog: 1` after the window had been answered, until the next frame came."""
    waiting = [1]
    network = SimpleNamespace(publish_position=lambda stream, text: None)
    source = SimpleNamespace(position=lambda stream: None, refusal=lambda stream: None)
    positions = Positions(
        Inbox(), network, source, pending=lambda stream: ClosedWindows(waiting=waiting[0]), clock=lambda: 0.0
    )
    positions.moved("fan")
    positions()
    assert positions.latest("fan").backlog == 1
    waiting[0] = 0
    assert positions.latest("fan").backlog == 0


def test_machine_says_when_it_was_last_seen(store, board):
    fakes.take(store, board, "unsw", 0, 10.0)
    assert board.get("unsw").whole["last_seen"] == "2023-11-14T22:13:20.000000000Z"
    board.update("unsw", last_frame_ns=fakes.START_NS + 60 * S)
    assert board.get("unsw").whole["last_seen"] == board.get("unsw").summary()["last_seen"]
    assert board.get("unsw").whole["last_seen"].startswith("2023-11-14T22:14:20")
    assert Waiting(windows=1, since_ns=0).as_backlog().behind == []
