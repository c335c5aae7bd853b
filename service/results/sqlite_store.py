"""Results in one SQLite file in WAL mode under the data directory.

One window is one transaction: its record, the twin's state, its report, the place to resume the stream
from, the data quality and the events are there together or not at all. The window's start is its name: a
window that is committed already is not committed again, so nothing is counted twice. `synchronous=FULL`
makes a committed window outlive the process and the machine's power.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from service.contract.trend import figures
from service.contract.version_1 import current_record, current_report
from service.json_text import plain
from service.results.database import Database, dump, load
from service.results.store import Event, StoredAsset, StoredDecision, StoredInspection, StoredWindow, faults_of


class SqliteStore:
    """A `ResultStore` in one file. Safe to use from several threads of one process."""

    def __init__(self, path: Path) -> None:
        self.database = Database(path)
        self._transaction, self._rows = self.database.transaction, self.database.rows

    @property
    def path(self) -> Path:
        return self.database.path

    def close(self) -> None:
        self.database.close()

    def __enter__(self) -> SqliteStore:
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
        assembly: Mapping[str, Any],
        quality: Mapping[str, Any],
        received_ns: int,
        events: Iterable[tuple[str, Mapping[str, Any]]] = (),
    ) -> StoredWindow | None:
        """One window, whole; None (and nothing changed) where it is there already."""
        refused = record.get("quality") == "refused"
        shown = {} if report is None or refused else plain(figures(report))
        with self._transaction() as db:
            self._ensure(db, asset)
            inserted = db.execute(
                "INSERT OR IGNORE INTO windows (asset, start_ns, record, figures, number, epoch) "
                "VALUES (?, ?, ?, ?, ?, (SELECT epoch FROM assets WHERE asset = ?))",
                (asset, start_ns, dump(record), dump(shown), record["index"], asset),
            )
            if inserted.rowcount == 0:
                return None
            self._keep(db, asset, state=state, report=report, assembly=assembly, quality=quality)
            db.execute(
                "UPDATE assets SET windows = windows + 1, updates = updates + ?, received_ns = ? WHERE asset = ?",
                (bool(record.get("updated")), received_ns, asset),
            )
            db.executemany(
                "INSERT INTO fault_totals VALUES (?, ?, ?, ?, ?, 1) ON CONFLICT (asset, kind, channel, action) "
                "DO UPDATE SET count = count + excluded.count, windows = windows + 1",
                [(asset, *key, count) for key, count in faults_of(record).items()],
            )
            self._add_events(db, asset, events)
        return StoredWindow(start_ns=start_ns, record=plain(record), figures=shown)

    def note(self, asset: str, events: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
        """Takes in what happened outside a window."""
        with self._transaction() as db:
            self._ensure(db, asset)
            self._add_events(db, asset, events)

    def keep_rig(self, asset: str, rig: Mapping[str, Any]) -> None:
        """Keeps the rig file's mapping for the asset, in place of an earlier one."""
        with self._transaction() as db:
            self._ensure(db, asset)
            self._keep(db, asset, rig=rig)

    def keep(self, asset: str, **parts: Any) -> None:
        """Keeps parts of what is known of an asset outside a window."""
        with self._transaction() as db:
            self._ensure(db, asset)
            for name in parts.keys() & {"question", "retired"}:
                db.execute(f"UPDATE assets SET {name} = ? WHERE asset = ?", (dump(parts.pop(name)), asset))
            epoch = parts.pop("epoch", None)
            if epoch is not None:
                db.execute(
                    "UPDATE assets SET epoch = ?, windows = 0, updates = 0 WHERE asset = ? AND epoch < ?",
                    (epoch, asset, epoch),
                )
            self._keep(db, asset, **parts)

    def add_inspection(self, asset: str, inspection: Mapping[str, Any], answer: Mapping[str, Any]) -> int:
        """Keeps one measured depth, which waits to become part of the estimate; its id."""
        with self._transaction() as db:
            self._ensure(db, asset)
            row = db.execute(
                "INSERT INTO inspections (asset, received_ns, inspection, answer, done) VALUES (?, ?, ?, ?, 0)",
                (asset, time.time_ns(), dump(inspection), dump(answer)),
            )
            assert row.lastrowid is not None
            return row.lastrowid

    def use_inspection(
        self,
        inspection: StoredInspection,
        *,
        answer: Mapping[str, Any],
        state: Mapping[str, Any],
        report: Mapping[str, Any],
        events: Iterable[tuple[str, Mapping[str, Any]]],
    ) -> bool:
        """An inspection with all that it changes, whole; False (and nothing changed) where it was used before."""
        with self._transaction() as db:
            ended = "UPDATE inspections SET done = 1, answer = ? WHERE id = ? AND done = 0"
            if not db.execute(ended, (dump(answer), inspection.id)).rowcount:
                return False
            self._keep(db, inspection.asset, state=state, report=report)
            self._add_events(db, inspection.asset, events)
            return True

    def refuse_inspection(self, inspection: StoredInspection, answer: Mapping[str, Any]) -> None:
        """Ends an inspection that cannot become part of the estimate."""
        with self._transaction() as db:
            ended = "UPDATE inspections SET done = 1, answer = ? WHERE id = ? AND done = 0"
            db.execute(ended, (dump(answer), inspection.id))

    def add_decision(self, asset: str, name: str, verb: str, by: str | None = None, note: str | None = None) -> int:
        """Keeps a decision that waits to be carried out, with the person's name and note; its id."""
        with self._transaction() as db:
            self._ensure(db, asset)
            row = db.execute(
                "INSERT INTO decisions (asset, received_ns, name, verb, signed_by, note) VALUES (?, ?, ?, ?, ?, ?)",
                (asset, time.time_ns(), name, verb, by, note),
            )
            assert row.lastrowid is not None
            return row.lastrowid

    def carry_out(
        self,
        decision: StoredDecision,
        *,
        state: Mapping[str, Any],
        report: Mapping[str, Any],
        events: Iterable[tuple[str, Mapping[str, Any]]],
    ) -> bool:
        """Takes in a decision with all that it changes, whole; False (and nothing changed) where it was done before."""
        with self._transaction() as db:
            if not db.execute("UPDATE decisions SET done = 1 WHERE id = ? AND done = 0", (decision.id,)).rowcount:
                return False
            self._keep(db, decision.asset, state=state, report=report)
            self._add_events(db, decision.asset, events)
            return True

    def refuse(self, decision: StoredDecision, reason: str) -> None:
        """Ends a decision that cannot be carried out."""
        with self._transaction() as db:
            db.execute("UPDATE decisions SET done = 1, refused = ? WHERE id = ? AND done = 0", (reason, decision.id))

    # -- reading -------------------------------------------------------------------------------------

    def assets(self) -> tuple[str, ...]:
        return tuple(row[0] for row in self._rows("SELECT asset FROM assets ORDER BY asset"))

    def asset(self, asset: str) -> StoredAsset:
        """What is committed of the asset; empty where it has never been seen."""
        columns = "rig, state, report, assembly, quality, question, retired, windows, updates, received_ns, epoch"
        rows = self._rows(f"SELECT {columns} FROM assets WHERE asset = ?", (asset,))
        if not rows:
            return StoredAsset(asset=asset)
        *texts, windows, updates, received_ns, epoch = rows[0]
        rig, state, report, assembly, quality, question, retired = (load(text) for text in texts)
        totals = self._rows("SELECT kind, channel, action, count, windows FROM fault_totals WHERE asset = ?", (asset,))
        return StoredAsset(
            asset=asset,
            rig=rig,
            state=state,
            report=None if report is None else current_report(report),
            assembly=assembly,
            quality=quality,
            windows=windows,
            updates=updates,
            fault_totals={(kind, channel, action): (count, found) for kind, channel, action, count, found in totals},
            received_ns=received_ns,
            epoch=epoch,
            question=question,
            retired=retired,
        )

    def windows(
        self, asset: str, after: int = -1, limit: int = 1000, every: int = 1, epoch: int | None = None
    ) -> tuple[StoredWindow, ...]:
        """Windows of one epoch with an index above `after`, oldest first; every so many, and the newest."""
        of = "asset = :asset AND epoch = COALESCE(:epoch, (SELECT epoch FROM assets WHERE asset = :asset))"
        return self._windows(
            f"{of} AND number > :after AND (number % :every = 0 "
            f"OR number = (SELECT MAX(number) FROM windows WHERE {of})) ORDER BY number LIMIT :limit",
            {"asset": asset, "after": after, "every": every, "limit": limit, "epoch": epoch},
        )

    def next_index(self, asset: str) -> int:
        """Index of the asset's next window."""
        return self._rows("SELECT COALESCE(MAX(number) + 1, 0) FROM windows WHERE asset = ?", (asset,))[0][0]

    def epochs(self, asset: str) -> tuple[Mapping[str, Any], ...]:
        """The epochs that have windows, from the first."""
        rows = self._rows(
            "SELECT e.epoch, e.windows, e.first, e.last, json_extract(w.record, '$.start_time') FROM "
            "(SELECT asset, epoch, COUNT(*) AS windows, MIN(number) AS first, MAX(number) AS last FROM windows "
            "WHERE asset = ? GROUP BY epoch) AS e JOIN windows AS w ON w.asset = e.asset AND w.number = e.first "
            "ORDER BY e.epoch",
            (asset,),
        )
        names = ("epoch", "windows", "first", "last", "since")
        return tuple(dict(zip(names, row, strict=True)) for row in rows)

    def latest_windows(self, asset: str, limit: int) -> tuple[StoredWindow, ...]:
        """The newest windows of the present epoch, oldest first."""
        present = "epoch = (SELECT epoch FROM assets WHERE asset = :asset)"
        newest = f"asset = :asset AND {present} ORDER BY number DESC LIMIT :limit"
        return self._windows(newest, {"asset": asset, "limit": limit})[::-1]

    def events(self, asset: str, after: int, limit: int = 500) -> tuple[Event, ...]:
        """The asset's events with an id above `after`, oldest first."""
        rows = self._rows(
            "SELECT id, kind, data FROM events WHERE asset = ? AND id > ? ORDER BY id LIMIT ?",
            (asset, after, limit),
        )
        return tuple(Event(id=i, asset=asset, kind=kind, data=load(data)) for i, kind, data in rows)

    def last_event_id(self, asset: str) -> int:
        return self._rows("SELECT COALESCE(MAX(id), 0) FROM events WHERE asset = ?", (asset,))[0][0]

    def inspections(self, asset: str, after: int = 0, limit: int = 1000) -> tuple[Mapping[str, Any], ...]:
        return tuple(
            own.to_dict()
            for own in self._inspections("WHERE asset = ? AND id > ? ORDER BY id LIMIT ?", (asset, after, limit))
        )

    def inspection(self, number: int) -> StoredInspection:
        (found,) = self._inspections("WHERE id = ?", (number,))
        return found

    def pending_inspections(self) -> tuple[StoredInspection, ...]:
        """Those that wait to become part of the estimate, oldest first."""
        return self._inspections("WHERE done = 0 ORDER BY id")

    def decision(self, number: int) -> StoredDecision:
        (found,) = self._decisions("WHERE id = ?", (number,))
        return found

    def decisions(self, asset: str) -> tuple[StoredDecision, ...]:
        """All decisions on the asset's effects, oldest first."""
        return self._decisions("WHERE asset = ? ORDER BY id", (asset,))

    def decision_counts(self, asset: str) -> dict[str, int]:
        """How many decisions on the asset's effects were carried out, by verb."""
        query = "SELECT verb, COUNT(*) FROM decisions WHERE asset = ? AND done = 1 AND refused IS NULL GROUP BY verb"
        return dict(self._rows(query, (asset,)))

    def pending_decisions(self) -> tuple[StoredDecision, ...]:
        """Those that wait to be carried out, oldest first."""
        return self._decisions("WHERE done = 0 ORDER BY id")

    # -- within --------------------------------------------------------------------------------------

    def _windows(self, which: str, values: Mapping[str, Any]) -> tuple[StoredWindow, ...]:
        rows = self._rows(f"SELECT start_ns, record, figures FROM windows WHERE {which}", values)
        return tuple(
            StoredWindow(start_ns=start, record=current_record(load(record)), figures=load(shown))
            for start, record, shown in rows
        )

    def _inspections(self, which: str, values: Sequence[Any] = ()) -> tuple[StoredInspection, ...]:
        rows = self._rows(f"SELECT id, asset, received_ns, inspection, answer, done FROM inspections {which}", values)
        return tuple(
            StoredInspection(
                id=i, asset=asset, received_ns=ns, inspection=load(given), answer=load(answer), done=bool(done)
            )
            for i, asset, ns, given, answer, done in rows
        )

    def _decisions(self, which: str, values: Sequence[Any] = ()) -> tuple[StoredDecision, ...]:
        columns = "id, asset, received_ns, name, verb, done, refused, signed_by, note"
        rows = self._rows(f"SELECT {columns} FROM decisions {which}", values)
        return tuple(
            StoredDecision(
                id=i, asset=asset, received_ns=ns, name=name, verb=verb, done=bool(done), refused=refused, by=by,
                note=note,
            )
            for i, asset, ns, name, verb, done, refused, by, note in rows
        )  # fmt: skip

    @staticmethod
    def _ensure(db: sqlite3.Connection, asset: str) -> None:
        db.execute("INSERT OR IGNORE INTO assets (asset) VALUES (?)", (asset,))

    @staticmethod
    def _keep(db: sqlite3.Connection, asset: str, **columns: Mapping[str, Any] | None) -> None:
        for column, value in columns.items():
            if value is not None:
                db.execute(f"UPDATE assets SET {column} = ? WHERE asset = ?", (dump(value), asset))

    @staticmethod
    def _add_events(db: sqlite3.Connection, asset: str, events: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
        db.executemany(
            "INSERT INTO events (asset, kind, data) VALUES (?, ?, ?)",
            [(asset, kind, dump(data)) for kind, data in events],
        )
