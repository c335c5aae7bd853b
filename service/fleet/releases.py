"""Whether the tables of partitions are those of this release: a front end leaves those of another one alone.

A partition's tables are brought to a newer release by its worker. Until then a newer front end answers nothing from
them, and from then on an older one does not.
"""

from __future__ import annotations

import sqlalchemy as sa
from sqlalchemy import Connection, Select

from service.errors import StorageUnavailable
from service.fleet.layout import schema_of
from service.results.migrate import VERSION_TABLE
from service.results.schema import REVISION


def revisions(partitions: int) -> sa.CompoundSelect:
    """A query for the number and the revision of each partition's tables."""
    return sa.union_all(*(_revision(number) for number in range(partitions)))


def refuse_other(partition: int, revision: str | None) -> None:
    """StorageUnavailable where a partition's tables have another revision than this program's."""
    if revision == REVISION:
        return
    if (revision or "") > REVISION:
        why = f"this program knows up to {REVISION}: they were written by a newer gear-twin; install it here, too"
    else:
        why = f"this program needs {REVISION}"
    raise StorageUnavailable(
        f"the tables of partition {partition} have revision {revision}, {why}", reason="another release"
    )


def expect_tables(db: Connection, partition: int) -> None:
    """StorageUnavailable where a partition's tables are of another release."""
    row = db.execute(_revision(partition)).first()
    refuse_other(partition, None if row is None else row[1])


def _revision(partition: int) -> Select:
    table = sa.table(VERSION_TABLE, sa.column("version_num"), schema=schema_of(partition))
    return sa.select(sa.literal_column(str(partition)), table.c.version_num)
