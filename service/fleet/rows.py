"""A row for each asset in what all partitions share: what lists show of it, and what is in no table of its partition.

The rows follow the board: the latest state counts, and nothing is queued. A change is written at once, those that
follow it closely together. Of a change that only says when frames came last, a row is written now and then.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import sqlalchemy as sa
from sqlalchemy import Connection
from sqlalchemy.dialects import postgresql
from sqlalchemy.exc import SQLAlchemyError

from service.errors import StoreError
from service.fleet.fence import Fenced
from service.fleet.layout import ASSETS
from service.fleet.notices import CHANGED
from service.json_text import plain
from service.results.asset_list import area_of, severity_of, words_of
from service.results.board import Board, Snapshot, Stale, Waiting
from service.results.json_columns import dump, load
from service.results.store import Tables

log = logging.getLogger(__name__)

LOOK_EVERY = 0.5  # whether the thread is to end [s]
GATHER = 0.5  # after a write, so that the changes of several assets make one transaction [s]
FRESH_EVERY = 10.0  # between two rows of an asset that differ only in when frames came last [s]
BATCH = 100  # rows of one transaction
PAUSE = 1.0  # after a failure [s]
SHOWN = (
    "label", "last_event_id", "windows_total", "epoch", "stale", "damaged", "unstored", "report", "rig", "alarms",
    "question", "retired", "waiting",
)  # fmt: skip
STOP_WAIT = 3.0  # [s]

_ROW = postgresql.insert(ASSETS)
_PUT = _ROW.on_conflict_do_update(
    index_elements=[ASSETS.c.asset],
    set_={
        name: _ROW.excluded[name]
        for name in ("label", "area", "severity", "level", "changed_ns", "summary", "words", "volatile")
    }
    | {"version": ASSETS.c.version + 1},
    where=ASSETS.c.partition == _ROW.excluded.partition,
)
_SAY = sa.text("SELECT pg_notify(:channel, asset) FROM unnest(CAST(:assets AS text[])) AS asset")


class RowWriter(threading.Thread):
    """Keeps the rows of one partition's assets, until ended."""

    def __init__(self, database: Tables, board: Board, partition: int) -> None:
        super().__init__(name="rows", daemon=True)
        self._database, self._board, self._partition = database, board, partition
        self._stopping = threading.Event()
        self._written: dict[str, Snapshot] = {}  # by asset: what the row shows, apart from when frames came
        self._later: dict[str, None] = {}  # assets whose rows can wait
        self._fresh_at = 0.0

    def run(self) -> None:
        """Works until ended."""
        with self._board.follow() as changes:
            waiting: dict[str, None] = {}
            while not self._stopping.is_set():
                waiting.update(dict.fromkeys(changes.take(LOOK_EVERY)))
                waiting = self._due(waiting)
                try:
                    self._write(waiting)
                except Fenced:
                    return
                except (
                    StoreError,
                    SQLAlchemyError,
                ) as error:  # whoever keeps windows says it; the rows are written afterwards
                    log.debug("the rows of partition %d wait: %s", self._partition, error)
                    self._stopping.wait(PAUSE)
                else:
                    if waiting:
                        self._stopping.wait(GATHER)
                    waiting = {}

    def end(self) -> None:
        """Ends the thread; rows that wait are written by the next start."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOP_WAIT)

    def _due(self, waiting: dict[str, None]) -> dict[str, None]:
        """The assets whose rows are to be written now."""
        due: dict[str, None] = {}
        for asset in waiting:
            snapshot = self._board.get(asset)
            if snapshot is not None:
                (self._later if _looks_alike(self._written.get(asset), snapshot) else due)[asset] = None
        if time.monotonic() >= self._fresh_at:
            self._fresh_at = time.monotonic() + FRESH_EVERY
            due, self._later = due | self._later, {}
        return due

    def _write(self, assets: dict[str, None]) -> None:
        for batch in _batches(list(assets)):
            shown = {asset: snapshot for asset in batch if (snapshot := self._board.get(asset)) is not None}
            with self._database.transaction() as db:
                put(db, [row_of(snapshot, self._partition) for snapshot in shown.values()])
            self._written.update(shown)


def _batches(assets: list[str]) -> list[list[str]]:
    return [assets[begin : begin + BATCH] for begin in range(0, len(assets), BATCH)]


def put(db: Connection, rows: Sequence[Mapping[str, Any]]) -> None:
    """Writes rows, in place of earlier ones of the same partition, and says so to the front ends."""
    db.execute(_PUT, list(rows))
    say(db, [row["asset"] for row in rows])


def say(db: Connection, assets: Sequence[str]) -> None:
    """Says to the front ends, with the present transaction, that the rows of assets are others now."""
    db.execute(_SAY, {"channel": CHANGED, "assets": list(assets)})


def row_of(snapshot: Snapshot, partition: int) -> dict[str, Any]:
    """The row of an asset."""
    summary = plain(snapshot.summary())
    level = summary["status"]["level"]
    return {
        "asset": snapshot.asset,
        "label": snapshot.name,
        "partition": partition,
        "area": area_of(snapshot.name),
        "severity": severity_of(level),
        "level": level,
        "version": 1,
        "changed_ns": time.time_ns(),
        "summary": summary,
        "words": words_of(summary),
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


def volatile_of(text: bytes | None) -> dict[str, Any]:
    """The parts of a snapshot that only its row holds."""
    if text is None:
        return {}
    data = load(text)
    return {
        **data,
        "stale": None if data["stale"] is None else Stale(**data["stale"]),
        "damaged": None if data["damaged"] is None else Stale(**data["damaged"]),
        "unstored": None if data["unstored"] is None else tuple(data["unstored"]),
        "waiting": None if data.get("waiting") is None else _waiting(data["waiting"]),
    }


def _waiting(data: Mapping[str, Any]) -> Waiting:
    return Waiting(**{**data, "behind": tuple(data["behind"])})


def _looks_alike(before: Snapshot | None, now: Snapshot) -> bool:
    """Whether a row shows the same of an asset, apart from when frames came last."""
    return before is not None and all(
        getattr(before, name) is getattr(now, name) or getattr(before, name) == getattr(now, name) for name in SHOWN
    )
