"""Which partition has an asset: the one in whose tables it is, and for a new asset that of its name."""

from __future__ import annotations

import sqlalchemy as sa

from service.fleet.layout import ASSETS, Layout


def partition_in_use(tables: sa.Engine, layout: Layout, asset: str) -> int:
    """The partition of an asset. One that was renamed stays in the partition of its first name."""
    with tables.connect() as db:
        found = db.execute(sa.select(ASSETS.c.partition).where(ASSETS.c.asset == asset)).scalar()
    return layout.partition_of(asset) if found is None else int(found)
