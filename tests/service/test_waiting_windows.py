"""Windows that wait for an answer by people: what is kept of them and told, whatever the storage does meanwhile."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import service_fakes as fakes

from service.errors import StorageUnavailable
from service.results.board import Board
from service.results.window_jobs import WindowJobs
from service.runtime.outcomes import HeldWindow
from service.runtime.questions import count_fell
from service.runtime.staleness import NS, StalenessLimits, StalenessWatch
from service.runtime.waiting_windows import WaitingWindows

LATER = fakes.START_NS + 5_000 * 10**9  # [ns]
QUESTION = count_fell(900.0, 10.0, LATER)
HELD = HeldWindow(
    asset="unsw", state=None, question=QUESTION, waiting=1, events=(("question", {"kind": "count_fell"}),)
)


@pytest.fixture
def waiting(store, board):
    """The place where the windows of an asset wait that has had one window."""
    fakes.take(store, board, "unsw", 0, 10.0)
    publication = SimpleNamespace(publish=lambda asset: None)
    return WaitingWindows(store, WindowJobs(store.database), board.own, publication, clock=lambda: LATER)


def unavailable(asset):
    raise StorageUnavailable("away", reason="away")


@pytest.mark.parametrize("begin", [lambda w: w.hold(HELD), lambda w: w.ask("unsw", QUESTION)])
def test_a_question_is_told_once_where_the_storage_fails_meanwhile(waiting, store, board, monkeypatch, begin):
    with monkeypatch.context() as patched:
        patched.setattr(store, "last_event_id", unavailable)
        with pytest.raises(StorageUnavailable):
            begin(waiting)
    begin(waiting)
    told = [event.kind for event in store.events("unsw", 0) if event.kind in ("question", "status")]
    assert told == ["question", "status"] and board.own.get("unsw").last_event_id == store.last_event_id("unsw")


def test_windows_that_wait_keep_an_asset_from_being_stale_after_a_restart_too(waiting, store):
    before = store.asset("unsw")
    waiting.hold(HELD)
    restarted, limits = Board.from_store(store), StalenessLimits(silent=3600.0, fruitless=120.0)
    stored = store.asset("unsw")
    assert (stored.received_ns, stored.windows, stored.damaged) == (LATER, before.windows, None)
    StalenessWatch(store, restarted, waiting._publication, limits, clock=lambda: LATER + 3000 * NS)()
    assert restarted.get("unsw").stale is None and restarted.get("unsw").question["waiting"] == 1


def test_an_epoch_begins_without_windows_and_when_one_came_stays_known(waiting, store):
    waiting.hold(HELD)
    for epoch in (1, 1, 0):
        store.keep("unsw", epoch=epoch)
        kept = store.asset("unsw")
        assert (kept.epoch, kept.windows, kept.received_ns, kept.damaged) == (1, 0, LATER, None)
