"""The assets as they are answered: made of the tables when somebody asks, by any process.

A snapshot that was made is kept as long as the asset's row and its events are those that it was made of. What is
committed is therefore shown by whoever asks afterwards.
"""

from __future__ import annotations

import asyncio
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Table, and_, bindparam, func, or_, select

from service.alarms.keeper import AlarmKeeper
from service.contract.base import iso_time
from service.json_text import JsonText
from service.results.asset_list import Choice, Page, Place, area_entry
from service.results.asset_rows import put, volatile_of
from service.results.board import Snapshot
from service.results.change_signal import ChangeSignal
from service.results.schema import ASSETS, EVENTS
from service.results.sql_store import SqlStore
from service.stream.wire.topics import NAME

SNAPSHOTS = 256  # that are kept, those that were asked for last; some 100 kB each
_OF = ASSETS.c.asset == bindparam("of")
_LAST_EVENT = select(func.coalesce(func.max(EVENTS.c.id), 0)).where(EVENTS.c.asset == bindparam("of"))
_SEEN = select(ASSETS.c.version, _LAST_EVENT.scalar_subquery()).where(_OF)
_VOLATILE = select(ASSETS.c.volatile).where(_OF)
_LABELLED = select(ASSETS.c.asset).where(ASSETS.c.label == bindparam("of"))


class _Seen(NamedTuple):
    """By what a snapshot is known to be the present one."""

    version: int  # of the asset's row
    last_event_id: int


