"""Fleets of three partitions for tests: their database, workers of partitions, and what they have stored."""

from __future__ import annotations

import json
import threading
from concurrent.futures import Future
from contextlib import contextmanager

import sqlalchemy as sa
from fleet_partition import PartitionProcess
from service_fakes import Written
from service_streams import free_port

from service import api
from service.alarms.keeper import AlarmKeeper
from service.fleet.databases import Partitions, engine_of, partition_backend
from service.fleet.fence import Fence
from service.fleet.front import serve_front
from service.fleet.front_board import FleetBoard
from service.fleet.front_database import tables_of
from service.fleet.front_kept import FleetAlarms, FleetAudit, FleetJobs, FleetNames
from service.fleet.layout import partition_of
from service.json_text import plain
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
    """The row of an asset, in the partition that has it."""
    engine = engine_of(database, poolclass=sa.NullPool)
    with engine.connect() as db:
        made = sa.inspect(db).get_schema_names()
        for number in (number for number in range(PARTITIONS) if f"p{number:03d}" in made):
            table = tables_of(number)["assets"]
            found = db.execute(sa.select(table).where(table.c.asset == asset)).mappings().first()
            if found is not None:
                summary = json.loads(found["summary"] or '{"windows": 0}')  # written with the first window
                return {**found, "partition": number, "summary": summary}
    return None


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


class WrittenFleetBoard(Written, FleetBoard):
    """What a front end answers, with what a worker shows written at once."""


def written_board(store):
    """As a front end's table."""
    return WrittenFleetBoard(store, AlarmKeeper(FleetAlarms(store)))


def as_a_front_end(monkeypatch, store):
    """An app over the store has what a front end gives it besides."""
    monkeypatch.setattr(api, "AlarmStore", lambda database: FleetAlarms(store))
    monkeypatch.setattr(api, "Jobs", lambda database: FleetJobs(store))
    monkeypatch.setattr(api, "Names", lambda database: FleetNames(store))
    monkeypatch.setattr(api, "AuditLog", FleetAudit)
