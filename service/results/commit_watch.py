"""How processes notice one another's commits: whoever waits for something to be committed waits here.

    with database.watching() as watch:
        while not ended:
            if watch.wait(0.5) is not None: ...   # look at the tables

After each commit to SQLite the process sets the times of the file's folder, which others watch by inotify. PostgreSQL
passes on which assets are shown otherwise after a transaction (NOTIFY). A notice may be lost: whoever waits looks, too.
"""

from __future__ import annotations

import ctypes
import logging
import os
import select
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import sqlalchemy as sa

log = logging.getLogger(__name__)

_TELL = sa.text("SELECT pg_notify(:channel, text) FROM unnest(CAST(:texts AS text[])) AS text")

CHANNEL = "gear_twin"  # on which a server passes on what is committed
LOOK_EVERY = 2.0  # for a commit that nobody tells: its process was killed just then, or is another program's [s]
SERVER_LOOK_EVERY = 0.5  # the same, where a server passes on what is committed [s]
LOOK_OFTEN = 0.2  # the same where the system has no notices, or no more of them [s]
TIMES_SET = 0x4  # IN_ATTRIB of Linux's inotify
GATHER = 0.01  # during which notifications are taken together [s]
PAUSE = 1.0  # after the database did not answer [s]
NAMED = "names"  # is passed on where an asset has been given a name that hashes to another share


class Shown(NamedTuple):
    """The row of an asset that a transaction has written, by which the asset is shown."""

    share: int
    version: int
    asset: str


class Noticed(NamedTuple):
    """That something has been committed.

    shown   rows that have been written
    look    whether the table of assets says of others
    named   whether an asset may have been given a name that hashes to another share
    missed  whether more may have been committed, of any asset
    """

    shown: frozenset[Shown] = frozenset()
    look: bool = False
    named: bool = False
    missed: bool = False


SOMETHING = Noticed(look=True)


class CommitWatch(Protocol):
    """One who waits, in one thread."""

    def wait(self, seconds: float) -> Noticed | None:
        """Waits until something has been committed, for so long at most [s]; None where nothing was."""
        ...

    def close(self) -> None: ...


class FileWatch:
    """Asks SQLite for the number of what has been written to a file, whenever `say_committed` was called."""

    def __init__(self, connect: Callable[[], Any], folder: Path) -> None:
        """
        connect  gives a connection of the driver, for this alone
        folder   of the file
        """
        self._connect, self._folder = connect, folder
        self._seen: int | None = None
        self._asked = float("-inf")  # monotonic [s]
        self._connection: Any = None
        self._notices: _Notices | None = None

    def wait(self, seconds: float) -> Noticed | None:
        end, noticed = time.monotonic() + seconds, False
        while True:
            if noticed or time.monotonic() - self._asked >= LOOK_EVERY:
                try:
                    present = self._number()
                except Exception as error:  # whoever keeps something there says why
                    log.debug("the file of the database: %s", error)
                    self.close()
                    time.sleep(min(PAUSE, seconds))
                    return None
                if present != self._seen:
                    self._seen = present
                    return SOMETHING
            now = time.monotonic()
            if now >= end:
                return None
            assert self._notices is not None  # the first turn has asked
            noticed = self._notices.wait(min(end, self._asked + LOOK_EVERY) - now)

    def _number(self) -> int:
        self._notices = self._notices or _Notices(self._folder)
        self._connection = self._connection or self._connect()
        self._asked = time.monotonic()
        ((number,),) = self._connection.execute("PRAGMA data_version")
        return number

    def close(self) -> None:
        self._seen, self._asked = None, float("-inf")  # another connection counts otherwise
        notices, self._notices = self._notices, None
        if notices is not None:
            notices.close()
        _close(self)


class _Notices:
    """Notices that a folder's times were set, by inotify. Without it, each wait is short and ends with "perhaps"."""

    def __init__(self, folder: Path) -> None:
        self._events = -1
        with suppress(AttributeError):  # a system without it
            system = ctypes.CDLL(None)
            self._events = system.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
            if self._events >= 0 and system.inotify_add_watch(self._events, os.fsencode(folder), TIMES_SET) < 0:
                self.close()

    def wait(self, seconds: float) -> bool:
        """Whether the times may have been set, which ends the wait [s]."""
        if self._events < 0:
            time.sleep(max(0.0, min(seconds, LOOK_OFTEN)))
            return True
        ready = select.poll()
        ready.register(self._events, select.POLLIN)
        if not ready.poll(max(0.0, 1000 * seconds)):
            return False
        with suppress(BlockingIOError):
            os.read(self._events, 2**16)
        return True

    def close(self) -> None:
        if self._events >= 0:
            os.close(self._events)
        self._events = -1


def say_committed(folder: Path) -> None:
    """Tells all who wait for commits to a file of SQLite in a folder, after one: it sets the folder's times."""
    with suppress(OSError):  # it is committed, and found by looks
        os.utime(folder)


class SharedWatch:
    """What one thread notices, for any number of others."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._number, self._seen = 0, threading.local()

    def note(self) -> None:
        """Something has been committed."""
        with self._changed:
            self._number += 1
            self._changed.notify_all()

    def wait(self, seconds: float) -> Noticed | None:
        with self._changed:
            before = getattr(self._seen, "number", 0)
            self._changed.wait_for(lambda: self._number != before, seconds)
            self._seen.number = self._number
            return None if self._number == before else SOMETHING

    def close(self) -> None:
        pass


class ServerWatch:
    """Listens on a connection of its own. Notices may be lost: now and then it asks for a look."""

    def __init__(self, connect: Callable[[], Any]) -> None:
        """connect  gives a connection of the driver that commits by itself"""
        self._connect, self._looked = connect, float("-inf")  # monotonic [s]
        self._connection: Any = None

    def wait(self, seconds: float) -> Noticed | None:
        try:
            if self._connection is None:
                self._connection = self._connect()
                self._connection.execute(f"LISTEN {CHANNEL}")
                return Noticed(named=True, missed=True)
            found = [each.payload for each in self._connection.notifies(timeout=seconds, stop_after=1)]
            if found:
                found += [each.payload for each in self._connection.notifies(timeout=GATHER)]
            if look := time.monotonic() - self._looked >= SERVER_LOOK_EVERY:
                self._looked = time.monotonic()
            shown = frozenset(filter(None, map(_shown, found)))
            return Noticed(shown, look, NAMED in found) if found or look else None
        except Exception as error:  # whoever keeps something there says why
            log.debug("the notifications of the database: %s", error)
            self.close()
            time.sleep(min(PAUSE, seconds))
            return None

    def close(self) -> None:
        _close(self)


def tell_server(execute: Callable[[Any, Any], object], said: Collection[Shown | str]) -> None:
    """Passes on what has been committed to a server, by a statement of its own."""
    texts = [each if isinstance(each, str) else " ".join(map(str, each)) for each in said]
    execute(_TELL, {"channel": CHANNEL, "texts": sorted(texts)})


def _shown(text: str) -> Shown | None:
    """The row that a notification is of; None where it is of none, or another program's."""
    share, _, rest = text.partition(" ")
    version, _, asset = rest.partition(" ")
    return Shown(int(share), int(version), asset) if share.isdecimal() and version.isdecimal() and asset else None


def _close(watch: FileWatch | ServerWatch) -> None:
    connection, watch._connection = watch._connection, None
    if connection is not None:
        with suppress(Exception):
            connection.close()
