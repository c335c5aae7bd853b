"""Services and a server of PostgreSQL: one service to a database, and servers that are away at the start or later."""

from __future__ import annotations

import json
import signal
import urllib.error
import urllib.request

import pytest
import service_fakes as fakes
from service_streams import Service, wait_until, write_recording

from service.cli import run
from service.errors import StorageUnavailable
from service.results.claims import LOCK
from service.results.sql_store import SqlStore

CLAIMED = f"SELECT pid FROM pg_locks WHERE locktype = 'advisory' AND granted AND objid = {LOCK}"
DROP = "SELECT pg_terminate_backend(pid, 5000) FROM pg_stat_activity WHERE application_name LIKE 'gear-twin%%'"


def test_a_second_service_on_one_database_is_refused_until_the_first_has_ended(postgresql):
    with SqlStore(postgresql, claimed=True) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        with pytest.raises(StorageUnavailable, match="another service uses this database; give each its own") as caught:
            SqlStore(postgresql, claimed=True)
        assert caught.value.reason == "locked" and "\n" not in str(caught.value)
        with SqlStore(postgresql) as reader:  # an export of results
            assert len(reader.windows("unsw")) == 1
    with SqlStore(postgresql, claimed=True) as store:
        assert fakes.take(store, None, "unsw", 1, 200.0)


def test_a_service_whose_connection_was_dropped_goes_on_and_keeps_others_out(postgresql, postgresql_server):
    with SqlStore(postgresql, claimed=True) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        assert postgresql_server.sql(DROP)
        assert fakes.take(store, None, "unsw", 1, 200.0)
        with pytest.raises(StorageUnavailable, match="another service"):
            SqlStore(postgresql, claimed=True)


def test_a_commit_is_confirmed_once_it_is_written_whatever_the_server_is_set_to(postgresql, postgresql_server):
    """A server that confirmed first lost windows that had been acknowledged, when it was killed."""
    assert postgresql_server.sql("SHOW synchronous_commit") == [("off",)]
    with SqlStore(postgresql) as store, store.database.transaction() as db:
        assert db.exec_driver_sql("SHOW synchronous_commit").scalar_one() == "on"


def test_a_session_of_its_own_that_the_server_takes_for_alive_is_ended(postgresql):
    with SqlStore(postgresql, claimed=True) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        pool = store.database._writer.pool
        lost = pool._pool.queue[0]  # as after a cable was pulled: the server knows nothing of it
        pool._pool.queue.clear()
        pool._overflow = -1
        assert fakes.take(store, None, "unsw", 1, 200.0)
        assert lost is not pool._pool.queue[0]
        lost.dbapi_connection.close()


def test_a_service_writes_no_more_once_another_has_had_its_database(postgresql, postgresql_server):
    with SqlStore(postgresql, claimed=True) as store:
        fakes.take(store, None, "unsw", 0, 100.0)
        postgresql_server.sql(DROP)
        with SqlStore(postgresql, claimed=True) as other:
            fakes.take(other, None, "unsw", 1, 200.0)
            with pytest.raises(StorageUnavailable, match="another service has used this database"):
                fakes.take(store, None, "unsw", 1, 200.0)
        with pytest.raises(StorageUnavailable, match="start this one again"):  # what it remembers is out of date
            fakes.take(store, None, "unsw", 2, 300.0)
        assert len(store.windows("unsw")) == 2


def reason_of(running):
    try:
        with urllib.request.urlopen(f"http://{running.http}/readyz", timeout=10):
            return None
    except urllib.error.HTTPError as error:
        with error:
            return json.load(error)["detail"]
    except OSError:
        return "not listening"


@pytest.mark.serve_only("of a service that has a database of PostgreSQL to itself")
@pytest.mark.slow
def test_a_server_that_is_away_at_the_start_and_later_is_waited_for(postgresql, postgresql_server, tmp_path):
    recording = write_recording(tmp_path / "day.mcap", windows=2)
    running = Service(tmp_path / "data", DATABASE=postgresql)
    postgresql_server.stop()
    try:
        ready = running.get
        running.get = lambda path: ready("/healthz")
        running.start()
        running.get = ready
        assert "connection lost" in reason_of(running) and "it is waited for" in reason_of(running)
        assert running.get("/v1/assets") is None
    finally:
        postgresql_server.start()
    wait_until(lambda: reason_of(running) is None, 30.0)
    assert run(["replay", str(recording), "--connect", running.endpoint, "--speed", "0"]) == 0
    assert len(running.wait_for_windows(2)) == 2
    postgresql_server.stop()
    try:
        wait_until(lambda: "connection lost" in (reason_of(running) or ""), 30.0)
    finally:
        postgresql_server.start()
    wait_until(lambda: reason_of(running) is None, 60.0)
    assert len(running.windows()) == 2
    wait_until(lambda: postgresql_server.sql(CLAIMED), 30.0)  # it is read before it is written to again
    with pytest.raises(AssertionError, match="another service uses this database"):
        Service(tmp_path / "other", DATABASE=postgresql).start()
    assert running.end()[0] == 0


@pytest.mark.serve_only("of a service that has a database of PostgreSQL to itself")
@pytest.mark.slow
def test_a_service_that_waits_for_its_database_ends_on_a_signal(postgresql, postgresql_server, tmp_path):
    postgresql_server.stop()
    try:
        running = Service(tmp_path / "data", DATABASE=postgresql)
        ready = running.get
        running.get = lambda path: ready("/healthz")
        running.start()
        assert running.end(signal.SIGTERM)[0] == 0
    finally:
        postgresql_server.start()
