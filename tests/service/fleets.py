"""Fleets of three partitions for tests: their database, workers of partitions, and what they have stored."""

from __future__ import annotations

import json
import threading
from concurrent.futures import Future
from contextlib import contextmanager

import sqlalchemy as sa
from fleet_partition import PartitionProcess
from service_streams import free_port

from service.fleet.databases import engine_of, front_tables, partition_tables
from service.fleet.fence import Fence
from service.fleet.front import serve_front
from service.fleet.layout import Layout, partition_of
from service.json_text import plain
from service.results.schema import ASSETS
from service.results.sql_store import SqlStore
from service.settings import Settings
from service.transport.zenoh_session import open_session

PARTITIONS = 3


def taken(database, partition=0, **given):
    """The store of whoever has taken a partition."""
    return SqlStore(partition_tables(database, Fence(partition=partition, **given), Layout(PARTITIONS)), claimed=True)


def at_front(database):
    """The store of a front end."""
    return SqlStore(front_tables(database, Layout(PARTITIONS)))


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
    """The row of an asset; None where it has none."""
    engine = engine_of(database, poolclass=sa.NullPool)
    with engine.connect() as db:
        found = db.execute(sa.select(ASSETS).where(ASSETS.c.asset == asset)).mappings().first()
    if found is None:
        return None
    return {**found, "summary": json.loads(found["summary"] or '{"windows": 0}')}  # written with the first window


def windows(database, asset="unsw"):
    """The records of an asset's windows."""
    with at_front(database) as store:
        return [plain(w.record) for w in store.windows(asset)]


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
