"""How a fleet's tables are connected to: by whoever has a partition, and by all others.

Both are backends of `service.results.database.Database`, so that every store of the service works on a fleet as it does
on a database of its own: on one partition's share of the assets, or on all of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy import Connection, Engine, event
from sqlalchemy.engine import URL
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import NullPool

from service.errors import InputError, StoreError
from service.fleet.fence import ABANDONED, Fence
from service.fleet.layout import SCHEMA, Layout, expect_revision, layout_of
from service.results.backends import LOCK_WAIT, STATEMENT_WAIT, Postgresql, backend_of, keep_commits
from service.results.commit_marks import Mark
from service.results.commit_watch import NAMED, tell_server
from service.results.database import Database
from service.results.schema import ASSETS
from service.results.storage_faults import storage_error
from service.settings import Settings

READERS = 2  # connections that are kept for reading; twice as many more are opened when needed
FRONT_READERS, FRONT_WRITERS = 8, 4  # those of one front end; threads of it that write at the same time
_SHARE = sa.select(ASSETS.c.share).where(ASSETS.c.asset == sa.bindparam("of"))
_OPTIONS = f"-c idle_in_transaction_session_timeout={ABANDONED} -c search_path={SCHEMA}"


def url_of(database: str) -> URL:
    """The address of a fleet's database; StoreError where it is not one of PostgreSQL."""
    backend = backend_of(database)
    if not isinstance(backend, Postgresql):
        raise StoreError("the database of a fleet must be PostgreSQL: postgresql://user@host/name")
    return backend.url


def database_of(settings: Settings) -> str:
    """The URL of the fleet's database; InputError where none is set."""
    if settings.database is None:
        raise InputError(
            "a fleet needs a PostgreSQL database that all its machines reach: --database postgresql://user@host/name"
        )
    return settings.database.get_secret_value()


def tables_at(database: str) -> URL:
    """The address with the options of sessions that use the fleet's tables."""
    url = url_of(database)
    present = url.query.get("options")
    return url.update_query_dict({"options": f"{present} {_OPTIONS}" if isinstance(present, str) else _OPTIONS})


def engine_of(database: str, **given: Any) -> Engine:
    """Connections to a fleet's tables."""
    return Postgresql(tables_at(database)).engine(STATEMENT_WAIT, **given)


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


def layout_at(database: str) -> Layout:
    """The layout of a database's fleet; StoreError where there is none."""
    with reached(database):
        found = layout_of(engine_of(database, poolclass=NullPool))
    if found is None:
        raise StoreError("the database holds no fleet: gear-twin fleet up makes one")
    return found


@dataclass(slots=True, kw_only=True)
class FleetTables(Postgresql):
    """For whoever works on the assets of all partitions, or records those of one.

    called   how the server shows its sessions
    share    the partition
    readers  connections that are kept for reading; as many more when needed
    writers  threads that write at the same time
    """

    layout: Layout
    called: str
    share: int | None = None
    readers: int = READERS
    writers: int = 1
    upgrades: bool = False

    @property
    def name(self) -> str:
        plain = self.url.set(drivername="postgresql").difference_update_query(["options"])
        where = plain.render_as_string(hide_password=True)
        return where if self.share is None else f"partition {self.share} of {where}"

    def share_of(self, asset: str) -> int:
        return self.layout.partition_of(asset) if self.share is None else self.share

    def named(self, db: Connection, asset: str, name: str) -> None:
        """Says it where the name hashes to another partition than that of the asset."""
        if db.execute(_SHARE, {"of": asset}).scalar() != self.layout.partition_of(name):
            tell_server(db.execute, {NAMED})

    def engines(self) -> tuple[Engine, Engine]:
        """For transactions and for reading."""
        pool = {"pool_size": self.readers, "max_overflow": 2 * self.readers, "pool_timeout": LOCK_WAIT}
        return self._claiming or self._writing(), self.reader(self.called, **pool)

    def begun(self, db: Connection) -> None:
        expect_revision(db)

    def _writing(self) -> Engine:
        """Connections whose commits outlive a crash of the server from the first one on."""
        engine = self.engine(
            STATEMENT_WAIT, self.called, pool_size=self.writers, max_overflow=0, pool_timeout=LOCK_WAIT
        )
        event.listen(engine, "connect", keep_commits)
        return engine


@dataclass(slots=True, kw_only=True)
class PartitionTables(FleetTables):
    """For whoever takes a partition and receives its frames: what it writes is fenced."""

    fence: Fence
    _mark: Mark | None = None  # of the present transaction

    def claim(self) -> None:
        """Takes the partition from whoever has it."""
        engine = self._writing()
        try:
            with engine.begin() as db:
                self.fence.take(db)
        except BaseException:
            engine.dispose()
            raise
        self._claiming = engine

    def begun(self, db: Connection) -> None:
        self._mark = self.fence.marked(db, *self.next_transaction())

    def mark(self, db: Connection) -> Mark:
        assert self._mark is not None
        return self._mark


def partition_tables(database: str, fence: Fence, layout: Layout) -> PartitionTables:
    """The tables for whoever takes a partition, to be opened with `claimed=True`."""
    return PartitionTables(
        tables_at(database), share=fence.partition, fence=fence, layout=layout, called=fence.application
    )


def fleet_tables(database: str, layout: Layout, called: str, share: int | None = None) -> Database:
    """The tables for another process of a host.

    share  the partition of whoever records one
    """
    return Database(FleetTables(tables_at(database), layout=layout, called=called, share=share), shared=True)


def front_tables(database: str, layout: Layout) -> FleetTables:
    """The tables for a front end, whose threads write at the same time."""
    return FleetTables(
        tables_at(database), layout=layout, called="gear-twin front end", readers=FRONT_READERS, writers=FRONT_WRITERS
    )
