"""How a fleet's tables are connected to: by the worker that has a partition, and by the front ends.

Both are backends of `service.results.database.Database`, so that every store of the service works on a fleet as it does
on a database of its own: a worker's on its share of the assets, a front end's on all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Engine, event
from sqlalchemy.engine import URL
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import NullPool

from service.errors import StoreError
from service.fleet.fence import ABANDONED, Fence, locked
from service.fleet.layout import SCHEMA, Layout, expect_revision, layout_of
from service.fleet.notices import ASSET, NAMED, announce, say
from service.results.backends import LOCK_WAIT, STATEMENT_WAIT, Postgresql, backend_of, keep_commits
from service.results.commit_marks import Mark
from service.results.sql_store import SqlStore
from service.results.storage_faults import storage_error

READERS = 2  # connections of one worker that are kept for reading; as many more are opened when needed
FRONT_READERS, FRONT_WRITERS = 8, 2  # connections of one front end that are kept; as many more when needed
_OPTIONS = f"-c idle_in_transaction_session_timeout={ABANDONED} -c search_path={SCHEMA}"


def url_of(database: str) -> URL:
    """The address of a fleet's database; StoreError where it is not one of PostgreSQL."""
    backend = backend_of(database)
    if not isinstance(backend, Postgresql):
        raise StoreError("the database of a fleet must be PostgreSQL: postgresql://user@host/name")
    return backend.url


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
class _FleetTables(Postgresql):
    """What workers and front ends have in common."""

    layout: Layout
    share: int | None = None
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
        hashed = self.layout.partition_of(name)
        if self.share not in (None, hashed):
            for each in (self.share, hashed):
                announce(db, each, NAMED, name)

    def shown(self, db: Connection, assets: Sequence[str]) -> None:
        say(db, assets)

    def _writing(self, name: str, **pool: Any) -> Engine:
        """Connections whose commits outlive a crash of the server from the first one on."""
        engine = self.engine(STATEMENT_WAIT, name, pool_timeout=LOCK_WAIT, **pool)
        event.listen(engine, "connect", keep_commits)
        return engine


@dataclass(slots=True, kw_only=True)
class WorkerTables(_FleetTables):
    """For the worker that takes a partition: what it writes is fenced."""

    fence: Fence
    _mark: Mark | None = None  # of the present transaction

    def claim(self) -> None:
        """Takes the partition from whoever has it."""
        engine = self._writing(self.fence.application, pool_size=1, max_overflow=0)
        try:
            with engine.begin() as db:
                self.fence.take(db)
        except BaseException:
            engine.dispose()
            raise
        self._claiming = engine

    def engines(self) -> tuple[Engine, Engine]:
        """For transactions, of one connection, and for reading."""
        assert self._claiming is not None
        pool = {"pool_size": READERS, "max_overflow": 2 * READERS, "pool_timeout": LOCK_WAIT}
        reader = self.engine(STATEMENT_WAIT, self.fence.application, **pool)
        return self._claiming, reader.execution_options(isolation_level="AUTOCOMMIT")

    def begun(self, db: Connection) -> None:
        self._mark = self.fence.marked(db, *self.next_transaction())

    def mark(self, db: Connection) -> Mark:
        assert self._mark is not None
        return self._mark


@dataclass(slots=True, kw_only=True)
class FrontTables(_FleetTables):
    """For a front end, whose threads write at the same time; what they write is announced to the asset's worker."""

    writers: int = 2 * FRONT_WRITERS

    def engines(self) -> tuple[Engine, Engine]:
        """For transactions and for reading."""
        name, pool = "gear-twin front end", {"pool_size": FRONT_READERS, "max_overflow": FRONT_READERS}
        reader = self.engine(STATEMENT_WAIT, name, pool_timeout=LOCK_WAIT, **pool)
        writer = self._writing(name, pool_size=FRONT_WRITERS, max_overflow=FRONT_WRITERS)
        return writer, reader.execution_options(isolation_level="AUTOCOMMIT")

    def begun(self, db: Connection) -> None:
        expect_revision(db)

    def turn(self, db: Connection, asset: str) -> None:
        """Takes its turn among the transactions of the asset's worker, which looks at the asset afterwards."""
        announce(db, locked(db, asset, self.layout.partition_of(asset)), ASSET, asset)


def worker_tables(database: str, fence: Fence, layout: Layout) -> WorkerTables:
    """The tables for the worker of a partition, to be opened with `claimed=True`."""
    return WorkerTables(tables_at(database), share=fence.partition, fence=fence, layout=layout)


@dataclass(slots=True, kw_only=True)
class _JoinedTables(WorkerTables):
    """For another process of the worker that has taken a partition: as long as that worker has it."""

    def engines(self) -> tuple[Engine, Engine]:
        self._claiming = self._writing(self.fence.application, pool_size=1, max_overflow=0)
        return WorkerTables.engines(self)  # `super` does not find itself in a class with slots


def joined(database: str, fence: Fence, layout: Layout) -> SqlStore:
    """The results of a partition for a process that computes, as long as the worker has the partition."""
    own = _JoinedTables(tables_at(database), share=fence.partition, fence=fence, layout=layout)
    return SqlStore(own, shared=True)


def front_tables(database: str, layout: Layout) -> FrontTables:
    """The tables for a front end."""
    return FrontTables(tables_at(database), layout=layout)
