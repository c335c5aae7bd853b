"""What processes of a fleet tell one another by notifications of PostgreSQL."""

from __future__ import annotations

from collections.abc import Sequence

import sqlalchemy as sa
from sqlalchemy import Connection

ASSET = "asset"  # a front end has written something of an asset: a job, how an alarm was signed, the asset itself
NAMED = "named"  # an asset has a name that hashes to another partition than its own
CHANGED = "gear_twin_assets"  # the channel on which front ends listen for assets whose rows have changed


def channel_of(partition: int) -> str:
    """The channel on which a partition's worker listens."""
    return f"gear_twin_{partition:03d}"


def say(db: Connection, assets: Sequence[str]) -> None:
    """Says to the front ends, with the present transaction, that assets are shown otherwise now."""
    said = sa.text("SELECT pg_notify(:channel, asset) FROM unnest(CAST(:assets AS text[])) AS asset")
    db.execute(said, {"channel": CHANGED, "assets": list(assets)})


def announce(db: Connection, partition: int, what: str, asset: str) -> None:
    """Says, with the present transaction, that something waits for a partition's worker."""
    db.execute(sa.text("SELECT pg_notify(:on, :said)"), {"on": channel_of(partition), "said": f"{what} {asset}"})
