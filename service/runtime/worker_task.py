"""What a worker process does: one turn after the other, with what it has loaded before at hand.

It reads what it works on from the database, and commits what that leads to. What is logged meanwhile goes back with the
answer: the service's log has it in its own form, and no lock is shared with a process that may be killed.
"""

from __future__ import annotations

import logging
import os
import pickle
import signal
import threading
from dataclasses import dataclass
from multiprocessing import connection, parent_process
from typing import Any

from service.errors import StoreError
from service.logs import carry
from service.runtime.computing import Turn, Turned
from service.runtime.curves import CurvePlace, Curves, WorkerCurves
from service.runtime.work import Work
from service.runtime.worker_server import end_with_server

NICENESS = 10  # of a worker: frames are received and requests are answered before windows are computed
MOST_RECORDS = 200  # log records that one turn sends back


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A turn as it is sent to a worker.

    curves  where wear curves are kept, for those that this worker has not computed; None where they are nowhere
    """

    place: bytes  # a pickled `Workplace`
    turn: Turn
    curves: CurvePlace | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """What a worker sends back.

    curves  the asset's wear curves, where there are new ones and they are kept
    """

    turned: Turned
    records: tuple[logging.LogRecord, ...]
    curves: Curves | None = None


class _Records(logging.Handler):
    """Keeps what is logged until it is taken."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: list[logging.LogRecord] = []

    def emit(self, record: logging.LogRecord) -> None:
        if len(self.kept) < MOST_RECORDS:
            carry(record)
            self.kept.append(record)

    def take(self) -> tuple[logging.LogRecord, ...]:
        taken, self.kept = tuple(self.kept), []
        return taken


_works: dict[bytes, Work] = {}
_records, _curves = _Records(), WorkerCurves()
_begun: Any = None


def begin(log_level: int, cache_bytes: int, begun: Any) -> None:
    """Prepares a worker: it ends with the service, and not by signals that are meant for that.

    begun  a number in shared memory: the row that it is at
    """
    global _begun
    _begun = begun
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    end_with_server()
    prepare(log_level, cache_bytes)


def prepare(log_level: int, cache_bytes: int) -> None:
    """Lets this process carry out tasks and do nothing else."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    root = logging.getLogger()
    root.handlers[:] = [_records]
    root.setLevel(log_level)
    logging.captureWarnings(True)
    from twin.updating.model_cache import PATHS  # loads the twin, which the service's own process does without

    PATHS.budget = cache_bytes


def _end_with_parent() -> None:
    """Ends the process at once when the service has ended, however that was."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _note_begun(row: int) -> None:
    _begun.value = row


def perform(task: Task) -> Reply:
    """Carries a turn out."""
    asset, curves = task.turn.asset, None
    if task.place not in _works:
        try:
            _works[task.place] = pickle.loads(task.place).work(_note_begun)
        except (StoreError, OSError) as error:
            unstored = Turned(asset=asset, job=task.turn.tried, unstored=error)
            return Reply(turned=unstored, records=_records.take())
    work = _works[task.place]
    with _curves.read_from(task.curves, asset):
        turned = work.turn(task.turn)
    if task.curves is not None and turned.index >= 0:
        curves = _curves.new_of(asset, work.curves(asset))
    return Reply(turned=turned, records=_records.take(), curves=curves)
