"""A database that was put back under those who compute: what was made of what it has no more is not committed."""

from __future__ import annotations

import pytest
import service_fakes as fakes
from loops import loop_of
from schedules import Server
from segments import segment_of
from sqlalchemy import delete, select, update
from test_workers import window

from service.errors import SteppedBack, StorageUnavailable
from service.results.database import Database
from service.results.json_columns import dump
from service.results.schema import COMMITS, JOBS
from service.results.sql_store import SqlStore


@pytest.fixture
def loop(store, tmp_path):
    """A loop that has carried out a window, and cannot commit the next job now."""
    loop = loop_of(store, tmp_path)
    loop.add("unsw", segment_of(window()))
    loop.carry_out()
    return loop


def compute_in_vain(loop, monkeypatch):
    """Computes the next job, and cannot commit it."""

    def away(*given):
        raise StorageUnavailable("away", reason="connection lost")

    with monkeypatch.context() as patched:
        patched.setattr(loop.work._commits, "commit", away)
        with pytest.raises(StorageUnavailable):
            loop.loop.turn()


def test_what_a_job_led_to_is_not_committed_in_place_of_another_job_of_its_number(loop, store, monkeypatch):
    number = fakes.decide(store, "unsw", "misalignment", "pin")
    compute_in_vain(loop, monkeypatch)
    with store.database.transaction() as db:
        given = {"name": "misalignment", "verb": "reject", "by": None, "note": None}
        other = {"given": dump(given), "received_ns": JOBS.c.received_ns + 1}
        db.execute(update(JOBS).where(JOBS.c.id == number).values(other))
    assert not loop.loop.turn()
    loop.carry_out()
    assert store.asset("unsw").state["decided"] == [["misalignment", "reject"]]


def test_what_a_window_led_to_is_not_committed_where_it_does_not_wait_any_more(loop, store, monkeypatch):
    loop.add("unsw", segment_of(window(1)))
    compute_in_vain(loop, monkeypatch)
    with store.database.transaction() as db:
        db.execute(delete(JOBS))
    loop.carry_out()
    assert [each.record["index"] for each in store.windows("unsw")] == [0]


def test_a_window_whose_file_is_gone_is_not_refused_but_the_service_begins_anew(loop, store):
    loop.add("unsw", segment_of(window(1)))
    for file in loop.windows.folder.glob("*.mcap"):
        file.unlink()
    with pytest.raises(SteppedBack, match="file is not there"):
        loop.loop.turn()
    assert len(loop.windows.waiting("unsw")) == 1


def test_whoever_has_a_database_alone_marks_it_before_it_reads(tmp_path):
    path = tmp_path / "twin.sqlite"
    SqlStore(path).close()
    database = Database(Server(path, "ingest"), claimed=True)
    assert [tuple(row) for row in database.rows(select(COMMITS.c.writer, COMMITS.c.number))] == [("ingest", 1)]
