"""The two databases: how each is connected to, so that it can be relied upon.

SQLite: one file in WAL mode, `synchronous=FULL`, foreign keys enforced; one connection writes, others read.
PostgreSQL: one connection writes, which holds the service's claim on the database, others read; one that was dropped
is replaced, and a transaction whose commit was not answered is asked for by its number.
"""

from __future__ import annotations

import itertools
import threading
import uuid
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import sqlalchemy as sa
from sqlalchemy import Connection, Engine, event
from sqlalchemy.dialects import sqlite
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError
from sqlalchemy.pool import NullPool, QueuePool

from service.errors import StorageUnavailable, StoreError
from service.results.at_work import AtWork, FileClaims, SessionClaims
from service.results.bounded_connection import connecting
from service.results.claims import Claims
from service.results.commit_marks import Mark, marked, was_committed
from service.results.commit_watch import CommitWatch, FileWatch, ServerWatch, Shown, say_committed, tell_server
from service.results.schema import ASSETS

LOCK_WAIT = 10.0  # how long a database that another program locks is waited for [s]
STATEMENT_WAIT = 40.0  # how long one statement of the service may take on a server; two, within a loop's turn [s]
CONNECT_WAIT = 5  # how long a server is waited for [s]
ANSWER_WAIT = 5.0  # beyond the time of a statement, until a server that says nothing is given up [s]
EXAMINED_BYTES = 100 * 2**20  # of a file that SQLite checks at each start: 0.3 s or less
READERS = 8  # connections that are kept for reading; as many more are opened when needed
SILENT_AFTER = {"keepalives_idle": 10, "keepalives_interval": 5, "keepalives_count": 3, "tcp_user_timeout": 20_000}
"""When a server that no longer answers counts as lost: [s], [s], tries, [ms]."""
NO_SHARED_MEMORY = ("SQLITE_IOERR_SHMOPEN", "SQLITE_IOERR_SHMMAP", "SQLITE_IOERR_SHMLOCK")
"""Errors of a file system that has no memory in common for the processes that have a file open."""


_TURN = sa.select(ASSETS.c.asset).where(ASSETS.c.asset == sa.bindparam("of")).with_for_update()


class Backend(Protocol):
    """What the two databases do in their own ways."""

    @property
    def name(self) -> str:
        """As a person knows it; without a password."""
        ...

    @property
    def path(self) -> Path | None: ...

    @property
    def upgrades(self) -> bool:
        """Whether whoever opens the database brings its tables to the newest schema."""
        ...

    @property
    def writers(self) -> int:
        """How many transactions of one process write at a time."""
        ...

    @property
    def share(self) -> int | None:
        """The share of the assets that is worked on; None for all of them."""
        ...

    def claim(self) -> None:
        """Keeps other services from writing, until the process ends. StorageUnavailable where another does already."""
        ...

    def release(self) -> None:
        """Gives up what `claim` holds."""
        ...

    def engines(self) -> tuple[Engine, Engine]:
        """For transactions, and for reading outside of them."""
        ...

    def for_migration(self) -> Engine:
        """One that leaves the schema's constraints out of account until the end, and waits longer."""
        ...

    def for_reading(self) -> Engine:
        """One that reads for as long as it takes, and holds up nobody who writes."""
        ...

    def examine(self, engine: Engine) -> None:
        """StoreError where the database is seen to be damaged at the first look."""
        ...

    def size(self, db: Connection) -> int:
        """What the database takes [bytes]."""
        ...

    def insert(self, table: sa.Table) -> Any: ...

    def verify(self) -> None:
        """StorageUnavailable where what is connected to is no longer the database."""
        ...

    def begun(self, db: Connection) -> None:
        """At the begin of each transaction; StoreError where it may not write."""
        ...

    def share_of(self, asset: str) -> int:
        """The share that a new asset is of."""
        ...

    def turn(self, db: Connection, asset: str) -> None:
        """Within a transaction, before it writes to an asset: other processes do so one after the other."""
        ...

    def named(self, db: Connection, asset: str, name: str) -> None:
        """Within the transaction that gives an asset a name."""
        ...

    def tell(self, engine: Engine, shown: Collection[Shown] | None) -> None:
        """After a transaction: whoever waits for one learns it, as a rule.

        shown  the rows that it has written by which assets are shown; None where it has written nothing of an asset
        """
        ...

    def watching(self) -> CommitWatch:
        """For one who waits until something is committed."""
        ...

    def at_work(self) -> AtWork:
        """For one process that works on assets."""
        ...

    def mark(self, db: Connection) -> Mark | None:
        """At the end of a transaction: what its outcome can be asked by; None where a commit always answers."""
        ...

    def was_committed(self, engine: Engine, mark: Mark) -> bool:
        """The outcome of a commit that was not answered; StorageUnavailable where nobody says in time."""
        ...


