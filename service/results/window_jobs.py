"""Jobs that are windows: each a file that waits for its turn, and a row that names it.

The row is written with where the asset's stream goes on, and deleted by the transaction that processes the window, so
that a kill loses no window and counts none twice. Where the window's signals are kept, the same transaction names the
file in the window's row (kept_signals.py); else the file is deleted after it.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, bindparam, delete, select, union_all, update

from service.contract.base import iso_time
from service.errors import StoreError
from service.results.commit_marks import probe
from service.results.jobs import WINDOW
from service.results.json_columns import dump, salvage
from service.results.schema import ASSETS, JOBS, WINDOWS
from service.results.segment_file import SUFFIX, sync_folder, write_segment
from service.results.store import Tables
from service.steady_clock import later_time_ns
from service.stream.segment import Segment

log = logging.getLogger(__name__)

WAITING_WINDOWS = 1000  # of one asset that are kept until its question is answered ...
WAITING_BYTES = 2**30  # ... and what they may take on disk
PROBE_BYTES = 4096  # of a file that says whether the disk can be written

_IS = JOBS.c.kind == WINDOW
_OF = JOBS.c.asset == bindparam("of")
_ALL_WAITING = select(*(JOBS.c[n] for n in ("asset", "id", "start_ns", "bytes", "file"))).where(_IS).order_by(JOBS.c.id)
_WAITING = _ALL_WAITING.where(_OF)
_END_WAITING = (
    delete(JOBS)
    .where(JOBS.c.id == bindparam("number"))
    .returning(*(JOBS.c[n] for n in ("id", "start_ns", "bytes", "file")))
)
_END_WAITING_FROM = delete(JOBS).where(_IS, _OF, JOBS.c.id >= bindparam("number"))
_BEFORE = select(JOBS.c.given).where(JOBS.c.id == bindparam("number"))
_GO_ON_FROM = update(ASSETS).where(ASSETS.c.asset == bindparam("of"))


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitingWindow:
    """One window that waits for its turn."""

    id: int
    start_ns: int
    bytes: int
    file: str  # its name


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """The file of a window that nothing names yet."""

    path: Path
    start_ns: int
    bytes: int


class WindowJobs:
    """The windows of all assets that wait: in the results' database and the folder of segments."""

    def __init__(self, database: Tables, folder: Path | None = None) -> None:
        """folder  of segments; None where no window ever waits"""
        self._database, self.folder = database, folder
        if folder is None:
            return
        try:
            folder.mkdir(parents=True, exist_ok=True)
            wait = select(JOBS.c.file).where(_IS, database.own(JOBS.c.asset))
            kept = select(WINDOWS.c.segment).where(WINDOWS.c.segment.is_not(None), database.own(WINDOWS.c.asset))
            named = {row[0] for row in database.rows(union_all(wait, kept))}
            for path in folder.iterdir():
                if path.name not in named:
                    path.unlink(missing_ok=True)  # of a window that was never committed, or has been given up
        except OSError as error:
            raise StoreError(f"{folder} cannot hold the segments of windows: {error.strerror or error}") from error

    def transaction(self) -> AbstractContextManager[Connection]:
        """A transaction of the database, which other stores in it share."""
        return self._database.transaction()

    def write(self, segment: Segment) -> Written:
        """Makes the frames of a window that is to wait durable, before the transaction, which others wait for.

        No two files have one name, also where another process has had the folder before.
        """
        assert self.folder is not None
        path = self.folder / f"{segment.start_ns}_{secrets.token_hex(8)}{SUFFIX}"
        size = write_segment(path, segment)
        try:
            sync_folder(self.folder)
        except BaseException:
            delete_file(path)
            raise
        return Written(path=path, start_ns=segment.start_ns, bytes=size)

    def add_waiting(
        self,
        asset: str,
        written: Written,
        beside: Sequence[WaitingWindow] | None = None,
        before: Mapping[str, Any] | None = None,
    ) -> WaitingWindow | None:
        """Keeps a window until its turn comes; None where there is no room.

        beside  the windows of the asset that wait already, where the caller has just read them
        before  where the asset's stream went on before it; empty before its first window
        """
        waiting = self.waiting(asset) if beside is None else beside
        if len(waiting) >= WAITING_WINDOWS or sum(w.bytes for w in waiting) >= WAITING_BYTES:
            return None
        start_ns, size, name = written.start_ns, written.bytes, written.path.name
        with self.transaction() as db:
            self._database.ensure(db, asset)
            row = {"asset": asset, "start_ns": start_ns, "bytes": size, "file": name, "given": dump(before)}
            number = self._database.add(db, JOBS, row | {"kind": WINDOW, "received_ns": later_time_ns()})
        return WaitingWindow(id=number, start_ns=start_ns, bytes=size, file=name)

    def probe(self) -> None:
        """Writes to the folder and to the database, as a window is written; StoreError or OSError where that fails."""
        assert self.folder is not None
        path = self.folder / secrets.token_hex(8)
        try:
            path.write_bytes(bytes(PROBE_BYTES))
        finally:
            path.unlink(missing_ok=True)
        probe(self._database)

    def step_back(self) -> None:
        """Has each asset go on before the first of its windows that wait without their file, so that they come again.

        A database that was put back names windows that have been processed since, and whose files went with that.
        """
        assert self.folder is not None
        files = {path.name for path in self.folder.iterdir()}
        for asset, waiting in self.all_waiting().items():
            gone = next((w for w in waiting if w.file not in files), None)
            if gone is None:
                continue
            with self.transaction() as db:
                ((kept,),) = db.execute(_BEFORE, {"number": gone.id}).all()
                before = salvage(kept, f"where {asset} went on before the window of {iso_time(gone.start_ns)}")
                if before is None:
                    continue
                db.execute(_GO_ON_FROM.values(assembly=dump(before or None)), {"of": asset})
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
        rows = self._database.rows(_WAITING, {"of": asset})
        return tuple(WaitingWindow(id=i, start_ns=start, bytes=size, file=file) for _, i, start, size, file in rows)

    def all_waiting(self) -> dict[str, tuple[WaitingWindow, ...]]:
        """The windows of all assets that wait, by asset."""
        waiting: dict[str, tuple[WaitingWindow, ...]] = {}
        for asset, number, start, size, file in self._database.rows(
            _ALL_WAITING.where(self._database.own(JOBS.c.asset))
        ):
            kept = WaitingWindow(id=number, start_ns=start, bytes=size, file=file)
            waiting[asset] = (*waiting.get(asset, ()), kept)
        return waiting

    def drop_waiting(self, number: int) -> WaitingWindow | None:
        """Ends the wait of a window that is processed by the present transaction; None where it has ended before."""
        with self.transaction() as db:
            row = db.execute(_END_WAITING, {"number": number}).one_or_none()
        return None if row is None else WaitingWindow(**row._mapping)

    def path_of(self, window: WaitingWindow) -> Path:
        """The file of a window that waits."""
        assert self.folder is not None
        return self.folder / window.file

    def give_waiting(self, asset: str, other: str) -> None:
        """The windows that wait are another asset's."""
        with self.transaction() as db:
            self._database.ensure(db, other)
            db.execute(update(JOBS).where(_IS, JOBS.c.asset == asset).values(asset=other))


def delete_file(path: Path | None) -> None:
    """Deletes the file of a window that no row names; one that cannot be deleted now is by the next start."""
    if path is not None:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s cannot be deleted: %s", path, error.strerror or error)
