"""The assets of a fleet as a front end shows them: made of the tables of their partitions when somebody asks.

A snapshot that was made is kept as long as the asset's row and its events are those that it was made of. What is
committed is therefore shown by whoever asks afterwards, at every front end.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import sqlalchemy as sa
from sqlalchemy import ColumnElement

from service.alarms.keeper import AlarmKeeper
from service.contract.base import iso_time
from service.fleet.front_database import tables_of
from service.fleet.front_store import FleetStore
from service.fleet.layout import ASSETS
from service.fleet.rows import volatile_of
from service.json_text import JsonText
from service.results.asset_list import Choice, Page, Place, area_entry
from service.results.board import Snapshot
from service.results.change_signal import ChangeSignal
from service.stream.wire.topics import NAME

if TYPE_CHECKING:
    import asyncio

SNAPSHOTS = 256  # that are kept, those that were asked for last; some 100 kB each
_SUMMARY = sa.cast(ASSETS.c.summary, sa.Text)
_ALL = sa.select(_SUMMARY).order_by(ASSETS.c.label)
_NAMES = sa.select(ASSETS.c.label).order_by(ASSETS.c.label)
_LABELLED = sa.select(ASSETS.c.asset).where(ASSETS.c.label == sa.bindparam("of"))
_RETIRED = ASSETS.c.summary["retired"].as_boolean()
_AREAS = sa.select(
    ASSETS.c.area,
    ASSETS.c.level,
    _RETIRED,
    sa.func.count(),
    sa.func.sum(ASSETS.c.summary["alarms"]["active"].as_integer()),
).group_by(ASSETS.c.area, ASSETS.c.level, _RETIRED)
_STALE = (
    sa.select(ASSETS.c.label, ASSETS.c.volatile)
    .where(ASSETS.c.summary["data"].as_string() == "stale")
    .order_by(ASSETS.c.label)
)
_LEVELS = sa.select(ASSETS.c.level, sa.func.count()).group_by(ASSETS.c.level)


class _Seen(NamedTuple):
    """By what a snapshot is known to be the present one."""

    version: int  # of the asset's row
    last_event_id: int


class FleetBoard:
    """The assets of all partitions, and who waits for them to change."""

    in_memory = False

    def __init__(self, store: FleetStore, alarms: AlarmKeeper) -> None:
        self._store, self._alarms, self._signal = store, alarms, ChangeSignal()
        self._made: OrderedDict[str, tuple[_Seen, Snapshot]] = OrderedDict()
        self._lock = threading.Lock()
        self.closed = False

    # -- one asset -----------------------------------------------------------------------------------

    def get(self, asset: str) -> Snapshot | None:
        """The asset as it is committed; None where it has no row among all."""
        seen = self._seen(asset)
        if seen is None:
            return None
        with self._lock:
            kept = self._made.get(asset)
            if kept is not None and kept[0] == seen:
                self._made.move_to_end(asset)
                return kept[1]
        return self._make(asset)

    def find(self, name: str) -> Snapshot | None:
        """The asset that is called so now."""
        if not NAME.fullmatch(name):
            return None
        rows = self._store.database.rows(_LABELLED, {"of": name})
        return self.get(rows[0][0]) if rows else None

    def update(self, asset: str, **changes: Any) -> Snapshot:
        """Shows what has just been committed of an asset: it is read again, with its changes."""
        with self._lock:
            self._made.pop(asset, None)
        self._signal.wake(asset)
        return replace(self.get(asset) or Snapshot(asset=asset), **changes).with_whole()

    def _seen(self, asset: str) -> _Seen | None:
        """How far the asset is by now; None where it has no row."""
        events = tables_of(self._store.places.partition_of(asset))["events"]
        last = sa.select(sa.func.coalesce(sa.func.max(events.c.id), 0)).where(events.c.asset == asset)
        row = sa.select(ASSETS.c.version, last.scalar_subquery()).where(ASSETS.c.asset == asset)
        rows = self._store.database.rows(row)
        return _Seen(*rows[0]) if rows else None

    def _make(self, asset: str) -> Snapshot | None:
        with self._store.database.reading():
            seen = self._seen(asset)
            if seen is None:
                return None
            store = self._store.stores.of(asset)
            snapshot = Snapshot.from_store(store, store.shown_asset(asset), seen.last_event_id)
            ((volatile,),) = self._store.database.rows(sa.select(ASSETS.c.volatile).where(ASSETS.c.asset == asset))
            alarms = self._alarms.open(asset)
        snapshot = replace(snapshot, alarms=alarms, **volatile_of(volatile)).with_whole()
        with self._lock:
            self._made[asset] = seen, snapshot
            self._made.move_to_end(asset)
            while len(self._made) > SNAPSHOTS:
                self._made.popitem(last=False)
        return snapshot

    # -- all assets ----------------------------------------------------------------------------------

    def assets(self) -> tuple[str, ...]:
        return self._store.assets()

    def names(self) -> tuple[str, ...]:
        """What the assets are called now, sorted."""
        return tuple(name for (name,) in self._store.database.rows(_NAMES))

    def summaries(self) -> list[Mapping[str, Any]]:
        """The list of assets, by name."""
        return [JsonText(text) for (text,) in self._store.database.rows(_ALL)]

    def page(self, choice: Choice) -> Page:
        """A page of the list, the most severe first."""
        query = (
            sa.select(_SUMMARY, ASSETS.c.severity, ASSETS.c.label)
            .where(*_conditions(choice))
            .order_by(ASSETS.c.severity.desc(), ASSETS.c.label)
            .limit(choice.limit + 1)
        )
        rows = self._store.database.rows(query)
        shown = [JsonText(text) for text, _, _ in rows[: choice.limit]]
        if len(rows) <= choice.limit:
            return Page(summaries=shown, next=None)
        _, severity, asset = rows[choice.limit - 1]
        return Page(summaries=shown, next=Place(severity=severity, asset=asset))

    def areas(self) -> list[dict[str, Any]]:
        """The areas with their numbers of assets."""
        found: dict[str, dict[str, Any]] = {}
        for name, level, retired, count, alarms in self._store.database.rows(_AREAS):
            area = found.setdefault(name, {"levels": {}, "alarms": 0, "retired": 0})
            if retired:
                area["retired"] += count
            else:
                area["levels"][level] = count
                area["alarms"] += alarms
        return [area_entry(name, **found[name]) for name in sorted(found)]

    def levels(self) -> dict[str, int]:
        """How many assets have each level of the status."""
        return dict(tuple(row) for row in self._store.database.rows(_LEVELS))

    def stale(self) -> list[tuple[str, str, str]]:
        """Assets whose figures are out of date: name, why, since when (ISO 8601)."""
        found = []
        for asset, volatile in self._store.database.rows(_STALE):
            parts = volatile_of(volatile)
            stale = parts.get("damaged") or parts.get("stale")
            if stale is not None:
                found.append((asset, stale.reason, iso_time(stale.since_ns)))
        return found

    # -- changes -------------------------------------------------------------------------------------

    def changed(self, assets: Iterable[str] | None = None) -> None:
        """Rows of these assets, or of nobody knows which, have been written."""
        self._signal.wake(*(assets or ()))

    def changes(self, asset: str | None = None) -> AbstractContextManager[asyncio.Event]:
        """An event of the running loop that is set at each change, or at those of one asset; the reader clears it."""
        return self._signal.listening(asset)

    def close(self) -> None:
        """Ends every wait: the front end goes down."""
        self.closed = True
        self._signal.wake()


def _conditions(choice: Choice) -> list[ColumnElement[bool]]:
    """What the rows of a choice fulfil."""
    found: list[ColumnElement[bool]] = [ASSETS.c.words.contains(word, autoescape=True) for word in choice.words]
    if choice.after is not None:
        severity, asset = choice.after.severity, choice.after.asset
        behind = sa.and_(ASSETS.c.severity == severity, ASSETS.c.label > asset)
        found += [ASSETS.c.severity <= severity, sa.or_(ASSETS.c.severity < severity, behind)]
    if choice.area is not None:
        found.append(ASSETS.c.area == choice.area)
    if choice.levels:
        found.append(ASSETS.c.level.in_(choice.levels))
    if not choice.retired:
        found.append(sa.not_(_RETIRED))
    return found