class AssetTable:
    """The assets of one database, and who waits for them to change.

    unstored  why nothing can be stored at present, and since when (ISO 8601), where that is known
    """

    def __init__(
        self,
        store: SqlStore,
        alarms: AlarmKeeper,
        unstored: Callable[[], tuple[str, str] | None] = lambda: None,
    ) -> None:
        self._store, self._alarms, self._signal, self._unstored = store, alarms, ChangeSignal(), unstored
        self._made: OrderedDict[str, tuple[_Seen, Snapshot]] = OrderedDict()
        self._lock = threading.Lock()
        self.closed = False

    # -- where they are ------------------------------------------------------------------------------

    def _store_of(self, asset: str) -> SqlStore:
        """Where the results of an asset are, or of one that has a name."""
        return self._store

    def _rows(self, query: Callable[[Table], Select], order: Sequence[str] = (), limit: int | None = None) -> list[Any]:
        """The rows that a query of the assets' table answers; by columns, of which one with `-` falls."""
        ordered = (ASSETS.c[name.lstrip("-")].desc() if name.startswith("-") else ASSETS.c[name] for name in order)
        return self._store.database.rows(query(ASSETS).order_by(*ordered).limit(limit))

    # -- one asset -----------------------------------------------------------------------------------

    def get(self, asset: str) -> Snapshot | None:
        """The asset as it is committed; None where there is none."""
        rows = self._store_of(asset).database.rows(_SEEN, {"of": asset})
        if not rows:
            return None
        seen = _Seen(*rows[0])
        with self._lock:
            kept = self._made.get(asset)
            if kept is None or kept[0] != seen:
                kept = None
            else:
                self._made.move_to_end(asset)
        snapshot = self._make(asset, seen) if kept is None else kept[1]
        unstored = self._unstored()
        return snapshot if unstored is None else replace(snapshot, unstored=unstored).with_whole()

    def find(self, name: str) -> Snapshot | None:
        """The asset that is called so now."""
        if not NAME.fullmatch(name):
            return None
        rows = self._store_of(name).database.rows(_LABELLED, {"of": name})
        return self.get(rows[0][0]) if rows else None

    def show(self, snapshot: Snapshot) -> None:
        """Writes how an asset is shown by now, in the caller's transaction: a person has changed it."""
        put(self._store_of(snapshot.asset).database, [snapshot.with_whole()])

    def _make(self, asset: str, seen: _Seen) -> Snapshot:
        store = self._store_of(asset)
        snapshot = Snapshot.from_store(store, store.shown_asset(asset), seen.last_event_id)
        ((volatile,),) = store.database.rows(_VOLATILE, {"of": asset})
        alarms = self._alarms.open(asset)
        snapshot = replace(snapshot, alarms=alarms, **volatile_of(volatile, asset)).with_whole()
        with self._lock:
            self._made[asset] = seen, snapshot
            self._made.move_to_end(asset)
            while len(self._made) > SNAPSHOTS:
                self._made.popitem(last=False)
        return snapshot

    # -- all assets ----------------------------------------------------------------------------------

    def assets(self) -> tuple[str, ...]:
        """The assets, sorted."""
        return tuple(asset for (asset,) in self._rows(lambda t: select(t.c.asset), ["asset"]))

    def names(self) -> tuple[str, ...]:
        """What the assets are called now, sorted."""
        return tuple(name for (name,) in self._rows(lambda t: select(t.c.label), ["label"]))

    def summaries(self) -> list[Mapping[str, Any]]:
        """The list of assets, by name."""
        rows = self._rows(lambda t: select(t.c.summary, t.c.asset, t.c.label), ["label"])
        return [self._summary(text, asset) for text, asset, _ in rows]

    def page(self, choice: Choice) -> Page:
        """A page of the list, the most severe first."""
        rows = self._rows(
            lambda t: select(t.c.summary, t.c.asset, t.c.severity, t.c.label).where(*_conditions(t, choice)),
            ["-severity", "label"],
            choice.limit + 1,
        )
        shown = [self._summary(text, asset) for text, asset, _, _ in rows[: choice.limit]]
        if len(rows) <= choice.limit:
            return Page(summaries=shown, next=None)
        _, _, severity, name = rows[choice.limit - 1]
        return Page(summaries=shown, next=Place(severity=severity, asset=name))

    def areas(self) -> list[dict[str, Any]]:
        """The areas with their numbers of assets."""
        found: dict[str, dict[str, Any]] = {}
        for name, level, retired, count, alarms in self._rows(_by_area):
            area = found.setdefault(name, {"levels": {}, "alarms": 0, "retired": 0})
            if retired:
                area["retired"] += count
            else:
                area["levels"][level] = area["levels"].get(level, 0) + count
                area["alarms"] += int(alarms)
        return [area_entry(name, **found[name]) for name in sorted(found)]

    def levels(self) -> dict[str, int]:
        """How many assets have each level of the status."""
        found: dict[str, int] = {}
        for level, count in self._rows(lambda t: select(t.c.level, func.count()).group_by(t.c.level)):
            found[level] = found.get(level, 0) + count
        return found

    def stale(self) -> list[tuple[str, str, str]]:
        """Assets whose figures are out of date: name, why, since when (ISO 8601)."""
        found = []
        for name, volatile in self._rows(
            lambda t: select(t.c.label, t.c.volatile).where(t.c.data == "stale"), ["label"]
        ):
            parts = volatile_of(volatile, name)
            stale = parts.get("damaged") or parts.get("stale")
            if stale is not None:
                found.append((name, stale.reason, iso_time(stale.since_ns)))
        return found

    def _summary(self, text: str | None, asset: str) -> Mapping[str, Any]:
        """The entry of the list, as it was written; of an asset of which none was yet, as it would be."""
        if text is not None and self._unstored() is None:
            return JsonText(text)
        snapshot = self.get(asset)
        assert snapshot is not None
        return snapshot.summary()

    # -- changes -------------------------------------------------------------------------------------

    def changed(self, *assets: str) -> None:
        """Rows of these assets, or of nobody knows which, have been written."""
        self._signal.wake(*assets)

    def changes(self, asset: str | None = None) -> AbstractContextManager[asyncio.Event]:
        """An event of the running loop that is set at each change, or at those of one asset; the reader clears it."""
        return self._signal.listening(asset)

    def close(self) -> None:
        """Ends every wait: the service goes down."""
        self.closed = True
        self._signal.wake()


def _by_area(table: Table) -> Select:
    retired = table.c.retired.is_not(None)
    alarms = func.coalesce(func.sum(table.c.alarms), 0)
    return select(table.c.area, table.c.level, retired, func.count(), alarms).group_by(
        table.c.area, table.c.level, retired
    )


def _conditions(table: Table, choice: Choice) -> list[ColumnElement[bool]]:
    """What the rows of a choice fulfil."""
    c = table.c
    found: list[ColumnElement[bool]] = [c.words.contains(word, autoescape=True) for word in choice.words]
    if choice.after is not None:
        severity, name = choice.after.severity, choice.after.asset
        found += [c.severity <= severity, or_(c.severity < severity, and_(c.severity == severity, c.label > name))]
    if choice.area is not None:
        found.append(c.area == choice.area)
    if choice.levels:
        found.append(c.level.in_(choice.levels))
    if not choice.retired:
        found.append(c.retired.is_(None))
    return found
