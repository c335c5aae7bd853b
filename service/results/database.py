"""One database, shared by everything that is kept: windows, decisions, events and what else there is.

    with database.transaction() as db:      # one transaction, also where several stores write within it
        db.execute(...)

SQLite in WAL mode by default, PostgreSQL where its URL is given. One transaction at a time writes, or as many as the
backend lets write; reading has connections of its own and waits for no writer. A committed transaction outlives the
process and the machine's power.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import sqlalchemy as sa
from sqlalchemy import Connection, Executable
from sqlalchemy.exc import DBAPIError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.errors import SteppedBack, StorageUnavailable, StoreError
from service.results.at_work import AtWork
from service.results.backends import Backend, backend_of
from service.results.commit_marks import Mark, is_there
from service.results.commit_watch import CommitWatch, Shown
from service.results.migrate import upgrade
from service.results.names import taken
from service.results.schema import ASSETS, JOBS, NAMES, PEOPLES, WINDOW
from service.results.storage_faults import storage_error
from service.steady_clock import later_time_ns

T = TypeVar("T")

LOST_WITHIN = 1.0  # a connection that is found lost later than that is one that the server did not answer on [s]
_SHARE = sa.select(ASSETS.c.share).where(ASSETS.c.asset == sa.bindparam("of"))
_OF_ASSET = JOBS.c.asset == ASSETS.c.asset
_ASKED = sa.exists().where(_OF_ASSET, sa.text(PEOPLES))
_WAITS = sa.exists().where(_OF_ASSET, JOBS.c.kind == WINDOW, JOBS.c.held == 0)
_SINCE = sa.func.coalesce(sa.func.nullif(ASSETS.c.due, 0), sa.bindparam("now"))
_DUE = (
    sa.update(ASSETS)
    .where(ASSETS.c.asset.in_(sa.bindparam("of", expanding=True)))
    .values(due=sa.case((_ASKED, 0), (_WAITS, _SINCE), else_=None))
)


class _Begun(threading.local):
    """What the present thread has begun.

    db       of its transaction
    ensured  assets of which the transaction has made sure that they have a row
    due      those of which other jobs wait by now
    shown    the rows that it has written by which assets are shown
    """

    db: Connection | None = None
    ensured: set[str]
    due: set[str]
    shown: set[Shown]


Took = Callable[[str, float], object]


class Database:
    """One database, for several threads of one process."""

    def __init__(
        self,
        where: Path | str | Backend,
        *,
        claimed: bool = False,
        shared: bool = False,
        took: Took = lambda what, seconds: None,
    ) -> None:
        """where    file of an SQLite database, the URL of a PostgreSQL database, or how another one is connected to
        claimed  whether no other service may write to it meanwhile
        shared   whether another process of this service has it open, and has examined it
        took     called with `commit` or `read` and how long a transaction or a query has taken [s]
        """
        self.backend: Backend = backend_of(where) if isinstance(where, Path | str) else where
        self._took = took
        self._insert_asset = self.backend.insert(ASSETS).on_conflict_do_nothing().returning(ASSETS.c.asset)
        self._insert_name = self.backend.insert(NAMES).on_conflict_do_nothing().returning(NAMES.c.name)
        self._turns = threading.BoundedSemaphore(self.backend.writers)
        self._present = _Begun()
        self._alone = claimed
        self._newest: Mark | None = None  # of the transactions that were confirmed to this process
        self._has_row: set[str] = set()  # assets that have a row for certain: nobody else may write
        try:
            with self._faults():
                if claimed:
                    self.backend.claim()  # before its schema is changed under another service
                if self.backend.upgrades and not shared:
                    upgrade(self.backend)
                self._writer, self._reader = self.backend.engines()
                sa.event.listen(self._writer, "connect", self._look_back)
                if not shared:
                    self.backend.examine(self._reader)
            if claimed:
                with suppress(StorageUnavailable), self.transaction():
                    pass  # leaves a mark: a database without it lacks what is read from now on
        except StorageUnavailable:
            self.backend.release()
            raise
        except (StoreError, SQLAlchemyError, OSError) as error:
            self.backend.release()
            raise StoreError(
                f"{self.backend.name} cannot be used as the service's database: {_one_line(error)}"
            ) from error

    @property
    def path(self) -> Path | None:
        """The file of an SQLite database."""
        return self.backend.path

    @property
    def share(self) -> int | None:
        """The share of the assets that whoever opened it works on; None for all of them."""
        return self.backend.share

    def own(self, asset: sa.ColumnElement[str]) -> sa.ColumnElement[bool]:
        """Whether the asset of a column is one of the share."""
        if self.share is None:
            return sa.true()
        if asset is ASSETS.c.asset:
            return ASSETS.c.share == self.share
        return asset.in_(sa.select(ASSETS.c.asset).where(ASSETS.c.share == self.share))

    def close(self) -> None:
        """Closes all connections."""
        with self._turns:
            self._writer.dispose()
            self._reader.dispose()

    def insert(self, table: sa.Table) -> Any:
        """An insertion that can be made to say what is to be done where the row is there already."""
        return self.backend.insert(table)

    def add(self, db: Connection, table: sa.Table, row: Mapping[str, Any]) -> int:
        """Adds a row to a table that numbers its rows; the number."""
        key = db.execute(sa.insert(table), dict(row)).inserted_primary_key
        assert key is not None
        return key[0]

    def ensure(self, db: Connection, asset: str, beside: str | None = None) -> None:
        """Has a row for an asset, which the rows of other tables refer to; it comes before all else that is written.

        beside  another asset, of whose share a new one is

        InputError where another asset has or had the name, or the asset is of another share.
        """
        if asset in self._present.ensured:
            return
        self.backend.turn(db, asset)
        if asset in self._has_row:
            self._present.ensured.add(asset)
            return
        share = db.execute(_SHARE, {"of": asset}).scalar()
        if share is None:
            share = self.backend.share_of(asset)
            if beside is not None:
                share = db.execute(_SHARE, {"of": beside}).scalar_one()
            given = {"asset": asset, "label": asset, "share": share}
            name = {"name": asset, "asset": asset, "labelled": asset}
            if not (db.execute(self._insert_asset, given).first() and db.execute(self._insert_name, name).first()):
                raise taken(asset)
            self.named(db, asset, asset)
        if self.share not in (None, share):
            raise taken(asset)
        self._present.ensured.add(asset)

    def update_due(self, db: Connection, *assets: str) -> None:
        """Determines anew since when jobs of assets wait, at the end of a transaction that adds or ends some."""
        for asset in assets:
            self.ensure(db, asset)
        self._present.due.update(assets)

    def show(self, shown: Collection[Shown]) -> None:
        """Notes the rows by which assets are shown that the present transaction has written."""
        self._present.shown.update(shown)

    def named(self, db: Connection, asset: str, name: str) -> None:
        """Within the transaction that gives an asset a name."""
        self.backend.named(db, asset, name)

    @contextmanager
    def transaction(self) -> Iterator[Connection]:
        """A transaction that is committed at the end, or rolled back whole; one within another is part of it.

        StorageUnavailable where the storage cannot be used now, StoreError where it is damaged; then nothing changed,
        except where the error says that the outcome is unknown.
        """
        if self._present.db is not None:
            yield self._present.db
            return
        with self._turns:
            began = time.monotonic()
            with self._faults():
                self.backend.verify()
                with self._writer.connect() as db:
                    with self._begun(db):
                        yield db
                        if self._present.due:
                            db.execute(_DUE, {"of": sorted(self._present.due), "now": later_time_ns()})
                        mark, ensured, shown = self.backend.mark(db), self._present.ensured, self._present.shown
                    self._commit(db, mark)
                self._newest = mark or self._newest
                if self._alone:
                    self._has_row |= ensured
                self.backend.tell(self._reader, shown if ensured else None)
            self._took("commit", time.monotonic() - began)

    @contextmanager
    def _begun(self, db: Connection) -> Iterator[None]:
        """A transaction that is rolled back where its work fails."""
        db.begin()
        self._present.db, self._present.ensured, self._present.due = db, set(), set()
        self._present.shown = set()
        try:
            self.backend.begun(db)
            yield
        except BaseException:
            with suppress(SQLAlchemyError):  # the connection may be what has failed
                db.rollback()
            raise
        finally:
            self._present.db = None

    def _look_back(self, connection: Any, _: object) -> None:
        """SteppedBack where a new connection leads to a database that lacks what was confirmed to this process.

        Once, where the claim is another's: whoever has it begins anew, or only an answer was lost. The mark of who has
        written nothing for a week may have been deleted: then nobody knows, and beginning anew is what loses nothing.
        """
        if self._newest is None or is_there(connection, self._newest):
            return
        if not self._alone:
            self._newest = None
        connection.close()
        raise SteppedBack(
            f"{self.backend.name} does not have what it had confirmed: it was put back, or another server took its "
            "place; the service begins anew from what is there",
            reason="connection lost",
        )

    def _commit(self, db: Connection, mark: Mark | None) -> None:
        """Commits; where the connection is lost meanwhile, a new one says whether it was committed."""
        try:
            db.commit()
        except DBAPIError as error:
            with suppress(SQLAlchemyError):
                db.rollback()
            if mark is None or not error.connection_invalidated:
                raise
            if not self.backend.was_committed(self._reader, mark):
                raise

    def rows(self, query: Executable, values: Mapping[str, Any] | None = None) -> list[Any]:
        """All rows that a query answers, within the thread's transaction where it has one; errors as those of it."""
        with self._faults():
            if self._present.db is not None:
                return list(self._present.db.execute(query, values).all())
            return self._read(lambda db: list(db.execute(query, values).all()))

    def _read(self, read: Callable[[Connection], T]) -> T:
        """What is read on a connection; on another one where that was lost before."""
        began = time.monotonic()
        try:
            with self._reader.connect() as db:
                found = read(db)
        except DBAPIError as error:
            if not error.connection_invalidated or time.monotonic() - began > LOST_WITHIN:
                raise
            with self._reader.connect() as db:
                found = read(db)
        self._took("read", time.monotonic() - began)
        return found

    @contextmanager
    def watching(self) -> Iterator[CommitWatch]:
        """For one thread that waits until something is committed."""
        watch = self.backend.watching()
        try:
            yield watch
        finally:
            watch.close()

    def at_work(self) -> AtWork:
        """The assets that this process is at work on."""
        return self.backend.at_work()

    def size(self) -> int:
        """What the database takes, with its write-ahead log [bytes]."""
        with self._faults():
            return self._read(self.backend.size)

    @contextmanager
    def _faults(self) -> Iterator[None]:
        """Failures of the storage as errors of the service."""
        try:
            yield
        except DBAPIError as error:
            meant = storage_error(error.orig or error, self.backend.name, lost=error.connection_invalidated)
            if meant is None:
                raise
            self.backend.verify()  # says more of a file that is gone than the driver does
            raise meant from error
        except UnicodeDecodeError as error:  # SQLite's own text, where damage reaches it
            raise StoreError(f"{self.backend.name} is damaged: what it says cannot be read as text") from error
        except PoolTimeout as error:
            text = f"{self.backend.name} cannot be used now (locked): all connections are in use"
            raise StorageUnavailable(text, reason="locked") from error


def _one_line(error: BaseException) -> str:
    return str(error).strip().split("\n")[0]
