"""Windows that wait for an answer by people: what is kept of them and told, whatever the storage does meanwhile."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import service_fakes as fakes

from service.errors import StorageUnavailable
from service.results.window_jobs import WindowJobs
from service.runtime.commits import Commits
from service.runtime.outcomes import Outcome
from service.runtime.questions import count_fell, waiting
from service.runtime.staleness import NS, StalenessLimits, StalenessWatch

LATER = fakes.START_NS + 5_000 * 10**9  # [ns]
QUESTION = count_fell(900.0, 10.0, LATER)
HELD = Outcome(
    asset="unsw", held=True, changed={"question": waiting(QUESTION, 1)},
    events=(("question", {"kind": "count_fell"}),),
)  # fmt: skip
ASKED = Outcome(asset="unsw", changed={"question": QUESTION}, events=(("question", {"kind": "count_fell"}),))


@pytest.fixture
def sink(store, board):
    """Where outcomes of an asset go that has had one window."""
    fakes.take(store, board, "unsw", 0, 10.0)
    publication = SimpleNamespace(publish=lambda asset: None)
    return Commits(store, board, publication, WindowJobs(store.database), clock=lambda: LATER)


def given(sink, outcome):
    sink.commit(outcome)
    sink.publish(outcome)


def unavailable(asset):
    raise StorageUnavailable("away", reason="away")


@pytest.mark.parametrize("outcome", [HELD, ASKED])
def test_a_question_is_told_once_where_the_storage_fails_meanwhile(sink, store, board, monkeypatch, outcome):
    with monkeypatch.context() as patched:
        patched.setattr(store, "last_event_id", unavailable)
        with pytest.raises(StorageUnavailable):
            given(sink, outcome)
    given(sink, outcome)
    told = [event.kind for event in store.events("unsw", 0) if event.kind in ("question", "status")]
    assert told == ["question", "status"] and board.latest("unsw").last_event_id == store.last_event_id("unsw")


def test_windows_that_wait_keep_an_asset_from_being_stale_after_a_restart_too(sink, store, board):
    before = store.asset("unsw")
    given(sink, HELD)
    restarted, limits = fakes.WrittenTable(store), StalenessLimits(silent=3600.0, fruitless=120.0)
    stored = store.asset("unsw")
    assert (stored.received_ns, stored.windows, stored.damaged) == (LATER, before.windows, None)
    StalenessWatch(restarted, sink, limits, clock=lambda: LATER + 3000 * NS)()
    assert restarted.get("unsw").stale is None and restarted.get("unsw").question["waiting"] == 1


def test_an_epoch_begins_without_windows_and_when_one_came_stays_known(sink, store):
    given(sink, HELD)
    for epoch in (1, 1, 0):
        store.keep("unsw", epoch=epoch)
        kept = store.asset("unsw")
        assert (kept.epoch, kept.windows, kept.received_ns, kept.damaged) == (1, 0, LATER, None)