def backend_of(where: Path | str) -> Backend:
    """The backend of a file or a URL; StoreError where it is neither."""
    if isinstance(where, Path):
        return SqliteFile(where)
    try:
        url = make_url(where)
    except ArgumentError:
        raise StoreError("the setting database must be a URL such as postgresql://user@host/name") from None
    kind = url.get_backend_name()
    if kind == "sqlite" and url.database and url.database != ":memory:":
        return SqliteFile(Path(url.database))
    if kind in ("postgresql", "postgres"):
        return Postgresql(url.set(drivername="postgresql+psycopg"))
    raise StoreError(f"the setting database names {kind}; it must be postgresql://… or sqlite:///FILE")


class OneService:
    """What is so where one service has the database for itself: one transaction writes at a time."""

    upgrades: bool = True
    writers: int = 1
    share: int | None = None

    def begun(self, db: Connection) -> None:
        pass

    def share_of(self, asset: str) -> int:
        return 0

    def turn(self, db: Connection, asset: str) -> None:
        pass  # one transaction writes at a time

    def named(self, db: Connection, asset: str, name: str) -> None:
        pass


@dataclass(slots=True)
class SqliteFile(OneService):
    """A file of SQLite."""

    path: Path
    _inode: tuple[int, int] | None = None

    @property
    def name(self) -> str:
        return str(self.path)

    def claim(self) -> None:
        pass  # who holds the data directory holds the file in it

    def release(self) -> None:
        pass

    def engines(self) -> tuple[Engine, Engine]:
        self._make_file()
        writer = self._engine(["synchronous = FULL", "foreign_keys = ON"], pool_size=1, max_overflow=0)
        event.listen(writer, "begin", lambda db: db.exec_driver_sql("BEGIN IMMEDIATE"))
        with writer.connect():
            stat = self.path.stat()
            self._inode = (stat.st_dev, stat.st_ino)
        reader = self._engine(["query_only = ON"], pool_size=READERS, max_overflow=READERS)
        return writer, reader

    def for_migration(self) -> Engine:
        self._make_file()
        engine = self._engine(["synchronous = FULL", "foreign_keys = OFF"], poolclass=NullPool)
        event.listen(engine, "begin", lambda db: db.exec_driver_sql("BEGIN IMMEDIATE"))
        return engine

    def _make_file(self) -> None:
        """A new file is its owner's alone; those that SQLite keeps beside it have its mode."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if not self.path.exists():
            self.path.touch(mode=0o600)

    def for_reading(self) -> Engine:
        return self._engine(["query_only = ON"], poolclass=NullPool)

    def _engine(self, pragmas: list[str], **pool: Any) -> Engine:
        pool.setdefault("poolclass", QueuePool)
        engine = sa.create_engine("sqlite://", creator=lambda: self._connect("rw"), **pool)

        def prepare(connection: Any, _: object) -> None:
            self.verify()
            connection.isolation_level = None  # transactions begin where this program says so, those of DDL too
            _log_ahead(connection)
            for pragma in pragmas:
                connection.execute(f"PRAGMA {pragma}")

        event.listen(engine, "connect", prepare)
        return engine

    def _connect(self, mode: str) -> Any:
        """A connection to read (`ro`) or to write, too (`rw`); a file that is gone is not made anew, empty."""
        import sqlite3  # services with PostgreSQL do not load it

        file = f"{self.path.absolute().as_uri()}?mode={mode}"
        return sqlite3.connect(file, uri=True, check_same_thread=False, timeout=LOCK_WAIT)

    def examine(self, engine: Engine) -> None:
        """SQLite's own check, of indexes too, where the file is small enough for each start."""
        with engine.connect() as db:
            if self.path.stat().st_size <= EXAMINED_BYTES:
                found = db.exec_driver_sql("PRAGMA integrity_check(1)").scalar_one()
                if found != "ok":
                    raise StoreError(f"it is damaged: {' '.join(found.split())}")

    def size(self, db: Connection) -> int:
        """File and write-ahead log."""
        files = (self.path, self.path.with_name(f"{self.path.name}-wal"))
        return sum(file.stat().st_size for file in files if file.exists())

    def insert(self, table: sa.Table) -> Any:
        return sqlite.insert(table)

    def verify(self) -> None:
        """The file of this name is still the one that was opened: another would be written by nobody else's leave."""
        try:
            stat = self.path.stat()
            present = (stat.st_dev, stat.st_ino)
        except OSError:
            present = None
        if self._inode not in (None, present):
            raise StorageUnavailable(
                f"{self.path} cannot be used now (input or output): it was removed or replaced while the service runs; "
                "put it back, or start the service anew",
                reason="input or output",
            )

    def tell(self, engine: Engine, shown: Collection[Shown] | None) -> None:
        say_committed(self.path.parent)

    def watching(self) -> CommitWatch:
        return FileWatch(lambda: self._connect("ro"), self.path.parent)

    def at_work(self) -> AtWork:
        return FileClaims(self.path.with_name(f"{self.path.name}.work"))

    def mark(self, db: Connection) -> Mark | None:
        return None

    def was_committed(self, engine: Engine, mark: Mark) -> bool:
        raise AssertionError("a commit of SQLite always answers")


