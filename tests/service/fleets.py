"""Fleets of three partitions for tests: their database, workers of partitions, and what they have stored."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from functools import partial

import sqlalchemy as sa
from fleet_partition import PartitionProcess
from service_streams import free_port

from service.fleet.databases import Partitions, engine_of, partition_backend
from service.fleet.fence import Fence
from service.fleet.front import serve_front
from service.fleet.layout import ASSETS, partition_of
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
    address, ready, stop = [], threading.Event(), threading.Event()

    def announce(where):
        address.append(where.rstrip("/"))
        ready.set()

    given = Settings(database=database, data=data, http="127.0.0.1:0", **settings)
    thread = threading.Thread(target=partial(serve_front, given, announce=announce, stop=stop))
    thread.start()
    try:
        assert ready.wait(60)
        yield address[0]
    finally:
        stop.set()
        thread.join(20)
        assert not thread.is_alive()
