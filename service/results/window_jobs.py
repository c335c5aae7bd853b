"""Jobs that are windows: each a file that waits for its turn, and a row that names it.

The row is written with where the asset's stream goes on, and deleted by the transaction that processes the window, so
that a kill loses no window and counts none twice. Where the window's signals are kept, the same transaction names the
file in the window's row (kept_signals.py); else the file is deleted after it.
"""

from __future__ import annotations

import logging
import os
import secrets
import time
from collections.abc import Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, bindparam, delete, func, select, union_all, update

from service.contract.base import iso_time
from service.errors import StorageUnavailable, StoreError
from service.results.jobs import NOTICE, STALE
from service.results.json_columns import dump, salvage
from service.results.schema import ASSETS, FOLDERS, JOBS, WINDOW, WINDOWS
from service.results.segment_file import SUFFIX, sync_folder, write_segment
from service.results.store import Tables
from service.steady_clock import later_time_ns
from service.stream.segment import Segment

log = logging.getLogger(__name__)

KNOWN_BY = ".folder"  # the file of a folder of segments that holds its id
WRITTEN_WITHIN = 1.0  # whoever else makes that file, unless it was killed [s]
PROBE_BYTES = 4096  # of a file that says whether the disk can be written

_IS = JOBS.c.kind == WINDOW
_OF = JOBS.c.asset == bindparam("of")
_NAMES = ("id", "asset", "start_ns", "received_ns", "bytes", "file", "held", "again", "refuse", "tries", "fault")
_ALL_WAITING = select(*(JOBS.c[n] for n in _NAMES)).where(_IS).order_by(JOBS.c.id)
_WAITING = _ALL_WAITING.where(_OF)
_NEXT = _WAITING.where(JOBS.c.held == 0).limit(1)
_HELD = select(func.count()).where(_IS, _OF, JOBS.c.held == 1)
_IS_THIS = (JOBS.c.id == bindparam("number"), _IS, JOBS.c.received_ns == bindparam("received"))
_END_WAITING = delete(JOBS).where(*_IS_THIS).returning(*(JOBS.c[n] for n in _NAMES))
_END_WAITING_FROM = delete(JOBS).where(_IS, _OF, JOBS.c.id >= bindparam("number"))
_NO_LONGER = delete(JOBS).where(_OF, JOBS.c.kind == NOTICE, JOBS.c.verb == STALE)
_THIS = update(JOBS).where(JOBS.c.id == bindparam("number"))
_HOLD = update(JOBS).where(*_IS_THIS).values(held=1)
_RELEASE = update(JOBS).where(_IS, _OF, JOBS.c.held == 1)
_BEFORE = select(JOBS.c.given).where(JOBS.c.id == bindparam("number"))
_GO_ON_FROM = update(ASSETS).where(ASSETS.c.asset == bindparam("of"))
_COUNTED = (
    *(func.count(), func.count(JOBS.c.file), func.sum(JOBS.c.bytes)),
    *(func.min(JOBS.c.received_ns), func.max(JOBS.c.received_ns)),
)
_COUNTS = select(JOBS.c.asset, JOBS.c.held, *_COUNTED).where(_IS).group_by(JOBS.c.asset, JOBS.c.held)


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitingWindow:
    """One window that waits for its turn."""

    id: int
    asset: str
    start_ns: int
    received_ns: int  # when it was made durable, Unix time [ns]
    bytes: int
    file: str | None  # its name; None where it is left out
    held: bool = False  # whether it waits for an answer by people ...
    again: bool = False  # ... or has done so before
    refuse: str | None = None  # why it is not to be used; None where it is
    tries: int = 0  # how often it has ended whoever carried it out ...
    fault: str | None = None  # ... and how the last time


@dataclass(frozen=True, slots=True, kw_only=True)
class Backlog:
    """The windows of one asset that wait."""

    windows: int = 0  # to be processed
    held: int = 0  # for an answer by people
    bytes: int = 0  # of all of them, on disk
    left_out: int = 0  # of both, those without their frames
    since_ns: int | None = None  # when the oldest was made durable that is to be processed; None where none is
    newest_ns: int = 0  # when the newest of all was

    @property
    def all_windows(self) -> int:
        """How many wait with their frames."""
        return self.windows + self.held - self.left_out

    @property
    def lag(self) -> float:
        """How long the oldest that is to be processed has waited; 0 where none is [s]."""
        return 0.0 if self.since_ns is None else max(later_time_ns() - self.since_ns, 0) * 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """The file of a window that nothing names yet.

    name  by which rows are to name it
    """

    path: Path
    name: str
    start_ns: int
    bytes: int


