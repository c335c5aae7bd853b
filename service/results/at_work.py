"""Which assets somebody is at work on: a claim is held by a process, and ends with it however that ends.

A claim spares work, no more: what is committed of an asset is fenced by its mark (`SqlStore.hold`). It is a lock of the
operating system on a part of a file beside an SQLite database, or of a session of a PostgreSQL server.
"""

from __future__ import annotations

import fcntl
import os
import threading
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import Protocol

from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from service.errors import StorageUnavailable

_LOCK = text("SELECT pg_try_advisory_lock(hashtextextended(current_schema() || ' ' || :of, 0))")
_UNLOCK = text("SELECT pg_advisory_unlock(hashtextextended(current_schema() || ' ' || :of, 0))")


class AtWork(Protocol):
    """The assets that one process is at work on; for any of its threads."""

    def take(self, asset: str) -> bool:
        """Whether nobody else is at work on an asset; it is claimed then. StorageUnavailable where nobody knows."""
        ...

    def give_back(self, asset: str) -> None: ...


class FileClaims:
    """Claims on parts of a file, which a process loses when it ends."""

    def __init__(self, file: Path) -> None:
        self._file = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        self._own: set[str] = set()  # the system does not keep the threads of a process apart
        self._lock = threading.Lock()

    def take(self, asset: str) -> bool:
        with self._lock:
            if asset in self._own:
                return False
            with suppress(OSError):
                fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _place_of(asset))
                self._own.add(asset)
                return True
        return False

    def give_back(self, asset: str) -> None:
        with self._lock:
            self._own.discard(asset)
            fcntl.lockf(self._file, fcntl.LOCK_UN, 1, _place_of(asset))


class SessionClaims:
    """Claims of a session of PostgreSQL; where that is lost, they are."""

    def __init__(self, engine: Engine, name: str) -> None:
        """engine  of which one connection is kept; `name` is the database, as a person knows it"""
        self._engine, self._name = engine, name
        self._session: Connection | None = None
        self._own: set[str] = set()  # a session may take a lock of its own again
        self._lock = threading.Lock()

    def take(self, asset: str) -> bool:
        with self._lock:
            if asset in self._own:
                return False
            if self._asked(_LOCK, asset):
                self._own.add(asset)
                return True
        return False

    def give_back(self, asset: str) -> None:
        with self._lock:
            self._own.discard(asset)
            with suppress(StorageUnavailable):
                self._asked(_UNLOCK, asset)

    def _asked(self, query: object, asset: str) -> bool:
        try:
            if self._session is None:
                self._session = self._engine.connect()
            return bool(self._session.execute(query, {"of": asset}).scalar())  # type: ignore[call-overload]
        except (DBAPIError, SQLAlchemyError) as error:
            with suppress(SQLAlchemyError):
                if self._session is not None:
                    self._session.invalidate()
                    self._session.close()
            self._session = None
            text = f"{self._name} cannot be used now (connection lost): {str(error).strip().splitlines()[0]}"
            raise StorageUnavailable(text, reason="connection lost") from error


def _place_of(asset: str) -> int:
    """The byte of the file that stands for an asset."""
    return int.from_bytes(blake2b(asset.encode(), digest_size=8).digest(), "big") >> 2
