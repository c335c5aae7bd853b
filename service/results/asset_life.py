"""The life of assets: changes that people made, windows that wait for an answer, and which stream is which asset.

A change is kept when it is submitted and carried out once, with all that it ends, in one transaction
(service/runtime/changes.py). A window that waits is a file; what names it is written with it and deleted with the
transaction that processes the window, so that a kill loses no window and counts none twice.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from service.errors import StoreError
from service.results.json_columns import dump, load
from service.results.store import Tables
from service.results.window_file import SUFFIX, read_window, write_window
from twin.windows import Window

WAITING_WINDOWS = 1000  # of one asset that are kept until its question is answered ...
WAITING_BYTES = 2**30  # ... and what they may take on disk


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredChange:
    """One change of an asset."""

    id: int
    asset: str
    received_ns: int
    kind: str
    given: Mapping[str, Any]  # by, note, at, and what the kind needs
    done: bool  # carried out, or refused
    refused: str | None
    effect: Mapping[str, Any] | None  # what it changed, once it is carried out


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitingWindow:
    """One window that waits for an answer."""

    id: int
    start_ns: int
    bytes: int


class AssetLife:
    """Changes, waiting windows and routes of all assets: in the results' database and a folder for the windows."""

    def __init__(self, database: Tables, folder: Path | None = None) -> None:
        """folder  of the windows that wait; None where no window ever does"""
        self._database, self.folder = database, folder
        if folder is None:
            return
        try:
            folder.mkdir(parents=True, exist_ok=True)
            known = {row[0] for row in database.rows("SELECT id FROM waiting")}
            for path in folder.iterdir():
                if path.suffix != SUFFIX or not path.stem.isdigit() or int(path.stem) not in known:
                    path.unlink(missing_ok=True)  # of a window that has been processed, or was never committed
        except OSError as error:
            raise StoreError(f"{folder} cannot hold windows that wait: {error.strerror or error}") from error

    def transaction(self) -> AbstractContextManager[Any]:
        """A transaction of the database, which other stores in it share."""
        return self._database.transaction()

    # -- changes -------------------------------------------------------------------------------------

    def add_change(self, asset: str, kind: str, given: Mapping[str, Any]) -> int:
        """Keeps a change that waits to be carried out; its id."""
        with self.transaction() as db:
            _ensure(db, asset)
            row = db.execute(
                "INSERT INTO changes (asset, received_ns, kind, given) VALUES (?, ?, ?, ?)",
                (asset, time.time_ns(), kind, dump(given)),
            )
            assert row.lastrowid is not None
            return row.lastrowid

    def change_done(self, number: int, effect: Mapping[str, Any]) -> bool:
        """Marks a change as carried out; False where it was done before. Call it within the transaction."""
        with self.transaction() as db:
            query = "UPDATE changes SET done = 1, effect = ? WHERE id = ? AND done = 0"
            return bool(db.execute(query, (dump(effect), number)).rowcount)

    def refuse_change(self, number: int, reason: str) -> None:
        """Ends a change that cannot be carried out."""
        with self.transaction() as db:
            db.execute("UPDATE changes SET done = 1, refused = ? WHERE id = ? AND done = 0", (reason, number))

    def change(self, number: int) -> StoredChange:
        (found,) = self._changes("WHERE id = ?", (number,))
        return found

    def changes(self, asset: str) -> tuple[StoredChange, ...]:
        """All changes of an asset, oldest first."""
        return self._changes("WHERE asset = ? ORDER BY id", (asset,))

    def pending_changes(self) -> tuple[StoredChange, ...]:
        """Those that wait to be carried out, oldest first."""
        return self._changes("WHERE done = 0 ORDER BY id")

    def _changes(self, which: str, values: Iterable[Any] = ()) -> tuple[StoredChange, ...]:
        columns = "id, asset, received_ns, kind, given, done, refused, effect"
        rows = self._database.rows(f"SELECT {columns} FROM changes {which}", tuple(values))
        return tuple(
            StoredChange(
                id=i, asset=asset, received_ns=ns, kind=kind, given=load(given), done=bool(done), refused=refused,
                effect=load(effect),
            )
            for i, asset, ns, kind, given, done, refused, effect in rows
        )  # fmt: skip

    # -- windows that wait ---------------------------------------------------------------------------

    def add_waiting(self, asset: str, window: Window) -> bool:
        """Keeps a window until the asset's question is answered; False where there is no room. Within a transaction."""
        count, taken = self.waiting_total(asset)
        if count >= WAITING_WINDOWS or taken >= WAITING_BYTES:
            return False
        with self.transaction() as db:
            _ensure(db, asset)
            row = db.execute(
                "INSERT INTO waiting (asset, start_ns, bytes) VALUES (?, ?, 0)", (asset, window.start_time_ns)
            )
            assert row.lastrowid is not None
            size = write_window(self._path(row.lastrowid), window)
            db.execute("UPDATE waiting SET bytes = ? WHERE id = ?", (size, row.lastrowid))
        return True

    def waiting(self, asset: str) -> tuple[WaitingWindow, ...]:
        """The windows of an asset that wait, in the order in which they came."""
        rows = self._database.rows("SELECT id, start_ns, bytes FROM waiting WHERE asset = ? ORDER BY id", (asset,))
        return tuple(WaitingWindow(id=i, start_ns=start, bytes=size) for i, start, size in rows)

    def waiting_total(self, asset: str) -> tuple[int, int]:
        """How many windows wait, and what they take [bytes]."""
        query = "SELECT COUNT(*), COALESCE(SUM(bytes), 0) FROM waiting WHERE asset = ?"
        ((count, taken),) = self._database.rows(query, (asset,))
        return count, taken

    def read_waiting(self, number: int) -> Window:
        """A window that waits; OSError, ValueError or KeyError where its file cannot be read."""
        return read_window(self._path(number))

    def drop_waiting(self, number: int) -> None:
        """Ends the wait of a window that is processed by the present transaction."""
        with self.transaction() as db:
            db.execute("DELETE FROM waiting WHERE id = ?", (number,))

    def file_of(self, number: int) -> Path:
        """The file of a window that waits."""
        return self._path(number)

    def delete_file(self, number: int) -> None:
        """Deletes the file of a window whose wait has ended, after the transaction."""
        self._path(number).unlink(missing_ok=True)

    def give_waiting(self, asset: str, other: str) -> None:
        """The windows that wait are another asset's."""
        with self.transaction() as db:
            _ensure(db, other)
            db.execute("UPDATE waiting SET asset = ? WHERE asset = ?", (other, asset))

    def _path(self, number: int) -> Path:
        assert self.folder is not None
        return self.folder / f"{number:08d}{SUFFIX}"

    # -- routes --------------------------------------------------------------------------------------

    def routes(self) -> dict[str, str]:
        """Streams whose asset has another name than the stream."""
        return dict(self._database.rows("SELECT stream, asset FROM routes WHERE stream <> asset"))

    def route(self, stream: str, asset: str) -> None:
        """From now on the frames of a stream, and of all that were routed to its asset before, are this asset's."""
        with self.transaction() as db:
            _ensure(db, asset)
            db.execute("UPDATE routes SET asset = ? WHERE asset = ?", (asset, stream))
            db.execute("INSERT OR REPLACE INTO routes (stream, asset) VALUES (?, ?)", (stream, asset))

    # -- names ---------------------------------------------------------------------------------------

    def rename(self, asset: str, name: str) -> None:
        """Gives an asset another name in every table, and routes the frames of its old name to it; one transaction."""
        with self.transaction() as db:
            db.execute("PRAGMA defer_foreign_keys = ON")
            tables = [row[0] for row in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()]
            for table in tables:
                columns = {row[1] for row in db.execute(f"PRAGMA table_info({table})").fetchall()}
                if "asset" in columns:
                    db.execute(f"UPDATE {table} SET asset = ? WHERE asset = ?", (name, asset))
            db.execute("INSERT OR REPLACE INTO routes (stream, asset) VALUES (?, ?)", (asset, name))


def _ensure(db: Any, asset: str) -> None:
    db.execute("INSERT OR IGNORE INTO assets (asset) VALUES (?)", (asset,))
