"""Windows say themselves whether they are kept when a history is thinned."""

from __future__ import annotations

import json

import sqlalchemy as sa
import zstandard
from alembic import op

revision = "0004"
down_revision = "0003"

BATCH = 500  # rows that are held in memory
NOTABLE, END_OF_EPOCH = 1, 2


def upgrade() -> None:
    db = op.get_bind()
    op.add_column("windows", sa.Column("notable", sa.BigInteger, nullable=False, server_default="0"))
    windows = sa.Table("windows", sa.MetaData(), autoload_with=db)
    key = (windows.c.asset, windows.c.start_ns)
    read = sa.select(*key, windows.c.record).order_by(*key).limit(BATCH)
    mark = sa.update(windows).where(windows.c.asset == sa.bindparam("of"), windows.c.start_ns == sa.bindparam("at"))
    decompressor = zstandard.ZstdDecompressor()
    after: tuple | None = None
    while True:
        query = read if after is None else read.where(sa.tuple_(*key) > sa.tuple_(*(sa.literal(v) for v in after)))
        rows = db.execute(query).all()
        if not rows:
            break
        found = [{"of": row.asset, "at": row.start_ns} for row in rows if _is_notable(decompressor, row.record)]
        if found:
            db.execute(mark.values(notable=NOTABLE), found)
        after = (rows[-1].asset, rows[-1].start_ns)
    ends = sa.select(
        windows.c.asset, sa.func.min(windows.c.number).label("first"), sa.func.max(windows.c.number).label("last")
    ).group_by(windows.c.asset, windows.c.epoch)
    for asset, first, last in db.execute(ends).all():
        own = sa.update(windows).where(windows.c.asset == asset, windows.c.number.in_((first, last)))
        db.execute(own.values(notable=END_OF_EPOCH))


def downgrade() -> None:
    op.drop_column("windows", "notable")


def _is_notable(decompressor: zstandard.ZstdDecompressor, kept: bytes) -> bool:
    """Whether a window updated the twin or was refused; one that is damaged is kept as it is."""
    try:
        record = json.loads(decompressor.decompress(bytes(kept)))
    except (zstandard.ZstdError, ValueError):
        return True
    return bool(record.get("updated")) or record.get("quality") == "refused"
