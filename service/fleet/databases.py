"""How a partition's tables are connected to: by the worker that has the partition, and by the front ends.

Both are backends of `service.results.database.Database`, so that every store of the service works on a partition as it
does on a database of its own.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import sqlalchemy as sa
from sqlalchemy import Connection, Engine, event
from sqlalchemy.engine import URL
from sqlalchemy.exc import DBAPIError

from service.errors import StoreError
from service.fleet.fence import ABANDONED, Fence, Fenced, lock
from service.fleet.layout import Layout, expect_revision, schema_of, separate_numbers
from service.fleet.naming import named
from service.fleet.notices import announce, say
from service.results.backends import LOCK_WAIT, STATEMENT_WAIT, Postgresql, backend_of, keep_commits
from service.results.commit_marks import Mark
from service.results.database import Database
from service.results.job_queue import ASSET
from service.results.migrate import VERSION_TABLE
from service.results.storage_faults import storage_error

READERS = 2  # connections of one worker that are kept for reading; as many more are opened when needed
FRONT_READERS, FRONT_WRITERS = 8, 2  # connections of one front end
AGAIN = 0.2  # after which a table that somebody else makes is looked for [s]
_MAKING = 7_219_435  # the lock of whoever makes a partition's tables; other numbers are in `layout` and `front_kept`
_ABANDONED = f"-c idle_in_transaction_session_timeout={ABANDONED}"


def url_of(database: str) -> URL:
    """The address of a fleet's database; StoreError where it is not one of PostgreSQL."""
    backend = backend_of(database)
    if not isinstance(backend, Postgresql):
        raise StoreError("the database of a fleet must be PostgreSQL: postgresql://user@host/name")
    return backend.url


def engine_of(database: str, **given: Any) -> Engine:
    """Connections to what all partitions share."""
    return Postgresql(with_options(url_of(database), _ABANDONED)).engine(STATEMENT_WAIT, **given)


@contextmanager
def reached(database: str) -> Iterator[None]:
    """Failures of the fleet's database as errors of the service: StorageUnavailable where it may work again later."""
    try:
        yield
    except DBAPIError as error:
        name = url_of(database).set(drivername="postgresql").render_as_string(hide_password=True)
        meant = storage_error(error.orig or error, name, lost=error.connection_invalidated)
        if meant is None:
            raise
        raise meant from error


def with_options(url: URL, *options: str) -> URL:
    """The address with more options of the server's sessions."""
    present = url.query.get("options")
    return url.update_query_dict({"options": " ".join([*([present] if isinstance(present, str) else []), *options])})


@dataclass(slots=True, kw_only=True)
class PartitionTables(Postgresql):
    """The tables of one partition, for the worker that takes it.

    partitions  of the fleet
    """

    fence: Fence
    partitions: int
    _mark: Mark | None = None  # of the present transaction

    @property
    def name(self) -> str:
        plain = self.url.set(drivername="postgresql").difference_update_query(["options"])
        return f"partition {self.fence.partition} of {plain.render_as_string(hide_password=True)}"

    def claim(self) -> None:
        """Takes the partition from whoever has it."""
        engine = self._writer()
        try:
            with engine.begin() as db:
                db.exec_driver_sql(f"CREATE SCHEMA IF NOT EXISTS {schema_of(self.fence.partition)}")
                self.fence.take(db)
        except BaseException:
            engine.dispose()
            raise
        self._claiming = engine

    def engines(self) -> tuple[Engine, Engine]:
        """For transactions, of one connection, and for reading."""
        writer = self._claiming or self._writer()
        with writer.begin() as db:
            self.fence.check(db)
            separate_numbers(db, self.fence.partition, self.partitions)
        reader = self._own(pool_size=READERS, max_overflow=2 * READERS, pool_timeout=LOCK_WAIT)
        return writer, reader.execution_options(isolation_level="AUTOCOMMIT")

    def begun(self, db: Connection) -> None:
        self._mark = self.fence.marked(db, *self.next_transaction())

    def mark(self, db: Connection) -> Mark:
        assert self._mark is not None
        return self._mark

    def named(self, db: Connection, asset: str, name: str) -> None:
        named(db, asset, name, self.fence.partition, Layout(self.partitions))

    def shown(self, db: Connection, assets: Sequence[str]) -> None:
        say(db, assets)

    def _writer(self) -> Engine:
        """One connection, whose commits outlive a crash of the server from the first one on."""
        engine = self._own(pool_size=1, max_overflow=0, pool_timeout=LOCK_WAIT)
        event.listen(engine, "connect", keep_commits)
        return engine

    def _own(self, **pool: Any) -> Engine:
        return self.engine(STATEMENT_WAIT, self.fence.application, **pool)


