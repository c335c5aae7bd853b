"""Completed raw recordings on their way to an object store: `{area}/{asset}/{start_ns}.mcap`.

The folder in which they are recorded is the spool: a recording is deleted there once the store has it. While the store
cannot be used they wait, and the oldest are deleted beyond the spool's size. Neither windows nor the recording wait.
The store's objects are bounded by age and size, whoever wrote them.
"""

from __future__ import annotations

import filecmp
import logging
import queue
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from service.errors import InputError, StoreError
from service.results.asset_folders import folder_of
from service.results.asset_list import area_of
from service.results.object_store import ObjectStore
from service.results.raw_recordings import RawRecordings, recordings_in
from service.results.scratch import scratch
from service.results.stored_recordings import moment_of
from service.settings import HOUR, Settings
from service.stream.sources.mcap import Recording

if TYPE_CHECKING:
    from service.stream.wire.topics import Channel

log = logging.getLogger(__name__)

LOOK_EVERY = 2.0  # whether a recording has been completed [s]
PAUSES = (2.0, 300.0)  # shortest and longest pause before the store is tried again [s]
DELETE_EVERY = 600.0  # that old objects are deleted [s]
PROBE = "gear-twin-probe"  # an object that says whether anything can be written
END_WAIT = 10.0  # how long what has just been completed is waited for at the end [s]


