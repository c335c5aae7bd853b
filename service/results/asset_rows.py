"""What lists and answers show of an asset besides its results: columns of its row, written by whoever shows it.

The row has the asset's entry of the list, by which lists are sorted and searched, and what is shown and is in no other
table: whether data come, and what waits. Its `version` is the newest of all with each writing.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict
from typing import Any

from sqlalchemy import bindparam, func, select, update

from service.json_text import compact, plain
from service.results.asset_list import area_of, severity_of, words_of
from service.results.commit_watch import Shown
from service.results.json_columns import dump, salvage
from service.results.schema import ASSETS
from service.results.snapshot import Snapshot, Stale, Waiting
from service.results.store import Tables

COLUMNS = ("area", "severity", "level", "data", "alarms", "words", "summary", "volatile")
_NEWEST = select(func.max(ASSETS.alias().c.version)).scalar_subquery()
_PUT = (
    update(ASSETS)
    .where(ASSETS.c.asset == bindparam("of"))
    .values(version=_NEWEST + 1, **{name: bindparam(name) for name in COLUMNS})
)


_SHOWN = select(ASSETS.c.share, ASSETS.c.version, ASSETS.c.asset).where(
    ASSETS.c.asset.in_(bindparam("of", expanding=True))
)


def put(database: Tables, snapshots: Collection[Snapshot]) -> dict[str, int]:
    """Writes the rows of assets, in one transaction, or in the caller's; their versions, by asset."""
    rows = {snapshot.asset: row_of(snapshot) for snapshot in snapshots}
    if not rows:
        return {}
    with database.transaction() as db:
        for asset in rows:
            database.ensure(db, asset)
        db.execute(_PUT, [{"of": asset, **row} for asset, row in rows.items()])
        shown = [Shown(*row) for row in db.execute(_SHOWN, {"of": list(rows)})]
        database.show(shown)
    return {row.asset: row.version for row in shown}


def row_of(snapshot: Snapshot) -> dict[str, Any]:
    """The columns of an asset's row that say how it is shown."""
    summary = plain(snapshot.summary())
    level = summary["status"]["level"]
    return {
        "area": area_of(snapshot.name),
        "severity": severity_of(level),
        "level": level,
        "data": summary["data"],
        "alarms": summary["alarms"]["active"],
        "words": words_of(summary),
        "summary": compact(summary),
        "volatile": dump(
            {
                "quality": snapshot.quality,
                "last_frame_ns": snapshot.last_frame_ns,
                "stale": None if snapshot.stale is None else asdict(snapshot.stale),
                "damaged": None if snapshot.damaged is None else asdict(snapshot.damaged),
                "waiting": None if snapshot.waiting is None else asdict(snapshot.waiting),
            }
        ),
    }


def volatile_of(kept: bytes | None, asset: str) -> dict[str, Any]:
    """The parts of a snapshot that only its row has; none where that was never written, or is damaged."""
    data = salvage(kept, f"what is shown of {asset}")
    if data is None:
        return {}
    return {
        **data,
        "stale": None if data["stale"] is None else Stale(**data["stale"]),
        "damaged": None if data["damaged"] is None else Stale(**data["damaged"]),
        "waiting": None if data["waiting"] is None else _waiting(data["waiting"]),
    }


def _waiting(data: Mapping[str, Any]) -> Waiting:
    return Waiting(**{**data, "behind": tuple(data["behind"])})
