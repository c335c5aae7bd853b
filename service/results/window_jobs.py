"""Jobs that are windows: each a file that waits for its turn, and a row that names it.

The row is written with where the asset's stream goes on, and deleted by the transaction that processes the window, so
that a kill loses no window and counts none twice.
"""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, bindparam, delete, select, update

from service.contract.base import iso_time
from service.errors import StoreError
from service.results.commit_marks import probe
from service.results.jobs import WINDOW
from service.results.json_columns import dump, salvage
from service.results.schema import ASSETS, JOBS
from service.results.store import Tables
from service.results.window_file import SUFFIX, UNFINISHED, sync_folder, write_window
from service.steady_clock import later_time_ns
from twin.windows import Window

log = logging.getLogger(__name__)

WAITING_WINDOWS = 1000  # of one asset that are kept until its question is answered ...
WAITING_BYTES = 2**30  # ... and what they may take on disk
PROBE_BYTES = 4096  # of a file that says whether the disk can be written

_IS = JOBS.c.kind == WINDOW
_OF = JOBS.c.asset == bindparam("of")
_ALL_WAITING = select(*(JOBS.c[n] for n in ("asset", "id", "start_ns", "bytes"))).where(_IS).order_by(JOBS.c.id)
_WAITING = _ALL_WAITING.where(_OF)
_END_WAITING = delete(JOBS).where(JOBS.c.id == bindparam("number"))
_END_WAITING_FROM = delete(JOBS).where(_IS, _OF, JOBS.c.id >= bindparam("number"))
_BEFORE = select(JOBS.c.given).where(JOBS.c.id == bindparam("number"))
_GO_ON_FROM = update(ASSETS).where(ASSETS.c.asset == bindparam("of"))


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitingWindow:
    """One window that waits for its turn."""

    id: int
    start_ns: int
    bytes: int


class WindowJobs:
    """The windows of all assets that wait: in the results' database and a folder."""

    def __init__(self, database: Tables, folder: Path | None = None) -> None:
        """folder  of the windows that wait; None where no window ever does"""
        self._database, self.folder = database, folder
        if folder is None:
            return
        try:
            folder.mkdir(parents=True, exist_ok=True)
            known = {row[0] for row in database.rows(select(JOBS.c.id).where(_IS))}
            for path in folder.iterdir():
                if path.suffix != SUFFIX or not path.stem.isdigit() or int(path.stem) not in known:
                    path.unlink(missing_ok=True)  # of a window that has been processed, or was never committed
        except OSError as error:
            raise StoreError(f"{folder} cannot hold windows that wait: {error.strerror or error}") from error

    def transaction(self) -> AbstractContextManager[Connection]:
        """A transaction of the database, which other stores in it share."""
        return self._database.transaction()

    def write(self, window: Window) -> int:
        """Writes a window that is to wait, before the transaction, which others wait for; its size in bytes."""
        return write_window(self._unnumbered(), window)

    def add_waiting(
        self,
        asset: str,
        window: Window,
        beside: Sequence[WaitingWindow] | None = None,
        size: int | None = None,
        before: Mapping[str, Any] | None = None,
    ) -> WaitingWindow | None:
        """Keeps a window until its turn comes; None where there is no room. Its file is durable once `sync` returns.

        beside  the windows of the asset that wait already, where the caller has just read them
        size    what `write` answered, where the caller has written it before its transaction
        before  where the asset's stream went on before it; empty before its first window
        """
        waiting = self.waiting(asset) if beside is None else beside
        if len(waiting) >= WAITING_WINDOWS or sum(w.bytes for w in waiting) >= WAITING_BYTES:
            return None
        size = self.write(window) if size is None else size
        with self.transaction() as db:
            self._database.ensure(db, asset)
            row = {"asset": asset, "start_ns": window.start_time_ns, "bytes": size, "given": dump(before)}
            row |= {"kind": WINDOW, "received_ns": later_time_ns()}
            number = self._database.add(db, JOBS, row)
            self._unnumbered().replace(self._path(number))
        return WaitingWindow(id=number, start_ns=window.start_time_ns, bytes=size)

    def probe(self) -> None:
        """Writes to the folder and to the database, as a window is written; StoreError or OSError where that fails."""
        path = self._unnumbered().with_suffix(UNFINISHED)
        try:
            path.write_bytes(bytes(PROBE_BYTES))
        finally:
            path.unlink(missing_ok=True)
        probe(self._database)

    def sync(self) -> None:
        """Makes the names of the files of windows durable, after the transaction, which others wait for.

        Until then nothing is acknowledged: a row whose file has lost its name in a power cut is one to step back from.
        """
        assert self.folder is not None
        sync_folder(self.folder)

    def step_back(self) -> None:
        """Has each asset go on before the first of its windows that wait without their file, so that they come again.

        A database that was put back names windows that have been processed since, and whose files went with that.
        """
        assert self.folder is not None
        files = {path.name for path in self.folder.iterdir()}
        for asset, waiting in self.all_waiting().items():
            gone = next((w for w in waiting if self._path(w.id).name not in files), None)
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
        return tuple(WaitingWindow(id=i, start_ns=start, bytes=size) for _, i, start, size in rows)

    def all_waiting(self) -> dict[str, tuple[WaitingWindow, ...]]:
        """The windows of all assets that wait, by asset."""
        waiting: dict[str, tuple[WaitingWindow, ...]] = {}
        for asset, number, start, size in self._database.rows(_ALL_WAITING):
            waiting[asset] = (*waiting.get(asset, ()), WaitingWindow(id=number, start_ns=start, bytes=size))
        return waiting

    def drop_waiting(self, number: int) -> None:
        """Ends the wait of a window that is processed by the present transaction."""
        with self.transaction() as db:
            db.execute(_END_WAITING, {"number": number})

    def file_of(self, number: int) -> Path:
        """The file of a window that waits."""
        return self._path(number)

    def delete_file(self, number: int) -> None:
        """Deletes the file of a window whose wait has ended, after the transaction."""
        self._path(number).unlink(missing_ok=True)

    def forget_waiting(self, number: int) -> None:
        """Leaves out a window that waits, with its file."""
        self.drop_waiting(number)
        with suppress(OSError):  # the next start deletes it
            self.delete_file(number)

    def give_waiting(self, asset: str, other: str) -> None:
        """The windows that wait are another asset's."""
        with self.transaction() as db:
            self._database.ensure(db, other)
            db.execute(update(JOBS).where(_IS, JOBS.c.asset == asset).values(asset=other))

    def _unnumbered(self) -> Path:
        assert self.folder is not None
        return self.folder / temporary_name(os.getpid())

    def _path(self, number: int) -> Path:
        assert self.folder is not None
        return self.folder / f"{number:08d}{SUFFIX}"


def temporary_name(process: int) -> str:
    """The file in which a process of this host writes a window that has no number yet.

    No other process writes into it, such as one that was suspended and had the folder before.
    """
    return f"new-{socket.gethostname()}-{process}".replace(".", "-")
