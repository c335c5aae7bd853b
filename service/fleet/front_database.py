"""The database of a fleet as a front end uses it: a few connections for the tables of all partitions.

A transaction may write to several schemas: what a person decides, in the partition of the asset, and its entry in the
audit log, in the schema of all. It is committed whole. The first time that it writes to a partition it takes its turn
among the transactions of the partition's worker.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import sqlalchemy as sa
from sqlalchemy import Connection, Engine, Executable, MetaData, Select, Table
from sqlalchemy.exc import SQLAlchemyError

from service.fleet.databases import Partitions, SharedTables
from service.fleet.layout import PRESENT, SCHEMA, expect_revision, refuse_other, schema_of
from service.results.backends import Postgresql
from service.results.database import Database
from service.results.schema import METADATA


@dataclass(slots=True, kw_only=True)
class Transaction:
    """A transaction of one thread, over the schemas that it has begun to write to."""

    db: Connection
    schemas: set[str] = field(default_factory=set)


class Present(threading.local):
    """What the present thread has begun."""

    transaction: Transaction | None = None
    reading: Connection | None = None  # a transaction that sees one state of all tables


@dataclass(slots=True, kw_only=True)
class FleetTables(Postgresql):
    """The tables that all partitions share, for a front end."""

    readers: Engine
    writers: Engine
    upgrades: bool = False

    def begun(self, db: Connection) -> None:
        expect_revision(db)

    def engines(self) -> tuple[Engine, Engine]:
        here = {"schema_translate_map": {None: SCHEMA}}
        reader = self.readers.execution_options(isolation_level="AUTOCOMMIT", **here)
        return self.writers.execution_options(**here), reader


class SchemaDatabase(Database):
    """The tables of one schema; a transaction is part of that which the thread has begun in another schema."""

    def __init__(self, backend: SharedTables | FleetTables, schema: str, present: Present) -> None:
        self._present = present
        self._schema, self._here = schema, {"schema_translate_map": {None: schema}}
        super().__init__(backend)

    @contextmanager
    def transaction(self) -> Iterator[Connection]:
        """A transaction that is committed at the end, or rolled back whole; one within another is part of it."""
        if self._present.transaction is not None:
            with self._within(self._present.transaction) as db:
                yield db
            return
        began = time.monotonic()
        with self._faults(), self._writer.connect() as db:
            with self._begun(db):
                yield db
                mark = self.backend.mark(db)
            self._commit(db, mark)
        self.took("commit", time.monotonic() - began)

    @contextmanager
    def _begun(self, db: Connection) -> Iterator[None]:
        db.begin()
        self._present.transaction = own = Transaction(db=db)
        try:
            with self._within(own):
                yield
        except BaseException:
            with suppress(SQLAlchemyError):  # the connection may be what has failed
                db.rollback()
            raise
        finally:
            self._present.transaction = None

    @contextmanager
    def _within(self, own: Transaction) -> Iterator[Connection]:
        """The transaction's connection, for the tables of this schema."""
        if self._schema not in own.schemas:
            self.backend.begun(own.db)
            own.schemas.add(self._schema)
        before = own.db.get_execution_options().get("schema_translate_map")
        own.db.execution_options(**self._here)
        try:
            yield own.db
        finally:
            own.db.execution_options(schema_translate_map=before)

    @contextmanager
    def reading(self) -> Iterator[None]:
        """What this thread reads inside, of any schema, is one state of the database."""
        with self._faults(), self._reader.connect() as db:
            db.execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True)
            with db.begin():
                self._present.reading = db
                try:
                    yield
                finally:
                    self._present.reading = None

    def rows(self, query: Executable, values: Mapping[str, Any] | None = None) -> list[Any]:
        """All rows that a query answers, within what the thread has begun."""
        own = self._present.transaction
        db = self._present.reading if own is None else own.db
        if db is None:
            return super().rows(query, values)
        with self._faults():
            return list(db.execute(query, values, execution_options=self._here).all())


class FleetDatabase:
    """The databases of all partitions, and of what they share; opened when they are first needed."""

    def __init__(self, database: str, partitions: int) -> None:
        self._partitions, self._present = Partitions(database, partitions), Present()
        self._opened: dict[int, SchemaDatabase] = {}
        self._lock = threading.Lock()
        own = self._partitions
        tables = FleetTables(own.backend(0).url, readers=own.readers, writers=own.writers)
        try:
            self.shared = SchemaDatabase(tables, SCHEMA, self._present)
            self.look()
        except BaseException:
            self.close()
            raise

    @property
    def count(self) -> int:
        """How many partitions there are."""
        return self._partitions.count

    def look(self) -> None:
        """StoreError where the fleet's tables are of another release."""
        refuse_other(self.shared.rows(PRESENT)[0][0])

    def partition(self, number: int) -> SchemaDatabase:
        """The tables of one partition."""
        with self._lock:
            found = self._opened.get(number)
            if found is None:
                backend = self._partitions.backend(number)
                found = self._opened[number] = SchemaDatabase(backend, schema_of(number), self._present)
            return found

    def rows_of_all(
        self,
        table: Table,
        query: Callable[[Table], Select],
        order: Sequence[str] = ("id",),
        first: int | None = None,
    ) -> list[Any]:
        """The rows that a query of one table answers for every partition that can be used, in one query.

        order  columns of the answer by which it is sorted where `first` is given, or none is `id`; one with `-` falls
        first  so many of these; None for all
        """
        chosen = sa.union_all(*(query(tables_of(number)[table.name]) for number in range(self.count))).subquery(
            "chosen"
        )
        columns = (n for n in order if n.lstrip("-") in chosen.c)
        ordered = (chosen.c[n.lstrip("-")].desc() if n.startswith("-") else chosen.c[n] for n in columns)
        return self.shared.rows(sa.select(chosen).order_by(*ordered).limit(first))

    def close(self) -> None:
        """Closes all connections."""
        self._partitions.close()


@cache
def tables_of(partition: int) -> Mapping[str, Table]:
    """The tables of a partition by their names, for statements that concern several."""
    metadata = MetaData()
    return {name: table.to_metadata(metadata, schema=schema_of(partition)) for name, table in METADATA.tables.items()}