def _log_ahead(connection: Any) -> None:
    """Has a connection of SQLite use the write-ahead log; StoreError where the file system does not allow it."""
    try:
        ((mode,),) = connection.execute("PRAGMA journal_mode = WAL")
    except Exception as error:
        if getattr(error, "sqlite_errorname", None) not in NO_SHARED_MEMORY:
            raise
        mode = str(error)
    if mode != "wal":
        raise StoreError(
            f"its file system does not allow the write-ahead log (WAL) of SQLite ({mode}); "
            "set data to a folder on a disk of this computer, or database to a PostgreSQL"
        )


@dataclass(slots=True)
class Postgresql(OneService):
    """A database of a PostgreSQL server."""

    url: URL
    path: Path | None = None
    claims: Claims | None = None  # of a service ...
    _claiming: Engine | None = None  # ... and the connection for writing that holds them
    identity: str = field(default_factory=lambda: uuid.uuid4().hex)  # of whoever writes here
    numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))  # of its transactions

    @property
    def name(self) -> str:
        return self.url.set(drivername="postgresql").render_as_string(hide_password=True)

    def claim(self) -> None:
        self.claims = Claims(name=self.name)
        self._claiming = self._writer()
        with self._claiming.connect():
            pass

    def release(self) -> None:
        if self._claiming is not None:
            self._claiming.dispose()

    def engines(self) -> tuple[Engine, Engine]:
        pool: dict[str, Any] = {"pool_size": READERS, "max_overflow": READERS, "pool_timeout": LOCK_WAIT}
        return self._claiming or self._writer(), self.reader(**pool)

    def _writer(self) -> Engine:
        """One connection, which holds what the service claims."""
        name = "gear-twin" if self.claims is None else self.claims.application
        engine = self.engine(STATEMENT_WAIT, name, pool_size=1, max_overflow=0, pool_timeout=LOCK_WAIT)
        event.listen(engine, "connect", keep_commits)
        if self.claims is not None:
            event.listen(engine, "connect", self.claims.take)
        return engine

    def for_migration(self) -> Engine:
        return self.engine(0, poolclass=NullPool)

    def for_reading(self) -> Engine:
        return self.engine(0, poolclass=NullPool)

    def engine(self, wait: float, name: str = "gear-twin", **given: Any) -> Engine:
        """Connections on which one statement may take so long [s; 0: without end], by a name that the server shows.

        given  arguments of `create_engine`
        """
        options = f"-c statement_timeout={int(1000 * wait)} -c lock_timeout={int(1000 * LOCK_WAIT)}"
        arguments: dict[str, Any] = {"connect_timeout": CONNECT_WAIT, **SILENT_AFTER}
        # A server that was set up without a locale hands out bytes otherwise, which SQLAlchemy ends with a traceback.
        arguments |= {"application_name": name, "client_encoding": "utf8"}
        arguments["options"] = " ".join(filter(None, (options, self.url.query.get("options"))))  # type: ignore[arg-type]
        engine = sa.create_engine(self.url, **{"connect_args": arguments, "pool_pre_ping": True, **given})
        if wait > 0:
            event.listen(engine, "do_connect", connecting(wait + ANSWER_WAIT))
        return engine

    def reader(self, name: str = "gear-twin", **pool: Any) -> Engine:
        """Connections to read with: whoever finds one lost reads once more, on another.

        To ask before each read whether its connection leads anywhere doubles the statements.
        """
        return self.engine(STATEMENT_WAIT, name, isolation_level="AUTOCOMMIT", pool_pre_ping=False, **pool)

    def examine(self, engine: Engine) -> None:
        """The server looks after its pages; a connection that fails does so here, not at the first window."""
        with engine.connect():
            pass

    def size(self, db: Connection) -> int:
        """By the server's own account."""
        return int(db.exec_driver_sql("SELECT pg_database_size(current_database())").scalar_one())

    def insert(self, table: sa.Table) -> Any:
        from sqlalchemy.dialects import postgresql  # services with SQLite do not load it

        return postgresql.insert(table)

    def verify(self) -> None:
        pass  # a server's database cannot be taken away under a connection

    def turn(self, db: Connection, asset: str) -> None:
        db.execute(_TURN, {"of": asset})

    def tell(self, engine: Engine, shown: Collection[Shown] | None) -> None:
        """After the commit, since a server holds up all others that tell something within theirs."""
        if shown is None:
            return
        with suppress(Exception), engine.connect() as db:  # it is committed, and found by looks
            tell_server(db.execute, shown or {""})

    def watching(self) -> CommitWatch:
        return ServerWatch(self._listening)

    def _listening(self) -> Any:
        """A connection of the driver's own."""
        import psycopg

        plain = self.url.set(drivername="postgresql").difference_update_query(["options"])
        url = plain.render_as_string(hide_password=False)
        return psycopg.connect(url, autocommit=True, connect_timeout=CONNECT_WAIT)

    def at_work(self) -> AtWork:
        one: dict[str, Any] = {"pool_size": 1, "max_overflow": 0}
        engine = self.engine(STATEMENT_WAIT, "gear-twin at work", isolation_level="AUTOCOMMIT", **one)
        return SessionClaims(engine, self.name)

    def mark(self, db: Connection) -> Mark:
        mark = marked(db, *self.next_transaction())
        assert mark is not None  # it depends on nothing
        return mark

    def next_transaction(self) -> tuple[str, int]:
        """Who writes, one thread of this process: those of a front end write at once; and the transaction's number."""
        return f"{self.identity} {threading.get_ident()}", next(self.numbers)

    def was_committed(self, engine: Engine, mark: Mark) -> bool:
        return was_committed(engine, mark, self.name)


def keep_commits(connection: Any, _: object) -> None:
    """A confirmed commit outlives a crash of the server, even one that is set to confirm before it has written."""
    with connection.cursor() as cursor:
        cursor.execute(
            "SELECT set_config('synchronous_commit', 'on', false) WHERE current_setting('synchronous_commit') = 'off'"
        )
    connection.commit()
