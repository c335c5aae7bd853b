"""All rows of a database into another one, of the other kind too: for backups of a server, and for moving to one."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from sqlalchemy import Connection

from service.results.schema import METADATA

BATCH = 500  # rows that are held in memory


def copy_rows(source: Connection, target: Connection) -> dict[str, int]:
    """Copies every table within the transactions of both connections; how many rows each has.

    Numbers that were given before are not given again by the target.
    """
    copied = {}
    for table in METADATA.sorted_tables:
        count = 0
        key = list(table.primary_key.columns)
        with source.execute(sa.select(table).order_by(*key).execution_options(yield_per=BATCH)) as rows:
            for part in rows.mappings().partitions(BATCH):
                target.execute(sa.insert(table), [dict(row) for row in part])
                count += len(part)
        copied[table.name] = count
        if (numbered := _numbered(table)) is not None:
            _go_on_from(target, table, numbered, _last_given(source, table, numbered))
    return copied


def count_rows(db: Connection) -> dict[str, int]:
    """How many rows each table has."""
    return {
        name: db.execute(sa.select(sa.func.count()).select_from(table)).scalar_one()
        for name, table in METADATA.tables.items()
    }


def _numbered(table: sa.Table) -> str | None:
    """The column whose numbers the database gives; None where it gives none."""
    return next((c.name for c in table.primary_key.columns if c.autoincrement is True), None)


def _last_given(db: Connection, table: sa.Table, column: str) -> int:
    """The greatest number that has been given, also to a row that is gone; 0 where there is none."""
    greatest = db.execute(sa.select(sa.func.max(table.c[column]))).scalar() or 0
    if db.dialect.name == "sqlite":
        query: Any = sa.text("SELECT seq FROM sqlite_sequence WHERE name = :name")
        given = db.execute(query, {"name": table.name}).scalar()
    else:
        query = sa.text("SELECT pg_sequence_last_value(CAST(pg_get_serial_sequence(:name, :column) AS regclass))")
        given = db.execute(query, {"name": table.name, "column": column}).scalar()
    return max(greatest, given or 0)


def _go_on_from(db: Connection, table: sa.Table, column: str, number: int) -> None:
    if number == 0:
        return
    if db.dialect.name == "sqlite":
        given = {"name": table.name, "number": number}
        db.execute(sa.text("DELETE FROM sqlite_sequence WHERE name = :name"), given)
        db.execute(sa.text("INSERT INTO sqlite_sequence (name, seq) VALUES (:name, :number)"), given)
    else:
        query = sa.text("SELECT setval(pg_get_serial_sequence(:name, :column), :number)")
        db.execute(query, {"name": table.name, "column": column, "number": number})
