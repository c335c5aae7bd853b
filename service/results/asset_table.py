"""The assets as they are shown: made of the tables, by any process, and kept as long as nothing changes them.

What is committed is shown by whoever asks afterwards. `get` looks whether an asset's row and events are still those
that its snapshot was made of; `latest` asks nothing in a process that looks for changes (`look`) and has found none of
the asset. `note` shows what only this process knows yet: counters of frames, windows that wait.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, bindparam, func, select

from service.alarms.keeper import AlarmKeeper
from service.contract.base import iso_time
from service.errors import StoreError
from service.json_text import JsonText
from service.results.asset_changes import AssetChanges
from service.results.asset_list import Choice, Page, Place, area_entry
from service.results.asset_rows import put, volatile_of
from service.results.change_signal import ChangeSignal
from service.results.commit_watch import Shown
from service.results.schema import ASSETS, EVENTS
from service.results.snapshot import Snapshot
from service.results.sql_store import SqlStore
from service.results.store import StoredAsset
from service.stream.wire.topics import NAME

FRESH_EVERY = 2.0  # between two rows of an asset that differ only in when frames came last [s]
BATCH = 100  # rows of one transaction
FLEETING = {"quality", "last_frame_ns"}  # parts of a snapshot that change with each frame
SNAPSHOTS = 256  # that are kept, those that were asked for last; some 100 kB each
_OF = ASSETS.c.asset == bindparam("of")
_LAST_EVENT = select(func.coalesce(func.max(EVENTS.c.id), 0)).where(EVENTS.c.asset == bindparam("of"))
_SEEN = select(ASSETS.c.version, _LAST_EVENT.scalar_subquery()).where(_OF)
_VOLATILE = select(ASSETS.c.volatile).where(_OF)
_WRITTEN = select(ASSETS.c.share, ASSETS.c.version, ASSETS.c.asset).where(ASSETS.c.version > bindparam("after"))
_ALL_SHOWN = select(ASSETS.c.asset, ASSETS.c.version, ASSETS.c.volatile)
_SUMMARIES = select(ASSETS.c.summary, ASSETS.c.asset).order_by(ASSETS.c.label)
_STALE = select(ASSETS.c.label, ASSETS.c.volatile).where(ASSETS.c.data == "stale").order_by(ASSETS.c.label)
_BY_LEVEL = select(ASSETS.c.level, func.count()).group_by(ASSETS.c.level)
_AREA = (ASSETS.c.area, ASSETS.c.level, ASSETS.c.retired.is_not(None))
_BY_AREA = select(*_AREA, func.count(), func.coalesce(func.sum(ASSETS.c.alarms), 0)).group_by(*_AREA)
_LABELLED = select(ASSETS.c.asset).where(ASSETS.c.label == bindparam("of"))


class Seen(NamedTuple):
    """By what a snapshot is known to be the present one."""

    version: int = -1  # of the asset's row
    last_event_id: int = 0


@dataclass(slots=True)
class _Made:
    """A snapshot of which rows it was made, and how it is shown."""

    seen: Seen
    snapshot: Snapshot
    shown: Snapshot | None = None  # with what only this process knows; None until somebody asks


class AssetTable:
    """The assets of one database, and who waits for them to change.

    most  snapshots that are kept; None: all of them, by whoever takes in the windows of all
    """

    def __init__(
        self,
        store: SqlStore,
        alarms: AlarmKeeper | None = None,
        most: int | None = SNAPSHOTS,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._store, self._alarms, self._most, self._signal = store, alarms, most, ChangeSignal()
        self._made: OrderedDict[str, _Made] = OrderedDict()
        self._noted: dict[str, dict[str, Any]] = {}  # by asset: parts of snapshots that only this process knows
        self._old: set[str] = set()  # assets whose snapshots may be old
        self._complete = False  # whether there are snapshots of all assets
        self._followed = False  # whether this process looks for what others have committed
        self._due: dict[str, None] = {}  # assets whose rows are to be written now ...
        self._later: dict[str, None] = {}  # ... and those whose rows can wait
        self._clock, self._fresh_at = clock, 0.0
        self._followers: list[tuple[AssetChanges, bool]] = []
        self._looked_to = 0  # version up to which rows have been looked at
        self._told: dict[str, int] = {}  # by asset: the version of its row that followers have been told of
        self._written = _WRITTEN.where(store.database.own(ASSETS.c.asset))
        self._lock = threading.RLock()
        self.unstored: tuple[str, str] | None = None  # why nothing can be stored now, and since when (ISO 8601)
        self.closed = False

    def load(self) -> tuple[StoredAsset, ...]:
        """Takes up all assets at the start of a service; what is committed of them.

        Their versions are read first: what others commit meanwhile is found by the next look.
        """
        rows = {asset: (version, volatile) for asset, version, volatile in self._rows(_ALL_SHOWN)}
        last_events = self._store.last_event_ids()
        opened = {} if self._alarms is None else self._alarms.store.open_by_asset()
        known = self._store.all_assets()
        for stored in known:
            asset = stored.asset
            version, volatile = rows.get(asset, (0, None))
            snapshot = Snapshot.from_store(self._store, stored, last_events.get(asset, 0))
            stale = volatile_of(volatile, asset).get("stale")
            snapshot = replace(snapshot, alarms=opened.get(asset, ()), stale=stale)
            self._made[asset] = _Made(Seen(version, snapshot.last_event_id), snapshot)
            self._due[asset] = None  # what the last run alone knew is over
            self._looked_to, self._told[asset] = max(self._looked_to, version), version
        self._complete = self._followed = True
        return known

    # -- one asset -----------------------------------------------------------------------------------

    def get(self, asset: str) -> Snapshot | None:
        """The asset as it is committed, with what only this process knows; None where there is none."""
        self._old.discard(asset)
        before = made = self._made.get(asset)
        try:
            rows = self._store.database.rows(_SEEN, {"of": asset})
            seen = Seen(*rows[0]) if rows else Seen()
            if rows and (made is None or made.seen != seen):
                made = _Made(seen, self._read(asset, seen))
        except StoreError:
            self._old.add(asset)
            raise
        with self._lock:
            present = self._made.get(asset)
            if present is not None and present is not before and (made is None or present.seen > made.seen):
                made = present  # what this process has committed or read meanwhile
            if made is None or (not rows and made is before and asset not in self._noted):
                self._made.pop(asset, None)
                return None
            return self._shown(asset, self._keep(asset, made))

    def latest(self, asset: str) -> Snapshot | None:
        """The asset as this process has it: it is read only where it may have changed, and the storage answers."""
        made = self._made.get(asset)
        if asset in self._old or not self._followed or (made is None and not self._complete):
            try:
                return self.get(asset)
            except StoreError:
                made = self._made.get(asset)
        if made is None:
            return None
        with self._lock:
            return self._shown(asset, made)

    def every(self) -> list[Snapshot]:
        """All assets, by their ids; those that this process has where the storage cannot be read."""
        try:
            assets: Iterable[str] = self._made if self._complete else self.assets()
        except StoreError:
            assets = self._made
        return [snapshot for asset in sorted(assets) if (snapshot := self.latest(asset)) is not None]

    def find(self, name: str) -> Snapshot | None:
        """The asset that is called so now."""
        if not NAME.fullmatch(name):
            return None
        rows = self._store.database.rows(_LABELLED, {"of": name})
        return self.get(rows[0][0]) if rows else None

    def _read(self, asset: str, seen: Seen) -> Snapshot:
        store = self._store
        known = self._made.get(asset)
        before = known.snapshot if known is not None and known.seen <= seen else None  # else the database stepped back
        snapshot = Snapshot.from_store(store, store.shown_asset(asset), seen.last_event_id, before)
        ((volatile,),) = store.database.rows(_VOLATILE, {"of": asset})
        alarms = () if self._alarms is None else self._alarms.open(asset)
        return replace(snapshot, alarms=alarms, **volatile_of(volatile, asset))

    def _shown(self, asset: str, made: _Made) -> Snapshot:
        if made.shown is None:
            noted = self._noted.get(asset, {})
            made.shown = replace(made.snapshot, unstored=self.unstored, **noted).with_whole()
        return made.shown

    def _keep(self, asset: str, made: _Made) -> _Made:
        self._made[asset] = made
        self._made.move_to_end(asset)
        while self._most is not None and len(self._made) > self._most:
            self._made.popitem(last=False)
        return made

    # -- what is shown otherwise -----------------------------------------------------------------------

    def note(self, asset: str, **parts: Any) -> None:
        """Shows parts of an asset that only this process knows yet; `write_noted` writes them into its row."""
        self.latest(asset)  # another thread may have made it
        with self._lock:
            made = self._made.get(asset) or self._keep(asset, _Made(Seen(), Snapshot(asset=asset, label=asset)))
            self._noted.setdefault(asset, {}).update(parts)
            made.shown = None
            (self._later if FLEETING.issuperset(parts) else self._due)[asset] = None
        self._tell(asset, fleeting=FLEETING.issuperset(parts))

    def note_unstored(self, unstored: tuple[str, str] | None) -> None:
        """Shows why nothing can be stored now, and since when (ISO 8601); or that it can."""
        with self._lock:
            self.unstored = unstored
            for made in self._made.values():
                made.shown = None
        self._tell(*self._made)

    def write(self, snapshot: Snapshot) -> int:
        """Writes how an asset is shown by now, in the caller's transaction; the version of its row."""
        return put(self._store.database, [snapshot])[snapshot.asset]

    def written(self, snapshot: Snapshot, version: int, *, fleeting: bool = False) -> None:
        """A row has been committed of a snapshot that was made of the latest one, and is shown.

        fleeting  whether all of it has been told before
        """
        asset = snapshot.asset
        with self._lock:
            before = self._made.get(asset)  # may be of what others have committed, and nobody has looked at yet
            fleeting = fleeting and before is not None and before.seen.version == self._told.get(asset)
            self._told[asset] = version
            self._keep(asset, _Made(Seen(version, snapshot.last_event_id), snapshot, snapshot))
            noted = self._noted.get(asset, {})
            noted |= {name: getattr(snapshot, name) for name in noted}
        if not fleeting:
            self._tell(asset)
        self._signal.wake(asset)

    def write_noted(self) -> None:
        """Called between frames: writes the rows of assets that are shown otherwise by what was noted.

        Of an asset of which only frames have come, now and then. StorageUnavailable where that cannot be kept now.
        """
        if self._later and self._clock() >= self._fresh_at:
            self._fresh_at = self._clock() + FRESH_EVERY
            self._due, self._later = self._due | self._later, {}
        while self._due:
            batch = list(self._due)[:BATCH]
            with self._store.database.transaction() as db:
                for asset in sorted(batch):
                    self._store.database.ensure(db, asset)  # nobody commits anything of them meanwhile
                shown = [snapshot for asset in batch if (snapshot := self.get(asset)) is not None]
                versions = put(self._store.database, shown)
            for snapshot in shown:
                self.written(snapshot, versions[snapshot.asset], fleeting=True)
            for asset in batch:
                self._due.pop(asset, None)

    def renewed(self, asset: str) -> None:
        """Something else is kept of an asset; how it is shown is read anew, and written into its row."""
        with self._lock:
            if asset in self._made:
                self._made[asset].seen = Seen()
            self._due[asset] = None
        self.changed(asset)

    # -- all assets ----------------------------------------------------------------------------------

    def _rows(self, query: Select) -> list[Any]:
        """The rows that a query of the assets answers; in a fleet's worker, of its own assets."""
        database = self._store.database
        return database.rows(query.where(database.own(ASSETS.c.asset)))

    def known(self) -> tuple[str, ...]:
        """The assets of which this process has a snapshot, sorted."""
        return tuple(sorted(self._made))

    def assets(self) -> tuple[str, ...]:
        """The assets, sorted."""
        return tuple(asset for (asset,) in self._rows(select(ASSETS.c.asset).order_by(ASSETS.c.asset)))

    def names(self) -> tuple[str, ...]:
        """What the assets are called now, sorted."""
        return tuple(name for (name,) in self._rows(select(ASSETS.c.label).order_by(ASSETS.c.label)))

    def summaries(self) -> list[Mapping[str, Any]]:
        """The list of assets, by name."""
        return [self._summary(text, asset) for text, asset in self._rows(_SUMMARIES)]

    def page(self, choice: Choice) -> Page:
        """A page of the list, the most severe first."""
        chosen = select(*(ASSETS.c[n] for n in ("summary", "asset", "severity", "label"))).where(*_conditions(choice))
        chosen, rows = chosen.order_by(ASSETS.c.severity.desc(), ASSETS.c.label), list[Any]()
        for part in _after(choice.after):
            if (lacks := choice.limit + 1 - len(rows)) > 0:
                rows += self._rows(chosen.where(*part).limit(lacks))
        shown = [self._summary(text, asset) for text, asset, _, _ in rows[: choice.limit]]
        if len(rows) <= choice.limit:
            return Page(summaries=shown, next=None)
        _, _, severity, name = rows[choice.limit - 1]
        return Page(summaries=shown, next=Place(severity=severity, asset=name))

    def areas(self) -> list[dict[str, Any]]:
        """The areas with their numbers of assets."""
        found: dict[str, dict[str, Any]] = {}
        for name, level, retired, count, alarms in self._rows(_BY_AREA):
            area = found.setdefault(name, {"levels": {}, "alarms": 0, "retired": 0})
            if retired:
                area["retired"] += count
            else:
                area["levels"][level] = area["levels"].get(level, 0) + count
                area["alarms"] += int(alarms)
        return [area_entry(name, **found[name]) for name in sorted(found)]

    def levels(self) -> dict[str, int]:
        """How many assets have each level of the status."""
        return dict(tuple(row) for row in self._rows(_BY_LEVEL))

    def stale(self) -> list[tuple[str, str, str]]:
        """Assets whose figures are out of date: name, why, since when (ISO 8601)."""
        found = []
        for name, volatile in self._rows(_STALE):
            parts = volatile_of(volatile, name)
            stale = parts.get("damaged") or parts.get("stale")
            if stale is not None:
                found.append((name, stale.reason, iso_time(stale.since_ns)))
        return found

    def _summary(self, text: str | None, asset: str) -> Mapping[str, Any]:
        """The entry of the list, as it was written; of an asset of which none was yet, as it would be."""
        if text is not None and self.unstored is None:
            return JsonText(text)
        snapshot = self.get(asset)
        assert snapshot is not None
        return snapshot.summary()

    # -- changes -------------------------------------------------------------------------------------

    def changed(self, *assets: str) -> None:
        """Rows of these assets, or of nobody knows which, have been written by somebody else."""
        assets = assets or tuple(self._made)
        self._old.update(assets)
        self._tell(*assets)
        self._signal.wake(*assets)

    def look(self) -> tuple[str, ...]:
        """Finds the rows of assets that others have written since the last look; the assets."""
        self._followed = True
        rows = [Shown(*row) for row in self._store.database.rows(self._written, {"after": self._looked_to})]
        self._looked_to = max((row.version for row in rows), default=self._looked_to)
        return self.take(rows)

    def take(self, shown: Collection[Shown]) -> tuple[str, ...]:
        """Takes note of rows that have been written; the assets of this process's share that others have written."""
        share, made = self._store.database.share, self._made
        with self._lock:
            new = [r for r in shown if share in (None, r.share) and self._told.get(r.asset) != r.version]
            self._told |= {row.asset: row.version for row in new}
            self._old |= {r.asset for r in new if r.asset not in made or made[r.asset].seen.version != r.version}
        if found := tuple(row.asset for row in new):
            self._tell(*found)
            self._signal.wake(*found)
        return found

    def _tell(self, *assets: str, fleeting: bool = False) -> None:
        for follower, all_changes in tuple(self._followers):
            if all_changes or not fleeting:
                follower.note(*assets)

    @contextmanager
    def follow(self, *, fleeting: bool = True) -> Iterator[AssetChanges]:
        """The assets that change while inside, for one thread; all of which this process has a snapshot come first.

        fleeting  also where only frames have come
        """
        follower = AssetChanges(), fleeting
        self._followers.append(follower)
        follower[0].note(*self.known())
        try:
            yield follower[0]
        finally:
            self._followers.remove(follower)

    def changes(self, asset: str | None = None) -> AbstractContextManager[asyncio.Event]:
        """An event of the running loop that is set at each change, or at those of one asset; the reader clears it."""
        return self._signal.listening(asset)

    def close(self) -> None:
        """Ends every wait: the service goes down."""
        self.closed = True
        self._signal.wake()


def _after(place: Place | None) -> list[list[ColumnElement[bool]]]:
    """What the rows behind a place fulfil, in parts that an index finds at once."""
    severity = ASSETS.c.severity
    if place is None:
        return [[]]
    return [[severity == place.severity, ASSETS.c.label > place.asset], [severity < place.severity]]


def _conditions(choice: Choice) -> list[ColumnElement[bool]]:
    """What the rows of a choice fulfil."""
    c = ASSETS.c
    found: list[ColumnElement[bool]] = [c.words.contains(word, autoescape=True) for word in choice.words]
    if choice.area is not None:
        found.append(c.area == choice.area)
    if choice.levels:
        found.append(c.level.in_(choice.levels))
    if not choice.retired:
        found.append(c.retired.is_(None))
    return found
