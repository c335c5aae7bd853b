"""Windows that wait for an answer by people: what is kept of them and told, whatever the storage does meanwhile."""

from __future__ import annotations

import pytest
import service_fakes as fakes

from service.errors import StorageUnavailable
from service.results import window_jobs
from service.results.window_jobs import WaitingWindow, WindowJobs
from service.runtime.commits import Commits
from service.runtime.outcomes import Outcome
from service.runtime.questions import count_fell
from service.runtime.staleness import NS, StalenessLimits, StalenessWatch

LATER = fakes.START_NS + 5_000 * 10**9  # [ns]
QUESTION = count_fell(900.0, 10.0, LATER)
WAITS = WaitingWindow(id=1, asset="unsw", start_ns=7, received_ns=LATER, bytes=1, file="1.mcap")
HELD = Outcome(
    asset="unsw",
    held=True,
    waited=WAITS,
    changed={"question": QUESTION},
    events=(("question", {"kind": "count_fell"}),),
)
ASKED = Outcome(asset="unsw", changed={"question": QUESTION}, events=(("question", {"kind": "count_fell"}),))


@pytest.fixture
def commits(store, board, tmp_path, monkeypatch):
    """Where outcomes of an asset are kept that has had one window, and of which another one waits."""
    fakes.take(store, board, "unsw", 0, 10.0)
    windows = WindowJobs(store.database, tmp_path / "segments")
    monkeypatch.setattr(window_jobs, "later_time_ns", lambda: LATER)
    windows.add_waiting("unsw", windows.write(fakes.SEGMENT))
    return Commits(store, board, windows, clock=lambda: LATER)


def unavailable(asset):
    raise StorageUnavailable("away", reason="away")


@pytest.mark.parametrize("outcome", [HELD, ASKED])
def test_a_question_is_told_once_where_the_storage_fails_meanwhile(commits, store, board, monkeypatch, outcome):
    with monkeypatch.context() as patched:
        patched.setattr(store, "last_event_id", unavailable)
        with pytest.raises(StorageUnavailable):
            fakes.commit(commits, outcome)
    fakes.commit(commits, outcome)
    told = [event.kind for event in store.events("unsw", 0) if event.kind in ("question", "status")]
    assert told == ["question", "status"] and board.latest("unsw").last_event_id == store.last_event_id("unsw")


def test_windows_that_wait_keep_an_asset_from_being_stale_after_a_restart_too(commits, store, board):
    before = store.asset("unsw")
    fakes.commit(commits, HELD)
    restarted, limits = fakes.WrittenTable(store), StalenessLimits(silent=3600.0, fruitless=120.0)
    stored = store.asset("unsw")
    assert (stored.received_ns, stored.windows, stored.damaged) == (LATER, before.windows, None)
    noticed = []
    StalenessWatch(restarted, noticed.extend, limits, clock=lambda: LATER + 3000 * NS)()
    assert not noticed and restarted.get("unsw").question["waiting"] == 1


def test_an_epoch_begins_without_windows_and_when_one_came_stays_known(commits, store):
    fakes.commit(commits, HELD)
    for epoch in (1, 1, 0):
        store.keep("unsw", epoch=epoch)
        kept = store.asset("unsw")
        assert (kept.epoch, kept.windows, kept.received_ns, kept.damaged) == (1, 0, LATER, None)
