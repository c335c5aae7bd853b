"""How processes notice one another's commits: whoever waits for something to be committed waits here.

    with database.watching() as watch:
        while not ended:
            if watch.wait(0.5) is not None: ...   # look at the tables

An SQLite file tells each connection that another one has written; a PostgreSQL server passes on which assets a
transaction has written to. What a server's notification loses is found by whoever looks again now and then.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

log = logging.getLogger(__name__)

CHANNEL = "gear_twin"  # on which a server passes on what is committed
LOOK_EVERY, LOOK_SELDOM = 0.02, 0.2  # whether a file has been written to, and where it has not been for a while [s]
BUSY = 0.3  # that while [s]: a service that is idle writes every other second
JUST_NOW_NS = 50_000_000  # a file written to so lately may be written to again at the same time of its clock [ns]
ASK_SELDOM = 2.0  # whatever the times of files say: those of some file systems are whole seconds [s]
GATHER = 0.01  # during which notifications are taken together [s]
ALL = frozenset({""})  # instead of the assets
PAUSE = 1.0  # after the database did not answer [s]


class CommitWatch(Protocol):
    """One who waits, in one thread.

    misses  whether something may be committed of which it notices nothing
    """

    misses: bool

    def wait(self, seconds: float) -> Collection[str] | None:
        """Waits until something has been committed, for so long at most [s].

        None where nothing was; `()` where the table of assets says of which it was; `ALL` where all may have changed;
        else the assets' ids.
        """
        ...

    def close(self) -> None: ...


class FileWatch:
    """Asks SQLite for the number of what has been written to a file, whenever the file or its log was written to."""

    misses = False

    def __init__(self, connect: Callable[[], Any], path: Path) -> None:
        """
        connect  gives a connection of the driver, for this alone
        path     of the file
        """
        self._connect, self._files = connect, (path, path.with_name(f"{path.name}-wal"))
        self._changed = self._asked = 0.0  # monotonic [s]
        self._seen: int | None = None
        self._written: list[tuple[int, int]] | None = None  # as the files were when that was asked for
        self._connection: Any = None

    def wait(self, seconds: float) -> Collection[str] | None:
        end = time.monotonic() + seconds
        while True:
            if self._may_have_changed(written := self._as_written()):
                try:
                    self._connection = self._connection or self._connect()
                    ((present,),) = self._connection.execute("PRAGMA data_version")
                except Exception as error:  # whoever keeps something there says why
                    log.debug("the file of the database: %s", error)
                    self.close()
                    time.sleep(min(PAUSE, seconds))
                    return None
                self._written, self._asked = written, time.monotonic()
                if present != self._seen:
                    self._seen, self._changed = present, time.monotonic()
                    return ()
            now = time.monotonic()
            if now >= end:
                return None
            time.sleep(min(LOOK_EVERY if now - self._changed < BUSY else LOOK_SELDOM, end - now))

    def close(self) -> None:
        self._seen = self._written = None  # another connection counts otherwise
        _close(self)

    def _may_have_changed(self, written: list[tuple[int, int]]) -> bool:
        """Whether the database is to be asked, as the files were written to."""
        if written != self._written or time.monotonic() - self._asked > ASK_SELDOM:
            return True
        return time.time_ns() - max(at for at, _ in written) < JUST_NOW_NS

    def _as_written(self) -> list[tuple[int, int]]:
        """When the file and its log were written to [Unix time, ns], and their sizes [bytes]; 0 for one not there."""
        found = []
        for file in self._files:
            try:
                stat = file.stat()
                found.append((stat.st_mtime_ns, stat.st_size))
            except OSError:
                found.append((0, 0))
        return found


class SharedWatch:
    """What one thread notices, for any number of others."""

    misses = False

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._number, self._seen = 0, threading.local()

    def note(self) -> None:
        """Something has been committed."""
        with self._changed:
            self._number += 1
            self._changed.notify_all()

    def wait(self, seconds: float) -> Collection[str] | None:
        with self._changed:
            before = getattr(self._seen, "number", 0)
            self._changed.wait_for(lambda: self._number != before, seconds)
            self._seen.number = self._number
            return None if self._number == before else ()

    def close(self) -> None:
        pass


class ServerWatch:
    """Listens on a connection of its own."""

    misses = True

    def __init__(self, connect: Callable[[], Any]) -> None:
        """connect  gives a connection of the driver that commits by itself"""
        self._connect = connect
        self._connection: Any = None

    def wait(self, seconds: float) -> Collection[str] | None:
        try:
            if self._connection is None:
                self._connection = self._connect()
                self._connection.execute(f"LISTEN {CHANNEL}")
                return ALL
            found = [each.payload for each in self._connection.notifies(timeout=seconds, stop_after=1)]
            if not found:
                return None
            found += [each.payload for each in self._connection.notifies(timeout=GATHER)]
            return frozenset(found)
        except Exception as error:  # whoever keeps something there says why
            log.debug("the notifications of the database: %s", error)
            self.close()
            time.sleep(min(PAUSE, seconds))
            return None

    def close(self) -> None:
        _close(self)


def _close(watch: FileWatch | ServerWatch) -> None:
    connection, watch._connection = watch._connection, None
    if connection is not None:
        with suppress(Exception):
            connection.close()
