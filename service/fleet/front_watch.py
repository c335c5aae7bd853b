"""What a front end learns of the fleet by itself: which assets have changed, and which partitions are served."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import sqlalchemy as sa

from service.errors import NewerTables, StoreError
from service.fleet.databases import url_of
from service.fleet.front_board import FleetBoard
from service.fleet.front_database import FleetDatabase
from service.fleet.heartbeat import SILENT
from service.fleet.layout import PARTITIONS, SERVER_NOW
from service.fleet.notices import CHANGED
from service.operation.metric_catalogue import METRICS

log = logging.getLogger(__name__)

LOOK_EVERY = 2.0  # at who serves the partitions [s]
WAIT = 0.5  # for a notification, and until the thread ends [s]
GATHER = 0.02  # during which notifications are taken together [s]
PAUSE = 1.0  # after the connection was lost [s]
STOP_WAIT = 3.0  # [s]
NS = 1e9

LEAST = {"network_connected"}  # figures of which the smallest of all partitions counts
GREATEST = {"storage_unavailable", "store_bytes", "twin_call_seconds", "raw_recording_newest_seconds"}
GREATEST |= {"raw_recording_stopped"}

_PARTITIONS = sa.select(
    PARTITIONS.c.number, (SERVER_NOW - PARTITIONS.c.seen_ns).label("silent_ns"), PARTITIONS.c.figures
).order_by(PARTITIONS.c.number)


class Partition(NamedTuple):
    """What a partition's worker has said last."""

    number: int
    served: bool
    figures: Mapping[str, Any]


class FrontWatch(threading.Thread):
    """Follows the rows of assets and partitions, until ended.

    changed  called after rows of assets have been written: who waits looks again
    """

    def __init__(self, database: str, fleet: FleetDatabase, board: FleetBoard, changed: Callable[[], None]) -> None:
        super().__init__(name="fleet", daemon=True)
        self._url = url_of(database).set(drivername="postgresql").render_as_string(hide_password=False)
        self._fleet, self._board, self._changed = fleet, board, changed
        self._stopping = threading.Event()
        self._partitions: list[Partition] = []
        self._reason: str | None = "the fleet's partitions have not been looked at yet"

    def not_ready(self) -> str | None:
        """Why the answers of this front end may be out of date, or None."""
        return self._reason

    def unserved(self) -> list[int]:
        """The partitions that nobody serves."""
        return [partition.number for partition in self._partitions if not partition.served]

    def figures(self) -> dict[str, Any]:
        """Figures of the fleet for /metrics, and those of its workers together."""
        partitions = self._partitions
        served = len(partitions) - len(self.unserved())
        found: dict[str, Any] = {"fleet_partitions": len(partitions), "fleet_partitions_served": served}
        try:
            found["fleet_assets"] = self._board.levels()
        except StoreError:
            found["fleet_assets"] = {}
        return found | self.of_workers()

    def of_workers(self) -> dict[str, Any]:
        """What the workers say of themselves, together."""
        return together([partition.figures for partition in self._partitions if partition.served])

    def look(self) -> None:
        """Reads who serves the partitions, and whether the fleet's tables are of this release."""
        self._fleet.look()
        rows = self._fleet.shared.rows(_PARTITIONS)
        self._partitions = [
            Partition(number, silent is not None and silent / NS < SILENT, figures or {})
            for number, silent, figures in rows
        ]
        self._reason = None

    def run(self) -> None:
        """Works until ended; after each new connection everything counts as changed."""
        import psycopg

        while not self._stopping.is_set():
            try:
                with psycopg.connect(self._url, autocommit=True, connect_timeout=5) as connection:
                    connection.execute(f"LISTEN {CHANGED}")
                    self._board.changed()
                    self._changed()
                    self._follow(connection)
            except NewerTables as error:
                self._reason = str(error)
                self._stopping.wait(PAUSE)
            except (psycopg.Error, StoreError) as error:
                self._reason = f"the fleet's database cannot be used now: {str(error).strip().splitlines()[0]}"
                log.debug("the notifications of the fleet: %s", error)
                self._stopping.wait(PAUSE)

    def end(self) -> None:
        """Ends the thread."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOP_WAIT)

    def _follow(self, connection: Any) -> None:
        look_at = 0.0
        while not self._stopping.is_set():
            if time.monotonic() >= look_at:
                self.look()
                look_at = time.monotonic() + LOOK_EVERY
            assets = {said.payload for said in connection.notifies(timeout=WAIT, stop_after=1)}
            if assets:
                assets |= {said.payload for said in connection.notifies(timeout=GATHER)}
                self._board.changed(*assets)
                self._changed()


def together(figures: list[Mapping[str, Any]]) -> dict[str, Any]:
    """The figures of several workers as one: their sum, or the smallest or greatest where a sum has no meaning."""
    values: dict[str, list[float]] = {}
    labelled: dict[str, Counter[str]] = {}
    for each in figures:
        for name, value in each.items():
            entry = METRICS.get(name)
            if entry is None or entry.type == "histogram":
                continue
            if isinstance(value, Mapping):
                labelled.setdefault(name, Counter()).update(value)
            elif not entry.labels and isinstance(value, int | float):
                values.setdefault(name, []).append(float(value))
    how = {**dict.fromkeys(LEAST, min), **dict.fromkeys(GREATEST, max)}
    return {name: how.get(name, sum)(found) for name, found in values.items()} | labelled
