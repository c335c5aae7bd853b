"""What lists and answers show of an asset besides its results: columns of its row, written by whoever shows it.

The row has the asset's entry of the list, by which lists are sorted and searched, and what is shown and is in no other
table: whether data come, and what waits. Its `version` grows with each writing.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from typing import Any

from sqlalchemy import bindparam, update

from service.json_text import compact, plain
from service.results.asset_list import area_of, severity_of, words_of
from service.results.board import Board, Snapshot, Stale, Waiting
from service.results.json_columns import dump, salvage
from service.results.schema import ASSETS
from service.results.store import Tables

FRESH_EVERY = 2.0  # between two rows of an asset that differ only in when frames came last [s]
BATCH = 100  # rows of one transaction
SHOWN = (
    "label", "last_event_id", "windows_total", "epoch", "stale", "damaged", "unstored", "report", "rig", "alarms",
    "question", "retired", "waiting",
)  # fmt: skip
COLUMNS = ("area", "severity", "level", "data", "alarms", "words", "summary", "volatile")
_PUT = (
    update(ASSETS)
    .where(ASSETS.c.asset == bindparam("of"))
    .values(version=ASSETS.c.version + 1, **{name: bindparam(name) for name in COLUMNS})
)


def put(database: Tables, snapshots: Iterable[Snapshot]) -> None:
    """Writes the rows of assets, in one transaction, or in the caller's."""
    rows = {snapshot.asset: row_of(snapshot) for snapshot in snapshots}
    with database.transaction() as db:
        for asset in rows:
            database.ensure(db, asset)
        db.execute(_PUT, [{"of": asset, **row} for asset, row in rows.items()])
        database.shown(db, tuple(rows))


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
                "unstored": snapshot.unstored,
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
        "unstored": None if data["unstored"] is None else tuple(data["unstored"]),
        "waiting": None if data["waiting"] is None else _waiting(data["waiting"]),
    }


class AssetRows:
    """Called between frames: writes the rows of the assets that a board shows otherwise.

    Of a change that only says when frames came last, a row is written now and then.
    written  called with the assets whose rows have been written
    """

    def __init__(
        self,
        database: Tables,
        board: Board,
        written: Callable[..., object] = lambda *assets: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._database, self._board, self._tell, self._clock = database, board, written, clock
        self._changes = board.followed()
        self._written: dict[str, Snapshot] = {}  # by asset
        self._due: dict[str, None] = {}  # assets whose rows are to be written now ...
        self._later: dict[str, None] = {}  # ... and those whose rows can wait
        self._fresh_at = 0.0

    def put(self, snapshot: Snapshot) -> None:
        """Writes the row of an asset in the caller's transaction, which has changed it."""
        put(self._database, [snapshot])

    def kept(self, snapshot: Snapshot) -> None:
        """The row that was put is committed, and the board shows the asset so."""
        self._written[snapshot.asset] = snapshot
        self._tell(snapshot.asset)

    def __call__(self) -> None:
        """Writes what is due. StorageUnavailable where that cannot be kept now; it is due still, then."""
        for asset in self._changes.take(0):
            snapshot = self._board.get(asset)
            if snapshot is not None and snapshot is not self._written.get(asset):
                (self._later if _looks_alike(self._written.get(asset), snapshot) else self._due)[asset] = None
        if self._later and self._clock() >= self._fresh_at:
            self._fresh_at = self._clock() + FRESH_EVERY
            self._due, self._later = self._due | self._later, {}
        while self._due:
            batch = list(self._due)[:BATCH]
            shown = {asset: snapshot for asset in batch if (snapshot := self._board.get(asset)) is not None}
            put(self._database, shown.values())
            self._written |= shown
            for asset in batch:
                del self._due[asset]
            self._tell(*batch)


def _looks_alike(before: Snapshot | None, now: Snapshot) -> bool:
    """Whether a row shows the same of an asset, apart from when frames came last."""
    return before is not None and all(
        getattr(before, name) is getattr(now, name) or getattr(before, name) == getattr(now, name) for name in SHOWN
    )


def _waiting(data: Mapping[str, Any]) -> Waiting:
    return Waiting(**{**data, "behind": tuple(data["behind"])})
