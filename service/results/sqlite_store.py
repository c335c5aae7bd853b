"""Results in one SQLite file in WAL mode under the data directory.

One window is one transaction: its record, the twin's state, its report, the place to resume the stream
from, the data quality and the events are there together or not at all. The window's start is its name: a
window that is committed already is not committed again, so nothing is counted twice. `synchronous=FULL`
makes a committed window outlive the process and the machine's power.
"""

from __future__ import annotations

import json
import sqlite3
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from service.contract.trend import figures
from service.contract.version_1 import current_record, current_report
from service.errors import StoreError
from service.json_text import plain
from service.results.store import Event, StoredAsset, StoredDecision, StoredWindow, faults_of

MIGRATIONS = (
    """
    CREATE TABLE assets (
        asset TEXT PRIMARY KEY,
        rig TEXT,
        state TEXT,
        report TEXT,
        assembly TEXT,
        quality TEXT
    );
    CREATE TABLE windows (
        asset TEXT NOT NULL REFERENCES assets(asset),
        start_ns INTEGER NOT NULL,
        record TEXT NOT NULL,
        figures TEXT NOT NULL,
        PRIMARY KEY (asset, start_ns)
    ) WITHOUT ROWID;
    CREATE TABLE events (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        asset TEXT NOT NULL REFERENCES assets(asset),
        kind TEXT NOT NULL,
        data TEXT NOT NULL
    );
    CREATE INDEX events_of_asset ON events (asset, id);
    CREATE TABLE inspections (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        asset TEXT NOT NULL REFERENCES assets(asset),
        received_ns INTEGER NOT NULL,
        inspection TEXT NOT NULL,
        answer TEXT NOT NULL
    );
    """,
    """
    CREATE TABLE decisions (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        asset TEXT NOT NULL REFERENCES assets(asset),
        received_ns INTEGER NOT NULL,
        name TEXT NOT NULL,
        verb TEXT NOT NULL,
        done INTEGER NOT NULL DEFAULT 0,
        refused TEXT
    );
    CREATE INDEX decisions_waiting ON decisions (done, id);
    """,
    """
    ALTER TABLE windows ADD COLUMN number INTEGER NOT NULL DEFAULT 0;
    UPDATE windows SET number = json_extract(record, '$.index');
    CREATE INDEX windows_by_number ON windows (asset, number);
    ALTER TABLE assets ADD COLUMN windows INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE assets ADD COLUMN updates INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE assets ADD COLUMN received_ns INTEGER;
    UPDATE assets SET
        windows = (SELECT COUNT(*) FROM windows AS w WHERE w.asset = assets.asset),
        updates = (
            SELECT COUNT(*) FROM windows AS w WHERE w.asset = assets.asset AND json_extract(w.record, '$.updated')
        );
    CREATE TABLE fault_totals (
        asset TEXT NOT NULL REFERENCES assets(asset),
        kind TEXT NOT NULL,
        channel TEXT NOT NULL,
        action TEXT NOT NULL,
        count INTEGER NOT NULL,
        windows INTEGER NOT NULL,
        PRIMARY KEY (asset, kind, channel, action)
    ) WITHOUT ROWID;
    INSERT INTO fault_totals
        SELECT w.asset, json_extract(f.value, '$.kind'), json_extract(f.value, '$.channel'),
            json_extract(f.value, '$.action'), SUM(json_extract(f.value, '$.count')), COUNT(DISTINCT w.start_ns)
        FROM windows AS w, json_each(w.record, '$.faults') AS f
        GROUP BY 1, 2, 3, 4;
    """,
)
"""The schema's steps: entry i takes `PRAGMA user_version` from i to i + 1. Only ever append."""


