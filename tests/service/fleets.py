"""Fleets of three partitions for tests: their database, workers of partitions, and what they have stored."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from contextlib import contextmanager

import sqlalchemy as sa
from fleet_partition import PartitionProcess
from service_streams import free_port

from service import api
from service.alarms.keeper import AlarmKeeper
from service.fleet.databases import Partitions, engine_of, partition_backend
from service.fleet.fence import Fence
from service.fleet.front import serve_front
from service.fleet.front_board import FleetBoard
from service.fleet.front_kept import FleetAlarms, FleetAudit, FleetJobs, FleetNames
from service.fleet.layout import ASSETS, partition_of
from service.fleet.rows import put, row_of
from service.json_text import plain
from service.results.board import Board
from service.results.sql_store import SqlStore
from service.settings import Settings
from service.transport.zenoh_session import open_session

PARTITIONS = 3


def taken(database, partition=0, **given):
    return SqlStore(partition_backend(database, Fence(partition=partition, **given), PARTITIONS), claimed=True)


@contextmanager
def routed():
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_session([endpoint]):
        yield endpoint


@contextmanager
def worker(folder, database, endpoint, asset="unsw", **settings):
    """A process that serves the partition of an asset."""
    partition = partition_of(asset, PARTITIONS)
    process = PartitionProcess(folder, database, endpoint, partition=partition, partitions=PARTITIONS, **settings)
    try:
        yield process.start()
    finally:
        process.end()
        print(process.err.read_text())


def row(database, asset="unsw"):
    engine = engine_of(database, poolclass=sa.NullPool)
    with engine.connect() as db:
        return db.execute(sa.select(ASSETS).where(ASSETS.c.asset == asset)).mappings().first()


def windows(database, partition):
    shared = Partitions(database, PARTITIONS)
    with SqlStore(shared.backend(partition)) as store:
        found = [plain(w.record) for w in store.windows("unsw")]
    shared.close()
    return found


@contextmanager
def front(database, data, **settings):
    """A front end in a thread of this process; its address."""
    ready, stop = Future(), threading.Event()
    given = Settings(database=database, data=data, http="127.0.0.1:0", **settings)

    def serve():
        try:
            serve_front(given, announce=ready.set_result, stop=stop)
        except Exception as error:
            ready.set_exception(error)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield ready.result(60).rstrip("/")
    finally:
        stop.set()
        thread.join(20)
        assert not thread.is_alive()


def as_a_front_end(monkeypatch, store):
    """An app over the store has what a front end gives it besides."""
    monkeypatch.setattr(api, "AlarmStore", lambda database: FleetAlarms(store))
    monkeypatch.setattr(api, "Jobs", lambda database: FleetJobs(store))
    monkeypatch.setattr(api, "Names", lambda database: FleetNames(store))
    monkeypatch.setattr(api, "AuditLog", FleetAudit)


class WrittenBoard:
    """What a front end shows, with what a worker does to its own board written to the rows at once."""

    def __init__(self, store):
        self.store, self._own = store, Board()
        self.shown = FleetBoard(store, AlarmKeeper(FleetAlarms(store)))

    def __getattr__(self, name):
        return getattr(self.shown, name)

    def add_window(self, asset, window, **changes):
        return self._written(self._own.add_window(asset, window, **changes))

    def update(self, asset, **changes):
        self._written(self._own.update(asset, **changes))
        return self.shown.update(asset, **changes)

    def _written(self, snapshot):
        with self.store.database.transaction() as db:
            put(db, [row_of(snapshot, self.store.places.partition_of(snapshot.asset))])
        self.shown.changed([snapshot.asset])
        return snapshot
