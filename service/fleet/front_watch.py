"""What a front end learns of the fleet by itself: which assets have changed, and which partitions are served."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from service.errors import NewerTables, StoreError
from service.fleet.census import Partition, partitions
from service.fleet.channel import Follower
from service.fleet.layout import look
from service.fleet.notices import CHANGED
from service.operation.metric_catalogue import METRICS
from service.results.asset_table import AssetTable
from service.results.store import Tables

LEAST = {"network_connected"}  # figures of which the smallest of all partitions counts
GREATEST = {"storage_unavailable", "store_bytes", "twin_call_seconds", "raw_recording_newest_seconds"}
GREATEST |= {"raw_recording_stopped"}


class FrontWatch(Follower):
    """Follows the rows of assets and partitions, until ended.

    changed  called after rows of assets have been written: who waits looks again
    """

    def __init__(self, database: str, tables: Tables, table: AssetTable, changed: Callable[[], None]) -> None:
        super().__init__(database, CHANGED, "fleet")
        self._tables, self._table, self._changed = tables, table, changed
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
        count = len(self._partitions)
        found: dict[str, Any] = {
            "fleet_partitions": count,
            "fleet_partitions_served": count - len(self.unserved()),
        }
        try:
            found["fleet_assets"] = self._table.levels()
        except StoreError:
            found["fleet_assets"] = {}
        return found | together([partition.figures for partition in self._partitions if partition.served])

    def look(self) -> None:
        """Reads who serves the partitions, and whether the fleet's tables are of this release."""
        look(self._tables)
        self._partitions = partitions(self._tables)
        self._reason = None

    def begun(self) -> None:
        self._table.changed()
        self._changed()

    def take(self, said: Iterable[str]) -> None:
        self._table.changed(*said)
        self._changed()

    def lost(self, error: Exception) -> None:
        why = str(error).strip().splitlines()[0]
        newer = isinstance(error, NewerTables)
        self._reason = why if newer else f"the fleet's database cannot be used now: {why}"


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
