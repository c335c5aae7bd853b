"""The role `work` as a process: it loads the twin once, and forks those who compute.

It has one thread and no connection of its own, so that it can fork at any time; it does so once who receives frames has
opened the results. It sees which job each worker is at, by
memory that both share; replaces those that end, are suspended or take too long; and has the new one say in the table of
jobs which job that was. It says to its supervisor how they are, and passes on what they log.
"""

from __future__ import annotations

import ctypes
import logging
import os
import select
import signal
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.sharedctypes import RawArray, RawValue
from pathlib import Path
from typing import Any

from service.errors import SteppedBack, StoreError
from service.logs import carry
from service.long_lived import long_lived
from service.results.jobs import Jobs
from service.runtime.curves import CurveStore, WorkerCurves
from service.runtime.ingested import ingested
from service.runtime.role_process import Context, ProcessContext, ends_with, say
from service.runtime.work import Workplace
from service.runtime.work_loop import FIRST_PAUSE, WorkLoop

log = logging.getLogger(__name__)

NICENESS = 10  # of a worker: frames are received and requests are answered before windows are computed
TURN = 0.5  # [s]
SUSPENDED = 10.0  # after which a suspended worker is ended, and another takes its place [s]
LOOK_EVERY = 1.0  # whether one is suspended: each look reads a file of the system [s]
OUT_OF_MEMORY = 71  # exit status: EX_OSERR
PAUSES = (0.05, 60.0)  # shortest and longest before a worker is started that ended before it had done anything [s]
LONGEST_NAME = 1024  # of an asset [bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkGiven:
    """What the role is given.

    place   where it finds what it works on
    count   of the workers
    curves  where wear curves are kept, for those that a worker has not computed; None where they are nowhere
    name    of this process's host, where there are several
    waits   whether the results are opened only once who receives frames has opened them
    """

    place: Workplace
    count: int
    curves: CurveStore | None = None
    name: str = ""
    waits: bool = True


@dataclass(slots=True)
class _Worker:
    """One worker, and what it shares with this process."""

    number: int
    process: int | None = None
    row: Any = field(default_factory=lambda: RawValue(ctypes.c_longlong, 0))  # of the job that it is at
    since: Any = field(
        default_factory=lambda: RawValue(ctypes.c_double, 0.0)
    )  # monotonic [s]; 0 while it takes no time
    done: Any = field(default_factory=lambda: RawValue(ctypes.c_longlong, 0))  # jobs that it has done
    asset: Any = field(default_factory=lambda: RawArray(ctypes.c_char, LONGEST_NAME))
    stuck: Any = field(default_factory=lambda: RawArray(ctypes.c_char, LONGEST_NAME))  # why it can commit nothing
    back: Any = field(default_factory=lambda: RawValue(ctypes.c_bool, False))  # whether the database had stepped back
    failed: list[tuple[int, str]] = field(default_factory=list)  # jobs that have ended it, and how: yet to be said
    said: Any = field(default_factory=lambda: RawValue(ctypes.c_longlong, 0))  # how many of those have been
    late: bool = False  # whether it has been ended because its job took too long
    still_since: float | None = None  # when it was first seen to be suspended [s]
    start_at: float = 0.0  # [s]
    pause: float = PAUSES[0]


