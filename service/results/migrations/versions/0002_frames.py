"""JSON becomes frames of Zstandard with a checksum, and numbers of windows and assets are sealed by one."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

import sqlalchemy as sa
import zstandard
from alembic import op

revision = "0002"
down_revision = "0001"

BATCH = 500  # rows that are held in memory
JSON = {
    "assets": ("rig", "state", "report", "assembly", "quality", "question", "retired"),
    "windows": ("record", "figures"),
    "events": ("data",),
    "inspections": ("inspection", "answer"),
    "alarm_rules": ("rules", "changed"),
    "alarm_memory": ("memory",),
    "alarms": ("record",),
    "alarm_history": ("entry",),
    "changes": ("given", "effect"),
    "baselines": ("about",),
}
SEALED = {"windows": ("start_ns", "number", "epoch"), "assets": ("windows", "updates", "received_ns", "epoch")}


def upgrade() -> None:
    db = op.get_bind()
    compressor = zstandard.ZstdCompressor(level=1, write_checksum=True)
    for table in SEALED:
        op.add_column(table, sa.Column("seal", sa.BigInteger))
    if db.dialect.name == "postgresql":  # a column of SQLite takes text and bytes alike
        for table, columns in JSON.items():
            for column in columns:
                op.execute(f"ALTER TABLE {table} ALTER COLUMN {column} TYPE BYTEA USING convert_to({column}, 'UTF8')")
    for table in JSON:
        _rewrite(db, table, lambda kept: compressor.compress(kept.encode() if isinstance(kept, str) else bytes(kept)))


def downgrade() -> None:
    db = op.get_bind()
    decompressor = zstandard.ZstdDecompressor()
    text = db.dialect.name == "sqlite"
    for table in JSON:
        _rewrite(db, table, lambda kept: _text(decompressor.decompress(bytes(kept)), text))
    if not text:
        for table, columns in JSON.items():
            for column in columns:
                op.execute(f"ALTER TABLE {table} ALTER COLUMN {column} TYPE TEXT USING convert_from({column}, 'UTF8')")
    for table in SEALED:
        op.drop_column(table, "seal")


def _text(kept: bytes, text: bool) -> bytes | str:
    return kept.decode() if text else kept


def _rewrite(db: sa.Connection, name: str, change: Callable[[Any], Any]) -> None:
    """Changes every value of JSON in a table, and seals the numbers of rows that have a seal."""
    table = sa.Table(name, sa.MetaData(), autoload_with=db)
    key = list(table.primary_key.columns)
    read = sa.select(*key, *(table.c[n] for n in SEALED.get(name, ()) if n not in table.primary_key.columns))
    read = read.add_columns(*(sa.type_coerce(table.c[n], _Raw()).label(f"json_{n}") for n in JSON[name]))
    write = sa.update(table).where(*(column == sa.bindparam(f"key_{column.name}") for column in key))
    write = write.values({n: sa.bindparam(f"json_{n}", type_=_Raw()) for n in JSON[name]})
    sealed = SEALED.get(name, ())
    if "seal" in table.c and sealed:
        write = write.values(seal=sa.bindparam("seal"))
    after: tuple | None = None
    while True:
        query = read.order_by(*key).limit(BATCH)
        if after is not None:
            query = query.where(sa.tuple_(*key) > sa.tuple_(*(sa.literal(v) for v in after)))
        rows = db.execute(query).mappings().all()
        if not rows:
            return
        db.execute(write, [_changed(row, table, JSON[name], sealed, change) for row in rows])
        after = tuple(rows[-1][column.name] for column in key)


def _changed(row: Any, table: sa.Table, columns: tuple[str, ...], sealed: tuple[str, ...], change: Any) -> dict:
    out = {f"key_{column.name}": row[column.name] for column in table.primary_key.columns}
    for name in columns:
        kept = row[f"json_{name}"]
        out[f"json_{name}"] = None if kept is None else change(kept)
    if sealed:
        out["seal"] = zlib.crc32(",".join(str(row[name]) for name in sealed).encode())
    return out


class _Raw(sa.types.UserDefinedType):
    """A value as the driver has it: text or bytes."""

    cache_ok = True

    def get_col_spec(self, **_: Any) -> str:
        return "BLOB"
