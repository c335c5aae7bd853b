"""Lowest and highest values of every part of a history, which a thinned reading shows."""

from __future__ import annotations

import json
import math

import sqlalchemy as sa
import zstandard
from alembic import op
from sqlalchemy.dialects import postgresql, sqlite

revision = "0007"
down_revision = "0006"

BATCH = 500  # rows that are held in memory
FAN_OUT, LEVELS = 4, 10
PAIRS = (("lowest", "lowest_rms", -1), ("highest", "highest_rms", 1), ("sharpest", "highest_kurtosis", 1))
KEY = ["asset", "epoch", "level", "part"]


def upgrade() -> None:
    db = op.get_bind()
    number = sa.BigInteger().with_variant(sa.Integer, "sqlite")
    op.create_table(
        "extremes",
        sa.Column("asset", sa.Text, sa.ForeignKey("assets.asset", deferrable=True), primary_key=True, nullable=False),
        *(sa.Column(name, number, primary_key=True, nullable=False, autoincrement=False) for name in KEY[1:]),
        *(sa.Column(window, number, nullable=True) for window, _, _ in PAIRS),
        *(sa.Column(value, sa.Double, nullable=True) for _, value, _ in PAIRS),
        sqlite_with_rowid=False,
    )
    metadata = sa.MetaData()
    windows = sa.Table("windows", metadata, autoload_with=db)
    extremes = sa.Table("extremes", metadata, autoload_with=db)
    key = (windows.c.asset, windows.c.start_ns)
    read = sa.select(*key, windows.c.epoch, windows.c.number, windows.c.record).order_by(*key).limit(BATCH)
    add = _adding((sqlite if db.dialect.name == "sqlite" else postgresql).insert(extremes), extremes)
    decompressor = zstandard.ZstdDecompressor()
    after: tuple | None = None
    while True:
        query = read if after is None else read.where(sa.tuple_(*key) > sa.tuple_(*(sa.literal(v) for v in after)))
        rows = db.execute(query).all()
        if not rows:
            break
        found: dict[tuple, dict] = {}
        for row in rows:
            _take(found, row, _values(decompressor, row.record))
        if found:
            db.execute(add, list(found.values()))
        after = (rows[-1].asset, rows[-1].start_ns)


def downgrade() -> None:
    op.drop_table("extremes")


def _take(found: dict[tuple, dict], row: sa.Row, values: dict) -> None:
    """Adds a window's values to its part of each level."""
    for level in range(1, LEVELS + 1) if values else ():
        key = (row.asset, row.epoch, level, row.number // FAN_OUT**level)
        empty = {name: None for window, value, _ in PAIRS for name in (window, value)}
        part = found.setdefault(key, {**dict(zip(KEY, key, strict=True)), **empty})
        for window, value, sign in PAIRS:
            new = values.get(value)
            if new is not None and (part[value] is None or sign * (new - part[value]) > 0):
                part[window], part[value] = row.number, new


def _adding(insert: sa.Insert, extremes: sa.Table) -> sa.Insert:
    given, changed = insert.excluded, {}  # type: ignore[attr-defined]
    for window, value, sign in PAIRS:
        kept, new = extremes.c[value], given[value]
        better = sa.or_(sa.and_(kept.is_(None), new.is_not(None)), new > kept if sign > 0 else new < kept)
        changed[window] = sa.case((better, given[window]), else_=extremes.c[window])
        changed[value] = sa.case((better, new), else_=kept)
    return insert.on_conflict_do_update(index_elements=KEY, set_=changed)  # type: ignore[attr-defined]


def _values(decompressor: zstandard.ZstdDecompressor, kept: bytes) -> dict:
    """RMS and kurtosis of a window; nothing of one that is damaged or was refused."""
    try:
        record = json.loads(decompressor.decompress(bytes(kept)))
    except (zstandard.ZstdError, ValueError):
        return {}
    if record.get("quality") == "refused":
        return {}
    sharp = [s.get("kurtosis") for s in (record.get("indicators") or {}).values()]
    rms, kurtosis = record.get("rms_measured"), max((k for k in sharp if _is_number(k)), default=None)
    rms = float(rms) if _is_number(rms) else None
    values = {"lowest_rms": rms, "highest_rms": rms, "highest_kurtosis": kurtosis}
    return {name: value for name, value in values.items() if value is not None}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)
