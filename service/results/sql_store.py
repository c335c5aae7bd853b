"""Results in one database, SQLite or PostgreSQL.

One window is one transaction: its record, the twin's state, its report, what the next one goes on from and
the events are there together or not at all. The window's start is its name: a
window that is committed already is not committed again, so nothing is counted twice.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from sqlalchemy import BindParameter, Connection, Select, Update, and_, bindparam, func, or_, select, update

from service.contract.overview import figures
from service.errors import DamageError, StorageUnavailable, StoreError
from service.json_text import plain
from service.results import fault_totals
from service.results.asset_counts import COUNTS, is_sealed, sealed
from service.results.backends import Backend
from service.results.database import Database
from service.results.extremes import adding, outline, row_of
from service.results.json_columns import dump, load, load_text, salvage, say_damage, seal
from service.results.retention import END_OF_EPOCH, NOTABLE, STAYS
from service.results.schema import ASSETS, EVENTS, EXTREMES, FAULT_TOTALS, NUMBER, WINDOWS
from service.results.sparse_reading import epochs_of, spread_numbers
from service.results.store import Event, FaultTotals, StoredAsset, StoredWindow
from service.steady_clock import later_time_ns

VITAL = {"state", "assembly", "making", "quality", "counts"}  # without which an asset cannot go on
JSON_PARTS = ("rig", "state", "report", "assembly", "making", "quality", "question", "retired")  # columns of an asset
NAMED: BindParameter[str] = bindparam("of")  # the asset that a statement is about

_PRESENT = select(*(ASSETS.c[n] for n in COUNTS), ASSETS.c.seal).where(ASSETS.c.asset == NAMED)
_ALL_ASSETS = select(*(ASSETS.c[n] for n in ("asset", "label", *JSON_PARTS, *COUNTS, "seal"))).order_by(ASSETS.c.asset)
_ASSET = _ALL_ASSETS.where(ASSETS.c.asset == NAMED)
_SHOWN_ASSET = select(
    *(ASSETS.c[n] for n in ("asset", "label", *JSON_PARTS, *COUNTS, "seal") if n != "state"),
    ASSETS.c.state.is_not(None).label("has_state"),
).where(ASSETS.c.asset == NAMED)
_ALL_TOTALS = select(FAULT_TOTALS)
_TOTALS = _ALL_TOTALS.where(FAULT_TOTALS.c.asset == NAMED)
_PRESENT_EPOCH = select(ASSETS.c.epoch).where(ASSETS.c.asset == NAMED)
_EPOCH_OF = select(ASSETS.c.epoch).where(ASSETS.c.asset == NAMED).scalar_subquery()
_WINDOW = select(*(WINDOWS.c[n] for n in ("start_ns", "number", "epoch", "seal", "record", "figures")))
_OF_EPOCH = and_(
    WINDOWS.c.asset == NAMED, WINDOWS.c.epoch == func.coalesce(bindparam("epoch", type_=NUMBER), _EPOCH_OF)
)
_ALL_WINDOWS = (
    _WINDOW.where(_OF_EPOCH, WINDOWS.c.number > bindparam("after")).order_by(WINDOWS.c.number).limit(bindparam("most"))
)
_SOME_WINDOWS = (
    _WINDOW.where(_OF_EPOCH, WINDOWS.c.number.in_(spread_numbers(_OF_EPOCH)))  # no range: it would be walked along
    .order_by(WINDOWS.c.number)
    .limit(bindparam("most"))
)
_THESE = _WINDOW.where(_OF_EPOCH, WINDOWS.c.number.in_(bindparam("numbers", expanding=True))).order_by(WINDOWS.c.number)
_OF_PRESENT = and_(WINDOWS.c.asset == NAMED, WINDOWS.c.epoch == _EPOCH_OF)
_LATEST = _WINDOW.where(_OF_PRESENT).order_by(WINDOWS.c.number.desc()).limit(bindparam("most"))
_NEWEST = select(func.max(WINDOWS.c.number)).where(_OF_PRESENT).scalar_subquery()
_KEEP_LAST = update(WINDOWS).where(_OF_PRESENT, WINDOWS.c.number == _NEWEST).values(notable=END_OF_EPOCH)
_EPOCHS = epochs_of(NAMED)
_FROM = (  # with a range and a limit: SQLite walks along the asset's windows where it is given one number
    select(WINDOWS.c.record).where(_OF_EPOCH, WINDOWS.c.number >= bindparam("at")).order_by(WINDOWS.c.number).limit(1)
)
_MARK = select(ASSETS.c.mark).where(ASSETS.c.asset == NAMED)
_HOLD = (
    update(ASSETS)
    .where(ASSETS.c.asset == NAMED, ASSETS.c.mark == bindparam("before"))
    .values(mark=bindparam("now"), worker=bindparam("by"), due=None)
)
_RENEW = update(ASSETS).where(ASSETS.c.asset == NAMED).values(mark=bindparam("now"))
_STAGES = (
    select(*(WINDOWS.c[n] for n in ("number", "record", "stages")))
    .where(WINDOWS.c.asset == NAMED, WINDOWS.c.number >= bindparam("first"))
    .order_by(WINDOWS.c.number)
)
_NEXT_INDEX = select(func.coalesce(func.max(WINDOWS.c.number) + 1, 0)).where(WINDOWS.c.asset == NAMED)
_OF_WINDOW = and_(WINDOWS.c.asset == EVENTS.c.asset, WINDOWS.c.start_ns == EVENTS.c.start_ns)
_RECORD_OR_DATA = func.coalesce(WINDOWS.c.record, EVENTS.c.data)
_IS_DAMAGED = EVENTS.c.start_ns != EVENTS.c.again_ns
_EVENTS = (
    select(*(EVENTS.c[n] for n in ("id", "kind", "start_ns", "again_ns")), _RECORD_OR_DATA)
    .outerjoin(WINDOWS, _OF_WINDOW)
    .where(EVENTS.c.asset == NAMED, EVENTS.c.id > bindparam("after"))
    # those of thinned windows went with them
    .where(or_(EVENTS.c.start_ns.is_(None), WINDOWS.c.start_ns.is_not(None), _IS_DAMAGED))
    .order_by(EVENTS.c.id)
    .limit(bindparam("most"))
)
_NEWEST_EVENT = select(func.coalesce(func.max(EVENTS.c.id), 0)).where(EVENTS.c.asset == ASSETS.c.asset)
_LAST_EVENTS = select(ASSETS.c.asset, _NEWEST_EVENT.scalar_subquery())  # the index is entered once for each asset
_LAST_EVENT = select(func.coalesce(func.max(EVENTS.c.id), 0)).where(EVENTS.c.asset == NAMED)
_REFERRING = dump({})  # the data of an event that refers to its window


class Superseded(StoreError):
    """A job that cannot be committed: what it began with is no longer the present."""


def new_mark() -> int:
    """A mark that was never given before."""
    return secrets.randbits(62)


@cache
def _update_asset(columns: tuple[str, ...]) -> Update:
    """Writes these columns of one asset."""
    return update(ASSETS).where(ASSETS.c.asset == NAMED).values({name: bindparam(name) for name in columns})


def _notable(row: Mapping[str, Any], record: Mapping[str, Any], first: bool) -> int:
    """Whether a window stays when its history is thinned."""
    if first:
        return END_OF_EPOCH
    return NOTABLE if row["found"] or row["refused"] or record.get("updated") else 0


class SqlStore:
    """Results of all assets in a database. Safe to use from several threads of one process."""

    def __init__(self, where: Path | str | Backend | Database, *, claimed: bool = False, shared: bool = False) -> None:
        """where    an open database; or one to be opened: the file of an SQLite database, the URL of a PostgreSQL
                 database, or how another one is connected to
        claimed  whether no other service may write to it meanwhile
        shared   whether another process of this service has it open, and has examined it
        """
        opened = where if isinstance(where, Database) else Database(where, claimed=claimed, shared=shared)
        self.database = database = opened
        self._transaction, self._rows, self._own = database.transaction, database.rows, database.own(ASSETS.c.asset)
        self._damaged: dict[str, str] = {}  # assets whose windows cannot go on, and why
        self._insert_window = database.insert(WINDOWS).on_conflict_do_nothing().returning(WINDOWS.c.start_ns)
        self._insert_events = database.insert(EVENTS)
        self._add_extremes = adding(database.insert(EXTREMES))
        self._add_faults = fault_totals.adding(database.insert(FAULT_TOTALS))

    @property
    def path(self) -> Path | None:
        """The file of an SQLite database."""
        return self.database.path

    def close(self) -> None:
        self.database.close()

    def __enter__(self) -> SqlStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- writing -------------------------------------------------------------------------------------

    def commit(
        self,
        asset: str,
        start_ns: int,
        *,
        record: Mapping[str, Any],
        state: Mapping[str, Any],
        report: Mapping[str, Any] | None,
        received_ns: int,
        before: Mapping[str, Any] | None = None,
        stages: Mapping[str, Any] | None = None,
        making: Mapping[str, Any] | None = None,
        events: Iterable[tuple[str, Mapping[str, Any]]] = (),
        segment: str | None = None,
        segment_bytes: int | None = None,
    ) -> StoredWindow | None:
        """One window, whole; None (and nothing changed) where it is there already.

        before  what its making took from the window before
        stages  when its stages ended: see `journey`
        making  what the next one goes on from, and what is counted of windows
        segment  name of the file of its signals; None where they are not kept
        """
        refused = record.get("quality") == "refused"
        shown = {} if report is None or refused else plain(figures(report))
        with self._transaction() as db:
            self.demand_sound(asset)
            counts, events = self._counts(db, asset), list(events)
            number, epoch = record["index"], counts["epoch"]
            row = {
                "asset": asset, "start_ns": start_ns, "record": dump(record), "figures": dump(shown),
                "before": dump(before), "stages": dump(stages),
                "number": number, "epoch": epoch, "seal": seal(start_ns, number, epoch),
                "segment": segment, "segment_bytes": segment_bytes, "revolutions": record.get("revolutions"),
                "found": int(any(kind == "effect" for kind, _ in events)), "refused": int(refused),
            }  # fmt: skip
            row["notable"] = _notable(row, record, counts["windows"] == 0)
            if db.execute(self._insert_window, row).first() is None:
                return None
            parts = {"state": state, "report": report, "making": making}
            counts["windows"] += 1
            counts["updates"] += bool(record.get("updated"))
            counts["received_ns"] = received_ns
            self._keep(db, asset, parts, sealed(counts))
            if faults := fault_totals.fault_rows(asset, record):
                db.execute(self._add_faults, faults)
            if extremes := row_of(asset, epoch, number, record):
                db.execute(self._add_extremes, extremes)
            self._add_events(db, asset, events, start_ns, record)
        return StoredWindow(start_ns=start_ns, record=plain(record), figures=shown)

    def hold(self, asset: str, before: int, now: int, worker: str | None = None) -> bool:
        """Within the transaction of a job, first of all: nobody else has changed what it goes on from.

        before, now  the asset's mark that the job began with, and the one that it leaves
        worker       who has carried it out

        False where an earlier attempt of the same job was committed already. Superseded where it may not be committed.
        """
        with self._transaction() as db:
            if db.execute(_HOLD, {"of": asset, "before": before, "now": now, "by": worker}).rowcount:
                self.database.update_due(db, asset)
                return True
            if self.mark(asset) == now:
                return False
        raise Superseded(f"something else has been committed of {asset} since this job began")

    def mark(self, asset: str) -> int:
        """Another one whenever a job of the asset goes on from something else; 0 where there is no such asset."""
        return next((mark for (mark,) in self._rows(_MARK, {"of": asset})), 0)

    def next_index(self, asset: str) -> int:
        """Index of an asset's next window."""
        return self._rows(_NEXT_INDEX, {"of": asset})[0][0]

    def arrived(self, asset: str, first: int) -> Iterator[tuple[int, Mapping[str, Any], Mapping[str, Any]]]:
        """The windows of an asset from an index on: their indices, records and stages."""
        for number, record, stages in self._rows(_STAGES, {"of": asset, "first": first}):
            what = f"window {number} of {asset}"
            yield number, salvage(record, what) or {}, salvage(stages, f"the stages of {what}") or {}

    def has_window(self, asset: str, start_ns: int) -> bool:
        """Whether a window has been processed."""
        query = select(WINDOWS.c.number).where(WINDOWS.c.asset == asset, WINDOWS.c.start_ns == start_ns)
        return bool(self._rows(query))

    def next_indices(self) -> dict[str, int]:
        """Index of the next window of each asset."""
        newest = select(func.coalesce(func.max(WINDOWS.c.number) + 1, 0)).where(WINDOWS.c.asset == ASSETS.c.asset)
        found = self._rows(select(ASSETS.c.asset, newest.scalar_subquery()).where(self._own))
        return dict(tuple(row) for row in found)

    def note(self, asset: str, events: Iterable[tuple[str, Mapping[str, Any]]], window_ns: int | None = None) -> None:
        """Takes in what happened outside a window, or after one that is committed."""
        events = list(events)
        with self._transaction() as db:
            self.database.ensure(db, asset)
            self._add_events(db, asset, events)
            if events and window_ns is not None:
                db.execute(STAYS, {"of": asset, "at": window_ns})

    def keep_rig(self, asset: str, rig: Mapping[str, Any]) -> None:
        """Keeps the rig file's mapping for the asset, in place of an earlier one; a job under way is begun anew."""
        with self._transaction() as db:
            self.keep(asset, rig=rig)
            db.execute(_RENEW, {"of": asset, "now": new_mark()})

    def keep(self, asset: str, **parts: Any) -> None:
        """Keeps parts of what is known of an asset outside a window."""
        with self._transaction() as db:
            self.database.ensure(db, asset)
            if "state" in parts:  # where the stream goes on is kept all the same: windows that close can wait
                self.demand_sound(asset)
            others: dict[str, Any] = {name: dump(parts.pop(name)) for name in ("question", "retired") if name in parts}
            given: dict[str, Any] = {name: parts.pop(name) for name in ("received_ns", "epoch") if name in parts}
            if given:
                counts = self._counts(db, asset)
                if given.get("epoch", counts["epoch"]) > counts["epoch"]:
                    db.execute(_KEEP_LAST, {"of": asset})
                    given |= {"windows": 0, "updates": 0}
                else:
                    given.pop("epoch", None)
                others |= sealed({**counts, **given})
            self._keep(db, asset, parts, others)

    # -- reading -------------------------------------------------------------------------------------

    def assets(self) -> tuple[str, ...]:
        return tuple(row[0] for row in self._rows(select(ASSETS.c.asset).where(self._own).order_by(ASSETS.c.asset)))

    def asset(self, asset: str) -> StoredAsset:
        """What is committed of the asset; empty where it has never been seen, without what is damaged."""
        rows = self._rows(_ASSET, {"of": asset})
        if not rows:
            return StoredAsset(asset=asset, label=asset)
        return self._stored(
            rows[0]._mapping, fault_totals.totals_by_asset(self._rows(_TOTALS, {"of": asset})).get(asset, {})
        )

    def shown_asset(self, asset: str) -> StoredAsset:
        """As `asset`, for whoever shows it: what the twin remembers stays in the database, unread and unchecked."""
        rows = self._rows(_SHOWN_ASSET, {"of": asset})
        if not rows:
            return StoredAsset(asset=asset, label=asset)
        row = {**rows[0]._mapping, "state": None}
        totals = fault_totals.totals_by_asset(self._rows(_TOTALS, {"of": asset})).get(asset, {})
        return replace(self._stored(row, totals), unread_state=row["has_state"])

    def all_assets(self) -> tuple[StoredAsset, ...]:
        """What is committed of every asset, by name; what their twins remember is checked and left unread."""
        totals = fault_totals.totals_by_asset(self._rows(_ALL_TOTALS.where(self.database.own(FAULT_TOTALS.c.asset))))
        found = []
        for row in self._rows(_ALL_ASSETS.where(self._own)):
            stored = self._stored(row._mapping, totals.get(row.asset, {}))
            found.append(replace(stored, state=None, unread_state=stored.has_state))
        return tuple(found)

    def _stored(self, row: Any, totals: FaultTotals) -> StoredAsset:
        asset, parts, damaged = row["asset"], {}, []
        for name in JSON_PARTS:
            parts[name] = salvage(row[name], f"{name} of {asset}", load_text if name == "state" else load)
            if parts[name] is None and row[name] is not None:
                damaged.append(name)
        if not is_sealed(row):
            damaged.append("counts")
            say_damage(DamageError(f"the counts of {asset} are damaged"))
        if VITAL & set(damaged):
            self._damaged[asset] = f"{' and '.join(damaged)} of {asset} cannot be read from the database any more"
        return StoredAsset(
            asset=asset,
            label=row["label"],
            **parts,
            windows=row["windows"],
            updates=row["updates"],
            fault_totals=totals,
            received_ns=row["received_ns"],
            epoch=row["epoch"],
            damaged=self._damaged.get(asset),
        )

    def windows(
        self, asset: str, after: int = -1, limit: int = 1000, every: int = 1, epoch: int | None = None
    ) -> tuple[StoredWindow, ...]:
        """Windows of one epoch with an index above `after`, oldest first; every so many, and the newest."""
        given = {"of": asset, "after": after, "most": limit, "epoch": epoch}
        if every == 1:
            return self._windows(_ALL_WINDOWS, given)
        since = max(after, 0) - max(after, 0) % every
        return self._windows(_SOME_WINDOWS, {**given, "every": every, "since": since})

    def outline(self, asset: str, most: int, after: int = -1, epoch: int | None = None) -> tuple[StoredWindow, ...]:
        """About `most` windows of one epoch with an index above `after`, those with the extremes among them."""
        if epoch is None:
            epoch = next((n for (n,) in self._rows(_PRESENT_EPOCH, {"of": asset})), 0)
        numbers = outline(self._rows, asset, epoch, after, most)
        if numbers is None:
            return self.windows(asset, after, most, epoch=epoch)
        return self._windows(_THESE, {"of": asset, "epoch": epoch, "numbers": numbers})

    def ended_ns(self, asset: str) -> int:
        """End of an asset's newest window on the stream's own clock, else the host's time; Unix time [ns]."""
        assembly = self.shown_asset(asset).assembly or {}
        return assembly.get("closed_until_ns") or later_time_ns()

    def epochs(self, asset: str) -> tuple[Mapping[str, Any], ...]:
        """The epochs that have windows, from the first."""
        names = ("epoch", "windows", "first", "last")
        found = [dict(zip(names, row, strict=True)) for row in self._rows(_EPOCHS, {"of": asset})]
        for epoch in found:
            ((record,),) = self._rows(_FROM, {"of": asset, "epoch": epoch["epoch"], "at": epoch["first"]})
            epoch["since"] = (salvage(record, f"window {epoch['first']} of {asset}") or {}).get("start_time")
        return tuple(found)

    def latest_windows(self, asset: str, limit: int) -> tuple[StoredWindow, ...]:
        """The newest windows of the present epoch, oldest first."""
        return self._windows(_LATEST, {"of": asset, "most": limit})[::-1]

    def events(self, asset: str, after: int, limit: int = 500) -> tuple[Event, ...]:
        """The asset's events with an id above `after`, oldest first."""
        found = []
        for i, kind, start_ns, again_ns, kept in self._rows(_EVENTS, {"of": asset, "after": after, "most": limit}):
            what = f"event {i} of {asset}"
            if start_ns != again_ns:
                say_damage(DamageError(f"{what} is damaged (its window is not the one that was written)"))
            elif (data := salvage(kept, what)) is not None:
                found.append(Event(id=i, asset=asset, kind=kind, data=data))
        return tuple(found)

    def last_event_id(self, asset: str) -> int:
        return self._rows(_LAST_EVENT, {"of": asset})[0][0]

    def last_event_ids(self) -> dict[str, int]:
        return dict(tuple(row) for row in self._rows(_LAST_EVENTS.where(self._own)))

    # -- within --------------------------------------------------------------------------------------

    def _windows(self, query: Select, values: Mapping[str, Any]) -> tuple[StoredWindow, ...]:
        """The windows that a query answers; one that is damaged is left out."""
        windows = []
        for start_ns, number, epoch, mark, record, shown in self._rows(query, values):
            try:
                what = f"window {number} of {values['of']}"
                if mark != seal(start_ns, number, epoch):
                    raise DamageError(f"{what} is damaged (its numbers are not those that were written)")
                kept, figures_ = load_text(record, what), load_text(shown, what)
                assert kept is not None and figures_ is not None  # the columns are never empty
            except DamageError as error:
                say_damage(error)
                continue
            windows.append(StoredWindow(start_ns=start_ns, record=kept, figures=figures_))
        return tuple(windows)

    def _counts(self, db: Connection, asset: str) -> dict[str, Any]:
        """The present numbers of an asset, which is there afterwards."""
        found = db.execute(_PRESENT, {"of": asset}).one_or_none()
        if found is None:
            self.database.ensure(db, asset)
            found = db.execute(_PRESENT, {"of": asset}).one()
        if not is_sealed(found._mapping):
            self._damaged[asset] = f"the counts of {asset} cannot be read from the database any more"
            self.demand_sound(asset)
        return {name: found._mapping[name] for name in COUNTS}

    def demand_sound(self, asset: str) -> None:
        """StorageUnavailable where the asset cannot go on from what is kept of it, as far as it has been read."""
        if (why := self._damaged.get(asset)) is not None:
            text = f"{why}: its windows wait until a backup has been restored, or the machine was given another asset"
            raise StorageUnavailable(text, reason="damaged")

    def _keep(
        self, db: Connection, asset: str, parts: Mapping[str, Any], others: Mapping[str, Any] | None = None
    ) -> None:
        """Writes those parts that are given, and other columns as they are."""
        columns = {name: dump(value) for name, value in parts.items() if value is not None} | dict(others or {})
        if columns:
            db.execute(_update_asset(tuple(sorted(columns))), {"of": asset, **columns})

    def _add_events(
        self,
        db: Connection,
        asset: str,
        events: Iterable[tuple[str, Mapping[str, Any]]],
        start_ns: int | None = None,
        record: Mapping[str, Any] | None = None,
    ) -> None:
        """Adds events; one that repeats the record of the window that begins at `start_ns` refers to it."""
        rows = [
            {"asset": asset, "kind": kind, "data": _REFERRING, "start_ns": start_ns, "again_ns": start_ns}
            if record is not None and data == record
            else {"asset": asset, "kind": kind, "data": dump(data), "start_ns": None, "again_ns": None}
            for kind, data in events
        ]
        if rows:
            db.execute(self._insert_events, rows)
