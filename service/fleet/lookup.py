"""Which partition has an asset: the one in whose tables it is, and for a new asset that of its name's hash."""

from __future__ import annotations

import sqlalchemy as sa

from service.fleet.layout import Layout
from service.fleet.naming import PLACE


def partition_in_use(tables: sa.Engine, layout: Layout, asset: str) -> int:
    """The partition of an asset. One that was renamed stays in its partition, as do the names that it had."""
    with tables.connect() as db:
        found = db.execute(PLACE, {"of": asset}).scalar()
    return layout.partition_of(asset) if found is None else int(found)