class SqliteStore:
    """A `ResultStore` in one file. Safe to use from several threads of one process."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._lock = threading.RLock()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(self.path, isolation_level=None, check_same_thread=False, timeout=10)
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = FULL")
            self._db.execute("PRAGMA foreign_keys = ON")
            self._migrate()
        except (sqlite3.Error, OSError) as error:
            raise StoreError(f"{self.path} cannot be used as the service's database: {error}") from error

    def close(self) -> None:
        with self._lock:
            self._db.close()

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
                "INSERT OR IGNORE INTO windows (asset, start_ns, record, figures, number) VALUES (?, ?, ?, ?, ?)",
                (asset, start_ns, _dump(record), _dump(shown), record["index"]),
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

    def add_inspection(self, asset: str, inspection: Mapping[str, Any], answer: Mapping[str, Any]) -> dict[str, Any]:
        """Keeps one measured depth with the twin's answer; both, the inspection with its id and time."""
        received = time.time_ns()
        with self._transaction() as db:
            self._ensure(db, asset)
            row = db.execute(
                "INSERT INTO inspections (asset, received_ns, inspection, answer) VALUES (?, ?, ?, ?)",
                (asset, received, _dump(inspection), _dump(answer)),
            )
            return {"inspection": {"id": row.lastrowid, "received_ns": received, **inspection}, **answer}

    def add_decision(self, asset: str, name: str, verb: str) -> int:
        """Keeps a decision that waits to be carried out; its id."""
        with self._transaction() as db:
            self._ensure(db, asset)
            row = db.execute(
                "INSERT INTO decisions (asset, received_ns, name, verb) VALUES (?, ?, ?, ?)",
                (asset, time.time_ns(), name, verb),
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
        columns = "rig, state, report, assembly, quality, windows, updates, received_ns"
        rows = self._rows(f"SELECT {columns} FROM assets WHERE asset = ?", (asset,))
        if not rows:
            return StoredAsset(asset=asset)
        *texts, windows, updates, received_ns = rows[0]
        rig, state, report, assembly, quality = (_load(text) for text in texts)
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
        )

    def windows(self, asset: str, after: int = -1, limit: int = 1000, every: int = 1) -> tuple[StoredWindow, ...]:
        """Windows with an index above `after`, oldest first; every so many, and the newest."""
        return self._windows(
            "asset = :asset AND number > :after AND (number % :every = 0 "
            "OR number = (SELECT MAX(number) FROM windows WHERE asset = :asset)) ORDER BY number LIMIT :limit",
            {"asset": asset, "after": after, "every": every, "limit": limit},
        )

    def latest_windows(self, asset: str, limit: int) -> tuple[StoredWindow, ...]:
        """The newest windows, oldest first."""
        newest = "asset = :asset ORDER BY number DESC LIMIT :limit"
        return self._windows(newest, {"asset": asset, "limit": limit})[::-1]

    def events(self, asset: str, after: int, limit: int = 500) -> tuple[Event, ...]:
        """The asset's events with an id above `after`, oldest first."""
        rows = self._rows(
            "SELECT id, kind, data FROM events WHERE asset = ? AND id > ? ORDER BY id LIMIT ?",
            (asset, after, limit),
        )
        return tuple(Event(id=i, asset=asset, kind=kind, data=_load(data)) for i, kind, data in rows)

    def last_event_id(self, asset: str) -> int:
        return self._rows("SELECT COALESCE(MAX(id), 0) FROM events WHERE asset = ?", (asset,))[0][0]

    def inspections(self, asset: str, after: int = 0, limit: int = 1000) -> tuple[Mapping[str, Any], ...]:
        rows = self._rows(
            "SELECT id, received_ns, inspection, answer FROM inspections "
            "WHERE asset = ? AND id > ? ORDER BY id LIMIT ?",
            (asset, after, limit),
        )
        return tuple(
            {"inspection": {"id": i, "received_ns": received, **_load(given)}, **_load(answer)}
            for i, received, given, answer in rows
        )

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

    def _migrate(self) -> None:
        (version,) = self._db.execute("PRAGMA user_version").fetchone()
        if version > len(MIGRATIONS):
            raise StoreError(
                f"{self.path} has schema version {version}, this program knows up to {len(MIGRATIONS)}: "
                "it was written by a newer gear-twin"
            )
        for number, script in enumerate(MIGRATIONS[version:], start=version + 1):
            self._db.executescript(f"BEGIN IMMEDIATE; {script} PRAGMA user_version = {number}; COMMIT;")

    @contextmanager
    def _transaction(self):
        with self._lock:
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield self._db
            except BaseException:
                self._db.execute("ROLLBACK")
                raise
            self._db.execute("COMMIT")

    def _windows(self, which: str, values: Mapping[str, Any]) -> tuple[StoredWindow, ...]:
        rows = self._rows(f"SELECT start_ns, record, figures FROM windows WHERE {which}", values)
        return tuple(
            StoredWindow(start_ns=start, record=current_record(_load(record)), figures=_load(shown))
            for start, record, shown in rows
        )

    def _rows(self, query: str, values: Sequence[Any] | Mapping[str, Any] = ()) -> list[tuple]:
        with self._lock:
            return self._db.execute(query, values).fetchall()

    def _decisions(self, which: str, values: Sequence[Any] = ()) -> tuple[StoredDecision, ...]:
        rows = self._rows(f"SELECT id, asset, received_ns, name, verb, done, refused FROM decisions {which}", values)
        return tuple(
            StoredDecision(id=i, asset=asset, received_ns=ns, name=name, verb=verb, done=bool(done), refused=refused)
            for i, asset, ns, name, verb, done, refused in rows
        )

    @staticmethod
    def _ensure(db: sqlite3.Connection, asset: str) -> None:
        db.execute("INSERT OR IGNORE INTO assets (asset) VALUES (?)", (asset,))

    @staticmethod
    def _keep(db: sqlite3.Connection, asset: str, **columns: Mapping[str, Any] | None) -> None:
        for column, value in columns.items():
            if value is not None:
                db.execute(f"UPDATE assets SET {column} = ? WHERE asset = ?", (_dump(value), asset))

    @staticmethod
    def _add_events(db: sqlite3.Connection, asset: str, events: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
        db.executemany(
            "INSERT INTO events (asset, kind, data) VALUES (?, ?, ?)",
            [(asset, kind, _dump(data)) for kind, data in events],
        )


def _dump(value: Any) -> str | None:
    return None if value is None else json.dumps(plain(value), allow_nan=False, separators=(",", ":"))


def _load(text: str | None) -> Any:
    return None if text is None else json.loads(text)
