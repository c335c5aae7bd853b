"""One SQLite file in WAL mode, shared by everything that is kept: windows, decisions, events and what else there is.

    with database.transaction() as db:      # one transaction, also where several stores write within it
        db.execute(...)

`synchronous=FULL` makes a committed transaction outlive the process and the machine's power.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from service.errors import StoreError
from service.results.json_columns import dump, load
from service.results.migrations import MIGRATIONS
from service.results.storage_faults import storage_error

__all__ = ["Database", "dump", "load"]


class Database:
    """A connection to one file, safe to use from several threads of one process."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._lock = threading.RLock()
        self._depth = 0  # of transactions within one another
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
        """Closes the file."""
        with self._lock:
            self._db.close()

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """A transaction that is committed at the end, or rolled back whole; one within another is part of it.

        StorageUnavailable where the storage cannot be used now, StoreError where it is damaged; then nothing changed.
        """
        with self._lock, self._faults():
            if self._depth == 0:
                self._db.execute("BEGIN IMMEDIATE")
            self._depth += 1
            try:
                yield self._db
                if self._depth == 1:
                    self._db.execute("COMMIT")
            except BaseException:
                if self._depth == 1 and self._db.in_transaction:
                    self._db.execute("ROLLBACK")
                raise
            finally:
                self._depth -= 1

    @contextmanager
    def _faults(self) -> Iterator[None]:
        """Failures of the storage as errors of the service."""
        try:
            yield
        except sqlite3.Error as error:
            meant = storage_error(error, str(self.path))
            if meant is None:
                raise
            raise meant from error

    def rows(self, query: str, values: Sequence[Any] | Mapping[str, Any] = ()) -> list[tuple]:
        """All rows that a query answers; errors as those of a transaction."""
        with self._lock, self._faults():
            return self._db.execute(query, values).fetchall()

    def _migrate(self) -> None:
        (version,) = self._db.execute("PRAGMA user_version").fetchone()
        if version > len(MIGRATIONS):
            raise StoreError(
                f"{self.path} has schema version {version}, this program knows up to {len(MIGRATIONS)}: "
                "it was written by a newer gear-twin"
            )
        for number, script in enumerate(MIGRATIONS[version:], start=version + 1):
            self._db.executescript(f"BEGIN IMMEDIATE; {script} PRAGMA user_version = {number}; COMMIT;")