class WindowJobs:
    """The windows of all assets that wait: in the results' database and the folder of segments."""

    def __init__(self, database: Tables, folder: Path | None = None, *, sweeps: bool = True) -> None:
        """folder  of segments; None where no window ever waits. Those of a fleet's share are in one of their own in it
        sweeps  whether files that no row names are deleted now
        """
        self.database, self.folder = database, folder
        self._within = "" if database.share is None else f"{database.share:03d}/"  # how names of files begin here
        if folder is None or not sweeps:
            return
        self.demand_folder()
        try:
            (folder / self._within).mkdir(parents=True, exist_ok=True)
            wait = select(JOBS.c.file).where(_IS, database.own(JOBS.c.asset))
            kept = select(WINDOWS.c.segment).where(WINDOWS.c.segment.is_not(None), database.own(WINDOWS.c.asset))
            named = {row[0] for row in database.rows(union_all(wait, kept))}
            for name in self._files() - named:
                (folder / name).unlink(missing_ok=True)  # of a window that was never committed, or has been given up
        except OSError as error:
            raise StoreError(f"{folder} cannot hold the segments of windows: {error.strerror or error}") from error

    def demand_folder(self) -> None:
        """Makes sure that the folder is the one of which the database knows; the first that is used becomes it.

        Raises StorageUnavailable where it is another one, as that of a disk that is not mounted: no file of a window
        is missing then. Raises StoreError where it cannot be used at all.
        """
        assert self.folder is not None
        file, known = self.folder / KNOWN_BY, self.database.rows(select(FOLDERS.c.id))
        try:
            if not known:
                self.folder.mkdir(parents=True, exist_ok=True)
                row = {"one": 1, "id": _id_of_new(file)}
                with self.transaction() as db:
                    db.execute(self.database.insert(FOLDERS).on_conflict_do_nothing(), row)
                known = self.database.rows(select(FOLDERS.c.id))
            with suppress(FileNotFoundError):
                if file.read_text(encoding="utf-8") == known[0][0]:
                    return
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise StoreError(f"{self.folder} cannot hold the segments of windows: {why}") from error
        raise StorageUnavailable(
            f"{self.folder} is not the folder that holds the windows of this database: is its disk mounted, and the "
            f"setting data that of before? Where those files are lost for good, a file {KNOWN_BY} in it with the text "
            f"{known[0][0]} makes it that folder",
            reason="input or output",
        )

    def transaction(self) -> AbstractContextManager[Connection]:
        """A transaction of the database, which other stores in it share."""
        return self.database.transaction()

    def write(self, segment: Segment) -> Written:
        """Makes the frames of a window that is to wait durable, before the transaction, which others wait for.

        No two files have one name, also where another process has had the folder before.
        """
        assert self.folder is not None
        path = self.folder / self._within / f"{segment.start_ns}_{secrets.token_hex(8)}{SUFFIX}"
        size = write_segment(path, segment)
        try:
            sync_folder(path.parent)
        except BaseException:
            delete_file(path)
            raise
        return Written(path=path, name=self._within + path.name, start_ns=segment.start_ns, bytes=size)

    def add_waiting(self, asset: str, written: Written, before: Mapping[str, Any] | None = None) -> WaitingWindow:
        """Adds a window's job, and drops the notice that none has come of the asset for long.

        before  where the asset's stream went on before it; empty before its first window
        """
        now, name = later_time_ns(), written.name
        with self.transaction() as db:
            self.database.update_due(db, asset)
            db.execute(_NO_LONGER, {"of": asset})
            row = {"asset": asset, "start_ns": written.start_ns, "bytes": written.bytes, "file": name}
            row |= {"given": dump(before), "kind": WINDOW, "received_ns": now}
            number = self.database.add(db, JOBS, row)
        return WaitingWindow(
            id=number, asset=asset, start_ns=written.start_ns, received_ns=now, bytes=written.bytes, file=name
        )

    def leave_out(self, window: WaitingWindow, reason: str) -> None:
        """A window that waits becomes a refused record in its turn; its file is deleted once that is committed."""
        with self.transaction() as db:
            self.database.update_due(db, window.asset)
            left_out = _THIS.values(refuse=reason, file=None, bytes=0, given=None, held=0, again=JOBS.c.held)
            db.execute(left_out, {"number": window.id})
        delete_file(self.path_of(window))

    def hold(self, window: WaitingWindow) -> bool:
        """A window waits for an answer by people from now on; False where it does not wait any more."""
        with self.transaction() as db:
            self.database.update_due(db, window.asset)
            return bool(db.execute(_HOLD, _key(window)).rowcount)

    def release(self, asset: str, refuse: str | None = None) -> None:
        """The windows that waited for an answer go on; or are refused, for a reason."""
        with self.transaction() as db:
            self.database.update_due(db, asset)
            values = {"held": 0, "again": 1} | ({} if refuse is None else {"refuse": refuse})
            db.execute(_RELEASE.values(values), {"of": asset})

    def probe(self) -> None:
        """Writes to the folder, as a window is written; OSError where that fails."""
        assert self.folder is not None
        path = self.folder / self._within / secrets.token_hex(8)
        try:
            path.write_bytes(bytes(PROBE_BYTES))
        finally:
            path.unlink(missing_ok=True)

    def step_back(self) -> None:
        """Has each asset go on before the first of its windows that wait without their file, so that they come again.

        A database that was put back names windows that have been processed since, and whose files went with that.
        """
        files = self._files()
        for asset, waiting in self.all_waiting().items():
            gone = next((w for w in waiting if w.file is not None and w.file not in files), None)
            if gone is None:
                continue
            with self.transaction() as db:
                ((kept,),) = db.execute(_BEFORE, {"number": gone.id}).all()
                before = salvage(kept, f"where {asset} went on before the window of {iso_time(gone.start_ns)}")
                if before is None:
                    continue
                db.execute(_GO_ON_FROM.values(assembly=dump(before or None)), {"of": asset})
                self.database.update_due(db, asset)
                ended = db.execute(_END_WAITING_FROM, {"of": asset, "number": gone.id}).rowcount
            log.warning(
                "%s: the database is older than the files of its windows: from %s on, %d windows that had been "
                "received are not stored, and are stored when they are sent again",
                asset,
                iso_time(gone.start_ns),
                ended,
                extra={"asset": asset},
            )

    def waiting(self, asset: str) -> tuple[WaitingWindow, ...]:
        """The windows of an asset that wait, in the order in which they came."""
        return tuple(map(_window, self.database.rows(_WAITING, {"of": asset})))

    def next(self, asset: str) -> WaitingWindow | None:
        """The window of an asset whose turn it is."""
        return next(map(_window, self.database.rows(_NEXT, {"of": asset})), None)

    def held(self, asset: str) -> int:
        """How many windows of an asset wait for an answer by people."""
        return self.database.rows(_HELD, {"of": asset})[0][0]

    def backlogs(self) -> dict[str, Backlog]:
        """What waits, by asset."""
        found: dict[str, Backlog] = {}
        own = self.database.own(JOBS.c.asset)
        for asset, held, windows, files, size, since_ns, newest_ns in self.database.rows(_COUNTS.where(own)):
            known = found.get(asset, Backlog())
            counted = {"held": windows} if held else {"windows": windows, "since_ns": since_ns}
            counted |= {"left_out": known.left_out + windows - files, "newest_ns": max(known.newest_ns, newest_ns)}
            found[asset] = replace(known, bytes=known.bytes + int(size or 0), **counted)
        return found

    def all_waiting(self) -> dict[str, tuple[WaitingWindow, ...]]:
        """The windows of all assets that wait, by asset."""
        waiting: dict[str, tuple[WaitingWindow, ...]] = {}
        for kept in map(_window, self.database.rows(_ALL_WAITING.where(self.database.own(JOBS.c.asset)))):
            waiting[kept.asset] = (*waiting.get(kept.asset, ()), kept)
        return waiting

    def drop_waiting(self, window: WaitingWindow) -> WaitingWindow | None:
        """Ends the wait of a window that is processed by the present transaction; None where it has ended before."""
        with self.transaction() as db:
            row = db.execute(_END_WAITING, _key(window)).one_or_none()
            if row is None:
                return None
            self.database.update_due(db, row.asset)
        return _window(row)

    def path_of(self, window: WaitingWindow) -> Path | None:
        """The file of a window that waits; None where it is left out."""
        assert self.folder is not None
        return None if window.file is None else self.folder / window.file

    def _files(self) -> set[str]:
        """The names of all files here."""
        assert self.folder is not None
        files = (path for path in (self.folder / self._within).iterdir() if path.is_file())
        return {self._within + path.name for path in files if path.name != KNOWN_BY}

    def give_waiting(self, asset: str, other: str) -> None:
        """The windows that wait are another asset's."""
        with self.transaction() as db:
            self.database.update_due(db, asset, other)
            db.execute(update(JOBS).where(_IS, JOBS.c.asset == asset).values(asset=other))


def _id_of_new(file: Path) -> str:
    """The id of a folder, made where it has none yet; whoever else makes one at the same time finds the same."""
    made = secrets.token_hex(16)
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(made)
            new.flush()
            os.fsync(new.fileno())
    except FileExistsError:
        until = time.monotonic() + WRITTEN_WITHIN
        while not (found := file.read_text(encoding="utf-8")):
            if time.monotonic() > until:
                file.write_text(made, encoding="utf-8")
            time.sleep(0.01)
        return found
    sync_folder(file.parent)
    return made


def _key(window: WaitingWindow) -> dict[str, int]:
    """By what a row is known: a database that was put back may number another one so."""
    return {"number": window.id, "received": window.received_ns}


def _window(row: Any) -> WaitingWindow:
    named = dict(zip(_NAMES, row, strict=True))
    return WaitingWindow(**named | {name: bool(named[name]) for name in ("held", "again")})


def delete_file(path: Path | None) -> None:
    """Deletes the file of a window that no row names; one that cannot be deleted now is by the next start."""
    if path is not None:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s cannot be deleted: %s", path, error.strerror or error)
