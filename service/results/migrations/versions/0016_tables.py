"""The first revision: all tables. A later one changes them, and then this one has to say what they were."""

from __future__ import annotations

from alembic import op

from service.results.schema import METADATA

revision = "0016"
down_revision = None


def upgrade() -> None:
    METADATA.create_all(op.get_bind())
    if op.get_bind().dialect.name != "postgresql":
        return
    for table in METADATA.tables.values():
        for index in table.indexes:
            where = index.dialect_options["sqlite"]["where"]
            if where is not None:  # no table names the server's dialect, because a start would load it
                name, columns = str(index.name), [column.name for column in index.columns]
                op.drop_index(name)
                op.create_index(name, table.name, columns, unique=index.unique, postgresql_where=where)