class SegmentSender:
    """Moves completed recordings, in a thread of its own, until ended.

    open_store  the store; StoreError while it cannot be used
    keep_bytes, keep_seconds  of its objects
    """

    def __init__(
        self,
        folder: Path,
        open_store: Callable[[], ObjectStore],
        *,
        keep_bytes: int,
        keep_seconds: float,
        prefix: str,
        pauses: tuple[float, float] = PAUSES,
        now: Callable[[], float] = time.time,
    ) -> None:
        self._folder, self._open_store, self._prefix, self._now = folder, open_store, prefix, now
        self._keep_bytes, self._keep_seconds, self._pauses = keep_bytes, keep_seconds, pauses
        self._store: ObjectStore | None = None
        self._moved: queue.SimpleQueue[Path] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._pause = pauses[0]
        self._delete_at = 0.0
        self._stored = self._failed = self._deleted = self._waiting = 0
        self._unavailable = False
        self._aside: dict[Path, float] = {}  # recordings that the store does not take, and when each is tried again
        self.thread = threading.Thread(target=self._run, name="raw segments", daemon=True)
        self.thread.start()

    @classmethod
    def of(cls, settings: Settings, recordings: RawRecordings, prefix: str) -> SegmentSender:
        """By the settings; `prefix` is that of the recordings."""
        url = settings.raw_url
        assert url is not None
        return cls(
            recordings.folder,
            lambda: ObjectStore(url, make=True),
            keep_bytes=round(settings.raw_keep_gb * 1e9),
            keep_seconds=settings.raw_keep_days * 24 * HOUR,
            prefix=prefix,
        )

    def turn(self, recordings: RawRecordings) -> None:
        """Notes in the spool what has left it; called by the thread that records."""
        while not self._moved.empty():
            recordings.forget(self._moved.get())

    def end(self) -> None:
        """Moves what is complete, as far as that takes no more than some seconds; the next start moves the rest."""
        self._stopping.set()
        self.thread.join(END_WAIT)

    def figures(self) -> Mapping[str, float]:
        """Figures for /metrics."""
        return {
            "raw_segments_stored": self._stored,
            "raw_segments_failed": self._failed,
            "raw_segments_deleted": self._deleted,
            "raw_segments_waiting": self._waiting,
            "raw_store_unavailable": float(self._unavailable),
        }

    def _run(self) -> None:
        wait = 0.0
        while not self._stopping.wait(wait):
            wait = self._turn()
        if not self._unavailable:
            self._turn()

    def _turn(self) -> float:
        """Moves all that is complete; how long to wait before the next time [s]."""
        try:
            self._move_all()
            if time.monotonic() >= self._delete_at:
                self._delete_old()
                self._delete_at = time.monotonic() + DELETE_EVERY
        except Exception as error:  # whatever it is, frames are recorded, and it is tried again
            return self._fail(error)
        if self._unavailable:
            log.info("raw recordings are moved to %s again", self._opened().where)
        self._unavailable, self._pause = False, self._pauses[0]
        return min(LOOK_EVERY, self._pause)

    def _fail(self, error: Exception) -> float:
        self._failed += 1
        self._unavailable, self._store = True, None
        wait, self._pause = self._pause, min(2 * self._pause, self._pauses[1])
        log.warning(
            "raw recordings cannot be moved to the object store: %s; it is tried again in %g s",
            error if isinstance(error, StoreError) else f"{type(error).__name__}: {error}", wait,
        )  # fmt: skip
        return wait

    def _opened(self) -> ObjectStore:
        self._store = self._store or self._open_store()
        return self._store

    def _move_all(self) -> None:
        waiting = [path for path, *_ in sorted(recordings_in(self._folder), key=lambda each: each[2])]
        self._waiting, now = len(waiting), time.monotonic()
        self._aside = {path: self._aside[path] for path in waiting if path in self._aside}
        due = [path for path in waiting if self._aside.get(path, now) <= now]
        failures: dict[Path, Exception] = {}
        for path in due:
            try:
                self._move(path)
            except Exception as error:  # one that cannot be moved holds up no other
                failures[path] = error
            else:
                self._waiting -= 1
        if failures and len(failures) == len(due):  # the store is at fault, unless it takes something else
            self._opened().put(PROBE, b"gear-twin")
        for path, failure in failures.items():
            self._set_aside(path, failure)

    def _set_aside(self, path: Path, error: Exception) -> None:
        """Leaves a recording that the store does not take in the spool; it is tried again with the longest pause."""
        self._failed += 1
        if path not in self._aside:
            log.warning("%s stays in the spool: the object store takes others, but not this one: %s", path, error)
        self._aside[path] = time.monotonic() + self._pauses[1]

    def _move(self, path: Path) -> None:
        try:
            with Recording(path, self._prefix) as recording:
                asset, start = recording.assets[0], next(recording.frames(_pass)).start_time_ns
        except FileNotFoundError:
            return
        except (InputError, StopIteration) as error:
            if not path.exists():  # deleted because the spool is full
                return
            log.warning("%s holds no frame and is not moved to the object store: it is deleted (%s)", path, error)
        else:
            try:
                self._put(path, asset, start)
            except FileNotFoundError:
                return
            self._stored += 1
        path.unlink(missing_ok=True)
        self._moved.put(path)

    def _put(self, path: Path, asset: str, start: int) -> None:
        """Writes a recording under a name that is free, or that a run which was killed has given it."""
        store, area = self._opened(), area_of(asset)
        stem = f"{f'{area}/' if area else ''}{folder_of(asset)}/{start}"
        number = 1
        while True:
            name = f"{stem}.mcap" if number == 1 else f"{stem}_{number}.mcap"
            entry = store.entry(name)
            if entry is None:
                store.put(name, path)
                return
            if entry.size == path.stat().st_size and self._is_same(name, path):
                return
            number += 1

    def _is_same(self, name: str, path: Path) -> bool:
        with scratch() as folder:
            copy = folder / "copy"
            self._opened().read_to(copy, name)
            return filecmp.cmp(copy, path, shallow=False)

    def _delete_old(self) -> None:
        """Deletes the oldest segments of the store beyond its age and size; other objects stay."""
        store = self._opened()
        segments = [entry for entry in store.entries() if moment_of(entry.name.rpartition("/")[2], "") is not None]
        size, too_old = sum(entry.size for entry in segments), self._now() - self._keep_seconds
        for entry in sorted(segments, key=lambda each: each.written):
            if entry.written >= too_old and size <= self._keep_bytes:
                return
            store.delete([entry.name])
            self._deleted += 1
            size -= entry.size


def _pass(channel: Channel, error: Exception) -> None:
    """A frame that breaks the contract says nothing of when the recording begins."""