class WorkRole:
    """The workers of this process."""

    def __init__(self, given: WorkGiven, context: ProcessContext) -> None:
        self._given, self._context = given, context
        self._workers = [_Worker(number) for number in range(given.count)]
        self._deaths = self._in_a_row = 0
        self._unstarted = ""  # why no worker can be started
        self._looked = 0.0
        self._said: Mapping[str, Any] = {}

    def run(self) -> None:
        """Works until `stop` is set."""
        woken, waking = os.pipe()
        os.set_blocking(waking, False)
        os.set_blocking(woken, False)
        signal.set_wakeup_fd(waking, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        try:
            while not self._context.stop.is_set():
                self._context.beat()
                self._context.take()
                if self._may_begin():
                    self._start()
                select.select([woken, self._context.channel.fileno()], [], [], self._pause())
                with suppress(BlockingIOError):
                    os.read(woken, 4096)
                self._reap()
                self._look()
                self._say()
        finally:
            for worker in self._workers:
                _kill(worker)

    def _start(self) -> None:
        """Starts the workers that are not there."""
        for worker in self._workers:
            if worker.process is None and time.monotonic() >= worker.start_at:
                del worker.failed[: worker.said.value]
                worker.row.value = worker.said.value = 0
                worker.since.value, worker.late, worker.still_since, worker.asset.value = 0.0, False, None, b""
                if not worker.back.value:
                    worker.stuck.value = b""
                parent = os.getpid()
                try:
                    process = os.fork()
                except OSError as error:
                    self._unstarted = f"{type(error).__name__}: {error}"
                    self._later(worker)
                    log.error("a worker process cannot be started now: %s", self._unstarted)
                    continue
                if process == 0:
                    _become(worker, self._given, parent)
                worker.process, self._unstarted = process, ""

    def _may_begin(self) -> bool:
        return not self._given.waits or ingested(self._context.others).begun

    def _pause(self) -> float:
        """How long nothing is to be done unless something happens [s]."""
        due = [worker.start_at - time.monotonic() for worker in self._workers if worker.process is None]
        return max(min([TURN, *due]), 0.0) if self._may_begin() else TURN

    def _later(self, worker: _Worker) -> None:
        worker.start_at, worker.pause = time.monotonic() + worker.pause, min(2 * worker.pause, PAUSES[1])

    def _reap(self) -> None:
        """Takes note of workers that have ended."""
        for worker in self._workers:
            if worker.process is None:
                continue
            found, status = os.waitpid(worker.process, os.WNOHANG)
            if found:
                self._died(worker, os.waitstatus_to_exitcode(status))

    def _died(self, worker: _Worker, status: int) -> None:
        worker.process = None
        self._deaths += 1
        self._in_a_row += 1
        done, row = worker.done.value, worker.row.value
        if done:
            self._in_a_row, worker.pause = 1, PAUSES[0]
        worker.done.value = 0
        if row == 0:
            self._later(worker)
            log.error("a worker process has ended before it had begun anything (status %d)", status)
            return
        limit = self._given.place.settings.task_limit
        why = "ended its worker process" if not worker.late else f"took longer than {limit:g} s"
        asset = worker.asset.value.decode()
        if status == OUT_OF_MEMORY:
            why = "had too little memory"  # and has said so
        else:
            worker.failed.append((row, why))
        log.error("%s: what was to be done next %s", asset, why, extra={"asset": asset})

    def _look(self) -> None:
        """Ends workers that take too long, or that somebody has suspended: one may hold up all who write."""
        now, looks = time.monotonic(), time.monotonic() - self._looked >= LOOK_EVERY
        self._looked = now if looks else self._looked
        for worker in self._workers:
            since = worker.since.value
            if since and not worker.late and now - since > self._given.place.settings.task_limit:
                worker.late = True
                _kill(worker)
            elif looks and worker.process is not None:
                worker.still_since = (worker.still_since or now) if _is_suspended(worker.process) else None
                if worker.still_since is not None and now - worker.still_since > SUSPENDED:
                    _kill(worker)

    def _say(self) -> None:
        figures = self.figures()
        if figures != self._said:
            self._said = figures
            self._context.say(figures)

    def figures(self) -> Mapping[str, Any]:
        """How the workers are."""
        busy = [worker for worker in self._workers if worker.process is not None and worker.asset.value]
        living = sum(worker.process is not None for worker in self._workers)
        return {
            "living": living,
            "unstarted": self._unstarted,
            "in_a_row": 0 if any(worker.done.value for worker in self._workers) else self._in_a_row,
            "at_work": tuple(worker.asset.value.decode() for worker in busy),
            "since": min((worker.since.value for worker in busy if worker.since.value), default=None),
            "deaths": self._deaths,
            "stuck": self._stuck(),
        }

    def _stuck(self) -> StoreError | None:
        """Why nothing can be committed; that the database has stepped back before all else."""
        for worker in sorted(self._workers, key=lambda worker: not worker.back.value):
            why = worker.stuck.value.decode(errors="replace")
            if why:
                return SteppedBack(why, reason="connection lost") if worker.back.value else StoreError(why)
        return None


def _become(worker: _Worker, given: WorkGiven, parent: int) -> None:
    """Makes the present process a worker, until it is ended."""
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if ends_with(parent):
            os.nice(NICENESS)
            from twin.updating.model_cache import PATHS

            PATHS.budget = given.place.settings.worker_cache_bytes
            _work(worker, given)
    except MemoryError:
        os._exit(OUT_OF_MEMORY)
    except BaseException:
        log.exception("a worker process cannot go on")
    finally:
        os._exit(1)


def _work(worker: _Worker, given: WorkGiven) -> None:
    curves = WorkerCurves(given.curves)

    def begun(row: int, refused: bool) -> None:
        worker.row.value, worker.since.value = row, 0.0 if refused else time.monotonic()

    def at(asset: str | None) -> None:
        worker.since.value, worker.asset.value = 0.0, (asset or "").encode()
        if asset is None:
            worker.row.value, worker.done.value = 0, worker.done.value + 1
        curves.at(asset, own.curves)

    def stuck(why: StoreError | None) -> None:
        if not worker.back.value:  # after which all processes of the service begin anew
            worker.stuck.value = str(why or "").encode()[: LONGEST_NAME - 1]
            worker.back.value = isinstance(why, SteppedBack)

    name = f"{given.name} worker {worker.number}".lstrip()
    while True:
        try:
            own = given.place.work(begun, name)
            jobs = Jobs(own.database)
            for row, why in worker.failed[worker.said.value :]:
                jobs.failed(row, why)
                worker.said.value += 1
            claims = own.database.at_work()
            break
        except (StoreError, OSError) as error:  # whoever receives frames says it
            log.debug("a worker cannot open the database now: %s", error)
            time.sleep(FIRST_PAUSE)
    searches = worker.number > 0 or given.count == 1
    loop = WorkLoop(own, jobs, claims, name, searches=searches, at=at, stuck=stuck)
    with own.database.watching() as watch:
        loop.run(watch)


def _kill(worker: _Worker) -> None:
    if worker.process is not None:
        with suppress(ProcessLookupError):
            os.kill(worker.process, signal.SIGKILL)


def _is_suspended(process: int) -> bool:
    """Whether a process is stopped, as far as the system says."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "T"
    except (OSError, IndexError):
        return False


class Records(logging.Handler):
    """Passes on what is logged: the service's log has it in its own form."""

    def emit(self, record: logging.LogRecord) -> None:
        carry(record)
        say(record)


def work(context: Context, given: WorkGiven) -> None:
    """Does the role, in a process of its own that has one thread."""
    assert isinstance(context, ProcessContext)
    logging.getLogger().handlers[:] = [Records()]
    logging.captureWarnings(True)
    with long_lived():
        import service.contract.estimate  # noqa: F401  # loads the twin, once for all workers
    WorkRole(given, context).run()