def partition_backend(database: str, fence: Fence, partitions: int) -> PartitionTables:
    """The tables of a partition, to be opened with `claimed=True`."""
    search_path = f"-c search_path={schema_of(fence.partition)}"
    url = with_options(url_of(database), _ABANDONED, search_path)
    return PartitionTables(url, fence=fence, partitions=partitions)


@dataclass(slots=True, kw_only=True)
class SharedTables(Postgresql):
    """The tables of one partition, for a front end: all partitions share its connections.

    partitions        of the fleet
    readers, writers  of all partitions
    """

    partition: int
    partitions: int
    readers: Engine
    writers: Engine
    upgrades: bool = False

    def engines(self) -> tuple[Engine, Engine]:
        """For transactions and for reading, in the schema of the partition."""
        here = {"schema_translate_map": {None: schema_of(self.partition)}}
        return (
            self.writers.execution_options(**here),
            self.readers.execution_options(isolation_level="AUTOCOMMIT", **here),
        )

    def begun(self, db: Connection) -> None:
        expect_revision(db)
        lock(db, self.partition)

    def named(self, db: Connection, asset: str, name: str) -> None:
        """An asset that a front end has made is the worker's from now on."""
        named(db, asset, name, self.partition, Layout(self.partitions))
        announce(db, self.partition, ASSET, asset)

    def shown(self, db: Connection, assets: Sequence[str]) -> None:
        say(db, assets)


class Partitions:
    """The databases of all partitions over a few connections, opened when they are first asked for."""

    def __init__(self, database: str, partitions: int) -> None:
        self._url = with_options(url_of(database), _ABANDONED)
        engine = partial(Postgresql(self._url).engine, STATEMENT_WAIT, "gear-twin front end", pool_timeout=LOCK_WAIT)
        self.readers: Engine = engine(pool_size=FRONT_READERS, max_overflow=FRONT_READERS)
        self.writers: Engine = engine(pool_size=FRONT_WRITERS, max_overflow=FRONT_WRITERS)
        event.listen(self.writers, "connect", keep_commits)
        self.count = partitions

    def backend(self, partition: int) -> SharedTables:
        """The tables of one partition."""
        return SharedTables(
            self._url, partition=partition, partitions=self.count, readers=self.readers, writers=self.writers
        )

    def close(self) -> None:
        """Closes all connections."""
        self.readers.dispose()
        self.writers.dispose()


def made(database: str, partition: int, partitions: int) -> None:
    """Makes the tables of a partition before a worker has it, so that front ends can read them; or finds them.

    A partition whose tables are there is left alone: its worker brings them to a newer schema.
    """
    engine = engine_of(database, poolclass=sa.NullPool)
    with engine.connect() as db:
        db.exec_driver_sql(f"SELECT pg_advisory_lock({_MAKING})")  # until the connection is closed
        db.commit()
        while not sa.inspect(db).has_table(VERSION_TABLE, schema=schema_of(partition)):
            db.commit()
            try:
                Database(partition_backend(database, Fence(partition=partition), partitions), claimed=True).close()
            except StoreError as error:  # a worker has taken the partition meanwhile, and makes them
                if not isinstance(error.__cause__, Fenced):
                    raise
                time.sleep(AGAIN)
