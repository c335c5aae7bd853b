"""Storage that fails: an error with its reason, nothing half done, and all goes on when the cause is gone."""

from __future__ import annotations

import errno
import random
import sqlite3
from contextlib import closing

import pytest
import service_fakes as fakes

from service.errors import StorageUnavailable, StoreError
from service.results import backends
from service.results.sql_store import SqlStore
from service.results.storage_faults import is_away, storage_error

LONG = random.Random(1).randbytes(100_000).hex()  # what no compression makes much smaller


@pytest.fixture
def impatient(tmp_path, monkeypatch):
    monkeypatch.setattr(backends, "LOCK_WAIT", 0.05)
    with SqlStore(tmp_path / "twin.sqlite") as store:
        yield store


def test_database_that_another_program_locks_is_unavailable_and_works_again_afterwards(impatient):
    store = impatient
    fakes.take(store, None, "unsw", 0, 100.0)
    with closing(sqlite3.connect(store.path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StorageUnavailable, match=r"twin\.sqlite cannot be used now \(locked\)") as caught:
            fakes.take(store, None, "unsw", 1, 200.0)
        assert caught.value.reason == "locked" and not caught.value.unknown
        assert [w.record["index"] for w in store.windows("unsw")] == [0]  # reading goes on
        other.execute("ROLLBACK")
    assert fakes.take(store, None, "unsw", 1, 200.0)


def test_full_disk_leaves_the_database_as_it_was_and_is_left_behind_when_there_is_room(store):
    fakes.take(store, None, "unsw", 0, 100.0)
    before = store.asset("unsw")
    with store.database.transaction() as db:
        db.exec_driver_sql("PRAGMA max_page_count = 1")  # no less than the pages that there are
    with pytest.raises(StorageUnavailable) as caught:
        store.keep("unsw", rig={"name": LONG})
    assert caught.value.reason == "no space"
    assert store.asset("unsw") == before
    with store.database.transaction() as db:
        db.exec_driver_sql("PRAGMA max_page_count = 1000000")
    store.keep("unsw", rig={"name": LONG})
    assert store.asset("unsw").rig is not None


class PostgresqlError(Exception):
    def __init__(self, sqlstate):
        super().__init__("the server says so\nDETAIL: more")
        self.sqlstate = sqlstate


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (PostgresqlError("53100"), "no space"),
        (PostgresqlError("53300"), "connection lost"),
        (PostgresqlError("25006"), "read-only"),
        (PostgresqlError("55P03"), "locked"),
        (PostgresqlError("57P01"), "connection lost"),
        (PostgresqlError("08006"), "connection lost"),
        (PostgresqlError("58030"), "input or output"),
        (OSError(errno.ENOSPC, "No space left on device"), "no space"),
        (OSError(errno.EROFS, "Read-only file system"), "read-only"),
        (OSError(errno.EIO, "Input/output error"), "input or output"),
    ],
)
def test_failure_of_a_driver_is_named_by_its_reason(error, reason):
    meant = storage_error(error, "the database")
    assert isinstance(meant, StorageUnavailable) and meant.reason == reason
    assert "\n" not in str(meant)


def test_damage_is_not_taken_for_a_fault_that_passes():
    meant = storage_error(PostgresqlError("XX001"), "the database")
    assert isinstance(meant, StoreError) and not isinstance(meant, StorageUnavailable)
    assert storage_error(PostgresqlError("23505"), "the database") is None  # a duplicate key is the program's fault


class OperationalError(Exception):
    sqlstate = None


class ConnectionTimeout(OperationalError):
    """As that of psycopg."""


class LostWhileItWasAsked(ConnectionTimeout):
    """As a later release of a driver may have it."""


class NotSupportedError(Exception):
    sqlstate = None


@pytest.mark.parametrize("kind", [OperationalError, ConnectionTimeout, LostWhileItWasAsked])
def test_every_kind_of_a_lost_connection_is_a_lost_connection(kind):
    assert is_away(storage_error(kind("connection timeout expired"), "the database"))
    assert storage_error(NotSupportedError("no such thing"), "the database") is None


@pytest.mark.slow
@pytest.mark.parametrize("opened", [False, True])
def test_a_server_that_is_frozen_is_away_until_it_goes_on(postgresql_server, monkeypatch, opened):
    monkeypatch.setattr(backends, "CONNECT_WAIT", 2)
    with postgresql_server.new_database() as url:
        with SqlStore(url) as store:
            fakes.take(store, None, "unsw", 0, 100.0)
            if opened:  # its connections are lost, and new ones are not answered
                store.database.close()
                with postgresql_server.frozen(), pytest.raises(StorageUnavailable) as caught:
                    fakes.take(store, None, "unsw", 1, 200.0)
                assert is_away(caught.value)
                assert fakes.take(store, None, "unsw", 1, 200.0)
        if not opened:
            with postgresql_server.frozen(), pytest.raises(StorageUnavailable) as caught:
                SqlStore(url)
            assert is_away(caught.value)
            with SqlStore(url) as store:
                assert [w.record["index"] for w in store.windows("unsw")] == [0]
