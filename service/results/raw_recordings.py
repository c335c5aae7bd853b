"""A folder of MCAP recordings of what comes on the network, which `gear-twin record` writes, bounded by age and size.

    <folder>/<asset>/<asset>_20261123T015000.250Z.mcap        complete, with its index; the time of its first frame
    <folder>/<asset>/<asset>_20261123T020000.250Z.mcap.part   being written, or left behind by a process that was killed

A file is of one asset and holds its rig file, so that it can be assessed and replayed alone. It is completed once it is
large or old enough, another rig file holds, or its asset has been silent. One that was left behind is read up to its
last whole chunk, which is some seconds old at most, and completed by the next start. The oldest files are deleted where
all together are too large or too old, or leave too little of the disk to others. One process at a time writes there.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from service.errors import InputError
from service.results.asset_folders import folder_in
from service.stream.frames import NS
from service.stream.sources.mcap import Recording
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.topics import PREFIX, Channel

log = logging.getLogger(__name__)

SUFFIX, UNFINISHED, COPY = ".mcap", ".part", ".completed"
FLUSH_EVERY = 2.0  # a process that is killed costs no more than this [s]
SILENT = 600.0  # time without a frame of an asset after which its file is completed [s]
MOST_OPEN = 256  # files that are written at the same time
DESCRIPTION = "recorded by gear-twin record"


@dataclass(frozen=True, slots=True, kw_only=True)
class RawLimits:
    """How large a file becomes, and what all of them may take.

    roll_bytes, roll_seconds  a file that is larger, or older, is completed
    keep_bytes, keep_seconds  of all files; the oldest are deleted
    spare_bytes               of the file system, which are left to others
    """

    roll_bytes: int
    roll_seconds: float
    keep_bytes: int
    keep_seconds: float
    spare_bytes: int


@dataclass(slots=True)
class _Writing:
    """A file that is being written."""

    writer: RecordingWriter
    rig_text: bytes | None
    begun: float  # on the monotonic clock [s]
    newest: float  # when its newest frame came [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Complete:
    """A file that is complete."""

    size: int
    written: float  # Unix time [s]


class RawRecordings:
    """The folder, for one thread. OSError of all methods: the disk cannot be used; see `abandon`.

    rig_text_of  the rig file of an asset as TOML; None where there is none; it is asked with each frame
    free         bytes that are free where the folder is
    turned       called again and again by what may take long
    """

    def __init__(
        self,
        folder: Path,
        limits: RawLimits,
        *,
        rig_text_of: Callable[[str], bytes | None] = lambda asset: None,
        prefix: str = PREFIX,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], float] = time.time,
        free: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
        turned: Callable[[], None] = lambda: None,
    ) -> None:
        self.folder, self._limits, self._prefix = Path(folder), limits, prefix
        self._rig_text_of, self._clock, self._now, self._free, self._turned = rig_text_of, clock, now, free, turned
        self._writing: dict[str, _Writing] = {}  # by asset, the longest silent first
        self._complete: dict[Path, _Complete] = {}  # the oldest first
        self._bytes = 0  # of them all
        self._flushed = clock()
        self._held: int | None = None  # the folder, which no other process writes to meanwhile
        self.newest_ns = 0  # end of the newest frame that was written, Unix time [ns]
        self.deleted = 0  # files since the start

    def begin(self) -> None:
        """Looks at what is there, and completes what a killed process left behind."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._hold()
        self._complete, self._bytes = {}, 0
        for path, size, written in sorted(recordings_in(self.folder), key=lambda each: each[2]):
            self._add(path, size, written)
        for left in sorted(self.folder.glob(f"*/*{COPY}")):
            left.unlink(missing_ok=True)
        for left in sorted(self.folder.glob(f"*/*{SUFFIX}{UNFINISHED}")):
            if self._free(self.folder) - left.stat().st_size > self._limits.spare_bytes:
                self._recover(left)
        self._delete_old()

    def write(self, channel: Channel, start_ns: int, end_ns: int, payload: bytes) -> None:
        """Adds one frame, as it came, to its asset's file, or to another one where another rig file holds by now."""
        asset = channel.asset
        rig_text, begun = self._rig_text_of(asset), self._writing.get(asset)
        if begun is not None and begun.rig_text is not None and rig_text not in (None, begun.rig_text):
            self._finish(asset)
        writing = self._writing.pop(asset, None) or self._open(asset, start_ns, rig_text)
        self._writing[asset] = writing
        writing.newest = self._clock()
        writing.writer.write(channel, end_ns, payload)
        self.newest_ns = max(self.newest_ns, end_ns)
        if writing.writer.size >= self._limits.roll_bytes:
            self._finish(asset)

    def turn(self) -> None:
        """Hands what was written to the operating system, completes and deletes files, where that is due."""
        now = self._clock()
        if now - self._flushed < FLUSH_EVERY:
            return
        self._flushed = now
        for asset, writing in list(self._writing.items()):
            self._attach_rig(asset, writing)
            writing.writer.flush()
            if now - writing.begun > self._limits.roll_seconds or now - writing.newest > SILENT:
                self._finish(asset)
        self._demand_room()

    def abandon(self) -> None:
        """Closes all files as they are, since the disk cannot be used; `begin` completes them."""
        for writing in self._writing.values():
            writing.writer.abandon()
        self._writing = {}
        self._release()

    def forget(self, path: Path) -> None:
        """Notes that a complete file has been moved elsewhere."""
        known = self._complete.pop(path, None)
        self._bytes -= 0 if known is None else known.size

    def close(self) -> None:
        """Completes all files."""
        for asset in list(self._writing):
            self._finish(asset)
        self._release()

    @property
    def size(self) -> int:
        """Bytes of all files, as far as they have been handed to the operating system."""
        writing = [each.writer.size for each in list(self._writing.values())]
        return self._bytes + sum(writing)

    @property
    def files(self) -> int:
        return len(self._complete) + len(self._writing)

    def _hold(self) -> None:
        self._release()
        held = os.open(self.folder, os.O_RDONLY)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(held)
            raise OSError(errno.EBUSY, "another process records there") from None
        except OSError:  # its file system cannot lock
            pass
        self._held = held

    def _release(self) -> None:
        if self._held is not None:
            os.close(self._held)
            self._held = None

    def _open(self, asset: str, start_ns: int, rig_text: bytes | None) -> _Writing:
        while len(self._writing) >= MOST_OPEN:
            self._finish(next(iter(self._writing)))
        self._demand_room()
        folder = folder_in(self.folder, asset)
        moment = datetime.fromtimestamp(start_ns // NS, UTC).strftime("%Y%m%dT%H%M%S")
        stem = f"{asset}_{moment}.{start_ns % NS // 10**6:03d}Z"
        path, number = folder / f"{stem}{SUFFIX}", 1
        while path.exists() or path.with_name(path.name + UNFINISHED).exists():
            number += 1
            path = folder / f"{stem}_{number}{SUFFIX}"
        metadata = {"asset": asset, "description": DESCRIPTION, "started": datetime.now(UTC).isoformat()}
        part = path.with_name(path.name + UNFINISHED)
        writer = RecordingWriter(part, rig_text=rig_text, metadata=metadata, prefix=self._prefix)
        now = self._clock()
        return _Writing(writer, rig_text, now, now)

    def _finish(self, asset: str) -> None:
        self._turned()
        writing = self._writing[asset]
        self._attach_rig(asset, writing)
        writing.writer.close(sync=True)
        del self._writing[asset]
        self._note_complete(writing.writer.path, writing.writer.path.with_suffix(""))

    def _attach_rig(self, asset: str, writing: _Writing) -> None:
        """Attaches a rig file that was not known yet when the file was begun."""
        if writing.rig_text is None and (rig_text := self._rig_text_of(asset)) is not None:
            writing.writer.attach_rig(rig_text)
            writing.rig_text = rig_text

    def _note_complete(self, written: Path, path: Path) -> None:
        written.replace(path)
        about = path.stat()
        self._add(path, about.st_size, about.st_mtime)

    def _add(self, path: Path, size: int, written: float) -> None:
        self.forget(path)
        self._complete[path] = _Complete(size=size, written=written)
        self._bytes += size

    def _recover(self, left: Path) -> None:
        """Completes a file that was left behind, by what can be read of it."""
        path, copy = left.with_suffix(""), left.with_suffix(COPY)
        try:
            with (
                Recording(left, self._prefix) as recording,
                RecordingWriter(
                    copy, rig_text=recording.rig_text, metadata=recording.metadata, prefix=self._prefix
                ) as writer,
            ):
                frames = 0
                for frame in recording.messages():
                    writer.write(*frame)
                    frames += 1
                    self._turned()
                writer.close(sync=True)
        except InputError as error:
            copy.unlink(missing_ok=True)
            left.unlink(missing_ok=True)
            log.warning("%s was left behind by an earlier run and holds nothing: it is deleted (%s)", left, error)
            return
        self._note_complete(copy, path)
        left.unlink(missing_ok=True)
        log.info("%s was left behind by an earlier run: it is complete with %d frames", path, frames)

    def _delete_old(self) -> None:
        too_old = self._now() - self._limits.keep_seconds
        while self._complete:
            path = next(iter(self._complete))
            if self._complete[path].written >= too_old and self._has_room():
                return
            self.forget(path)
            path.unlink(missing_ok=True)
            self.deleted += 1
            with suppress(OSError):
                path.parent.rmdir()  # where it was the last

    def _has_room(self) -> bool:
        return self.size <= self._limits.keep_bytes and self._free(self.folder) >= self._limits.spare_bytes

    def _demand_room(self) -> None:
        """OSError where the disk has too little left for others, though everything old has been deleted."""
        self._delete_old()
        free = self._free(self.folder)
        if free < self._limits.spare_bytes:
            raise OSError(errno.ENOSPC, f"{os.strerror(errno.ENOSPC)}: {free / 1e9:.1f} GB are free")


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """What a folder of recordings holds."""

    recordings: int
    bytes: int
    unfinished: int  # being written, or left behind
    newest: str | None  # when one was written last, ISO 8601

    def __str__(self) -> str:
        newest = "" if self.newest is None else f"; the newest was written at {self.newest}"
        return f"{self.recordings} raw recordings, {self.bytes / 1e9:.3g} GB, {self.unfinished} unfinished{newest}"


def kept_in(folder: Path) -> Kept:
    """What a folder of recordings holds; the service may run."""
    complete = recordings_in(folder)
    unfinished = recordings_in(folder, f"{SUFFIX}{UNFINISHED}")
    newest = max((written for *_, written in (*complete, *unfinished)), default=None)
    return Kept(
        recordings=len(complete),
        bytes=sum(size for _, size, _ in (*complete, *unfinished)),
        unfinished=len(unfinished),
        newest=None if newest is None else datetime.fromtimestamp(newest, UTC).isoformat(timespec="seconds"),
    )


def recordings_in(folder: Path, suffix: str = SUFFIX) -> list[tuple[Path, int, float]]:
    """The recordings of a folder, each with its size and when it was written, Unix time [s]."""
    found = []
    for path in folder.glob(f"*/*{suffix}"):
        with suppress(FileNotFoundError):
            about = path.stat()
            found.append((path, about.st_size, about.st_mtime))
    return sorted(found)
