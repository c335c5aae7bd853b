"""Events that only repeat a window's record refer to the window instead.

Those that are there already stay as they are, until they are too old to be kept.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"

BATCH = 500  # rows that are held in memory


def upgrade() -> None:
    op.add_column("events", sa.Column("start_ns", sa.BigInteger, nullable=True))


def downgrade() -> None:
    """Events get their windows' records; those of windows that are kept no longer go with them."""
    db = op.get_bind()
    events = sa.Table("events", sa.MetaData(), autoload_with=db)
    windows = sa.Table("windows", sa.MetaData(), autoload_with=db)
    referring = (
        sa.select(events.c.id, windows.c.record)
        .outerjoin(windows, (windows.c.asset == events.c.asset) & (windows.c.start_ns == events.c.start_ns))
        .where(events.c.start_ns.is_not(None), events.c.id > sa.bindparam("after"))
        .order_by(events.c.id)
        .limit(BATCH)
    )
    write = sa.update(events).where(events.c.id == sa.bindparam("number")).values(data=sa.bindparam("record"))
    after = -1
    while rows := db.execute(referring, {"after": after}).all():
        found = [{"number": number, "record": record} for number, record in rows if record is not None]
        gone = [number for number, record in rows if record is None]
        if found:
            db.execute(write, found)
        db.execute(sa.delete(events).where(events.c.id.in_(gone)))
        after = rows[-1].id
    op.drop_column("events", "start_ns")
