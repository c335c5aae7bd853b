"""Turns carried out by worker processes, one turn of each at a time.

Every worker is an executor of its own, so that one that dies is replaced alone. An asset stays with a worker, which has
its wear curves, while that worker is free in time; it moves where its own is busy for long and another is idle. Of
several workers the first makes no search for effects, so that there is always one which has none under way. A turn
that ended its worker, or took too long, is tried once more in a new one, and then refused as a fault of the program.

Processes come from a fork server: the service's own process has threads of the network, which no fork survives, and a
server that has loaded the twin once makes a new worker in a moment, with its code shared. A start is the work of a
thread of its own, since that server may not answer: it is replaced after a time, with the workers that it has made.
"""

from __future__ import annotations

import logging
import os
import pickle
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from ctypes import c_longlong
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing.sharedctypes import RawValue
from pathlib import Path
from typing import Any

from service.errors import FAULT
from service.runtime import worker_task
from service.runtime.computing import Turn, Turned
from service.runtime.curves import CurvePlace, Curves
from service.runtime.work import Workplace
from service.runtime.worker_server import kill_server, server_context, start_server
from service.runtime.worker_task import Reply, Task

log = logging.getLogger(__name__)

Begun = Any
"""A number in memory that two processes share: the row of the table of jobs that a worker is at; 0 while at none."""

TRIES = 2  # how often a call is tried that ends its worker
STARTS = 2  # attempts to start a worker's process, in one turn
MOST_DEATHS = 10  # in a row, after which the service does not call itself ready
START_LIMIT = 60.0  # how long a start may take before the server that makes processes is replaced [s] ...
PATIENCE = 2.0  # ... and so many times as long after each time that another did not help: the machine may be slow
SLOW_START = 10.0  # after which the service says that it waits for one [s]
LOOK_EVERY = 0.25  # whether the processes still live: each look reads a file of the system [s]
SUSPENDED = 10.0  # after which a suspended process is ended, and another takes its place [s]
UNNOTICED = 5.0  # how long a process may be dead before it is noticed: the server that made it should say so [s]
MOST_ASSETS = 2048  # of one worker
MOVE_AFTER = 2.0  # how long a call waits for its asset's own worker while another is idle [s]
MOST_PAUSE = 60.0  # between two starts of workers where none succeeds: 1 s at first, then twice as long each time [s]


@dataclass(slots=True, eq=False, kw_only=True)
class _Job:
    """A turn on its way."""

    turn: Turn
    done: Callable[[Turned], None]
    since: float  # when it was asked for, on the monotonic clock [s]
    tries: int = 0  # of the row that its processes were at when they died
    search: bool = False  # whether it is known to lead to a search


@dataclass(slots=True, eq=False)
class _Worker:
    """One process, started with its first call."""

    executor: ProcessPoolExecutor | None = None
    begun: Begun = field(default_factory=lambda: RawValue(c_longlong, 0))  # the row that its process is at
    job: _Job | None = None  # that it carries out
    began: float = 0.0  # when, on the monotonic clock [s]
    late: bool = False  # whether it has been ended because its call took too long
    dead_since: float | None = None  # when its process was first seen to be dead while it has a turn
    still_since: float | None = None  # when its process was first seen to be suspended [s]
    starting: float | None = None  # since when a thread has been starting its process, on the monotonic clock [s]
    given_up: float = 0.0  # when the server was last replaced for that [s]
    jobs: deque[_Job] = field(default_factory=deque)  # of its assets, that wait for it
    assets: dict[str, None] = field(default_factory=dict)  # whose curves it has, the latest last

    def with_asset(self, asset: str) -> _Worker:
        """Itself, which has the asset as its latest; of too many, the one asked for longest ago is given up."""
        self.assets.pop(asset, None)
        self.assets[asset] = None
        if len(self.assets) > MOST_ASSETS:
            del self.assets[next(iter(self.assets))]
        return self


class Processes:
    """Turns in the order in which they were asked for, by so many workers.

    place        where the workers find what they work on
    task_limit   how long one turn may take [s]
    cache_bytes  wear curves that one worker keeps [bytes]
    wake         called, by any thread, when something is ready to be collected
    start_limit  how long the start of a worker's process may take [s]
    curves       where workers find wear curves that another process has computed
    keep         called with an asset and its wear curves where there are new ones
    """

    def __init__(
        self,
        workers: int,
        place: Workplace,
        *,
        task_limit: float,
        cache_bytes: int,
        wake: Callable[[], None],
        start_limit: float = START_LIMIT,
        curves: CurvePlace | None = None,
        keep: Callable[[str, Curves], object] = lambda asset, curves: None,
    ) -> None:
        self._workers = [_Worker() for _ in range(workers)]
        self._limit, self._cache_bytes, self._wake = task_limit, cache_bytes, wake
        self._start_limit = self._patience = start_limit
        self._starts: queue.SimpleQueue[tuple[_Worker, ProcessPoolExecutor | Exception, Begun]] = queue.SimpleQueue()
        self.servers_replaced = 0
        self._looked = 0.0  # when it was last looked whether the processes live [s]
        self._ended: queue.SimpleQueue[tuple[_Worker, _Job, Future[Reply]]] = queue.SimpleQueue()
        self._place, self._curves, self._keep = pickle.dumps(place), curves, keep
        self._context = server_context()
        self._closed = False
        self.deaths = 0
        self._in_a_row = 0  # deaths since a call was answered
        self._lived = False  # whether any worker's process has been started
        self._unstarted, self._failures, self._start_at = "", 0, 0.0  # why, how often in a row, the next attempt [s]

    def start(self, turn: Turn, done: Callable[[Turned], None]) -> None:
        """Has a turn carried out; `done` is called by `collect`."""
        worker = self._home(turn.asset)
        worker.jobs.append(_Job(turn=turn, done=done, since=time.monotonic()))
        self._next(worker)

    def collect(self) -> None:
        """Hands on what has been made, and looks after the workers."""
        while True:
            try:
                worker, job, future = self._ended.get_nowait()
            except queue.Empty:
                break
            self._take(worker, job, future)
        self._take_started()
        self._end_late()
        self._look_after_server()
        self._move()
        for worker in self._workers:
            self._next(worker)
        if not any(worker.executor or worker.starting is not None for worker in self._workers):
            self._start(self._workers[0])  # also where nothing is asked yet: a service without a worker is not ready

    def close(self) -> None:
        """Ends all workers at once: what they compute is computed again by the next start."""
        self._closed = True
        if any(worker.starting is not None for worker in self._workers):
            kill_server()  # which may be stopped, and would be left behind
        for worker in self._workers:
            self._discard(worker)

    def unusable(self) -> str | None:
        """Why nothing can be computed: no worker lives, or they end with whatever they are asked."""
        if not any(worker.executor for worker in self._workers):
            starting = [w.starting for w in self._workers if w.starting is not None]
            slow = any(time.monotonic() - since > SLOW_START for since in starting)
            if self._unstarted:
                return f"no worker process can be started: {self._unstarted}"
            if slow:
                return (
                    f"no worker process could be started for {SLOW_START:g} s: "
                    "the process that makes them does not answer"
                )
            if not self._lived:
                return "the first worker process is being started"
        if self._in_a_row < MOST_DEATHS:
            return None
        return f"the last {self._in_a_row} calls to the twin ended their worker processes; is there enough memory?"

    def at_work(self) -> tuple[str, ...]:
        """The assets whose turns are being carried out."""
        return tuple(worker.job.turn.asset for worker in self._workers if worker.job is not None)

    def figures(self) -> Mapping[str, float]:
        """Figures for /metrics."""
        now = time.monotonic()
        began = [w.began for w in self._workers if w.job is not None]
        return {
            "workers": len(self._workers),
            "workers_busy": len(began),
            "worker_deaths": self.deaths,
            "worker_servers_replaced": self.servers_replaced,
            "twin_calls_waiting": sum(len(w.jobs) for w in self._workers),
            "twin_call_seconds": max((now - b for b in began), default=0.0),
        }

    # -- calls ---------------------------------------------------------------------------------------

    def _next(self, worker: _Worker) -> None:
        """Begins the call that waits longest for a worker, if it is free."""
        if worker.job is not None or not worker.jobs or self._closed:
            return
        if worker.executor is None:
            self._start(worker)
            return
        worker.begun.value = 0
        try:
            future = worker.executor.submit(worker_task.perform, self._task(worker, worker.jobs[0].turn))
        except (RuntimeError, OSError, EOFError):  # it has died while it had nothing to do
            self._discard(worker)
            self._start(worker)
            return
        job = worker.job = worker.jobs.popleft()
        worker.began = time.monotonic()
        future.add_done_callback(partial(self._note, worker, job))

    def _note(self, worker: _Worker, job: _Job, future: Future[Reply]) -> None:
        self._ended.put((worker, job, future))
        self._wake()

    def _task(self, worker: _Worker, turn: Turn) -> Task:
        first = worker is self._workers[0] and len(self._workers) > 1
        return Task(place=self._place, turn=replace(turn, hand_back=first), curves=self._curves)

    def _take(self, worker: _Worker, job: _Job, future: Future[Reply]) -> None:
        """What a worker has done, or that it has died."""
        if worker.job is not job:
            return
        worker.job = None
        error = None if future.cancelled() else future.exception()
        if error is None and not future.cancelled():
            self._in_a_row = 0
            self._answered(worker, job, future.result())
            return
        if error is not None and not isinstance(error, BrokenProcessPool | MemoryError):
            self._again(worker, job, f"{type(error).__name__}: {error}")
            return
        self._died(worker, job, error)

    def _answered(self, worker: _Worker, job: _Job, reply: Reply) -> None:
        asset = job.turn.asset
        take_records(reply, asset)
        if reply.curves is not None:
            self._keep(asset, reply.curves)
        if reply.turned.search:
            job.search, job.since = True, time.monotonic()
            worker.assets.pop(asset, None)
            other = min(self._workers[1:], key=lambda w: (w.job is not None, len(w.jobs)))
            other.with_asset(asset).jobs.append(job)
            self._next(other)
        self._next(worker)
        if not reply.turned.search:
            job.done(reply.turned)

    def _died(self, worker: _Worker, job: _Job, error: BaseException | None) -> None:
        """A worker has died with a turn, or has no memory for it: it is replaced."""
        self.deaths += 1
        self._in_a_row += 1
        ended = "had too little memory" if isinstance(error, MemoryError) else "ended its worker process"
        why = f"took longer than {self._limit:g} s" if worker.late else ended
        self._discard(worker)
        log.error("%s: what was to be done next %s", job.turn.asset, why, extra={"asset": job.turn.asset})
        if worker.begun.value:
            self._again(worker, job, why)
        else:  # of no asset's making
            worker.jobs.appendleft(job)
            self._next(worker)

    def _again(self, worker: _Worker, job: _Job, why: str) -> None:
        """A turn that could not be carried out is tried once more, and the row that it was at is refused then."""
        begun = worker.begun.value or job.turn.tried
        job.tries = job.tries + 1 if begun == job.turn.tried else 1
        job.turn = replace(job.turn, tried=begun)
        if job.tries > TRIES:
            self._next(worker)
            job.done(Turned(asset=job.turn.asset, stopped=f"nothing can be done of {job.turn.asset}: {why}"))
            return
        if job.tries == TRIES:
            job.turn = replace(job.turn, refuse=f"{FAULT}: {why}, {TRIES} times")
        worker.jobs.appendleft(job)
        self._next(worker)

    def _end_late(self) -> None:
        """Ends workers whose turn takes too long."""
        now = time.monotonic()
        for worker in self._workers:
            if worker.job is not None and not worker.late and now - worker.began > self._limit:
                worker.late = True
                _kill(worker.executor)

    def _end_suspended(self, now: float) -> None:
        """Ends workers that somebody has suspended: in the midst of a transaction, one may hold up all who write."""
        for worker in self._workers:
            still = worker.executor is not None and _states(worker.executor) == {"T"}
            worker.still_since = (worker.still_since or now) if still else None
            if worker.still_since is not None and now - worker.still_since > SUSPENDED:
                worker.still_since = None
                _kill(worker.executor)

    # -- assets --------------------------------------------------------------------------------------

    def _home(self, asset: str) -> _Worker:
        """The worker that has an asset's curves; for a new asset the one with the fewest."""
        for worker in self._workers:
            if asset in worker.assets:
                return worker.with_asset(asset)
        return min(self._workers, key=lambda w: len(w.assets)).with_asset(asset)

    def _move(self) -> None:
        """Moves assets that have waited for long to workers that are idle."""
        now = time.monotonic()
        for idle in self._workers:
            if idle.job is not None or idle.jobs:
                continue
            busy = [w for w in self._workers if w.jobs and now - w.jobs[0].since > MOVE_AFTER]
            if not busy:
                return
            crowded = min(busy, key=lambda w: w.jobs[0].since)
            if crowded.jobs[0].search and idle is self._workers[0]:
                continue
            job = crowded.jobs.popleft()
            crowded.assets.pop(job.turn.asset, None)
            idle.with_asset(job.turn.asset).jobs.append(job)
            self._next(idle)

    # -- processes -----------------------------------------------------------------------------------

    def _start(self, worker: _Worker) -> None:
        """Starts a worker's process in a thread, unless one does so already."""
        if worker.starting is None and not self._closed and time.monotonic() >= self._start_at:
            worker.starting = worker.given_up = time.monotonic()
            threading.Thread(target=self._make, args=(worker,), name="worker start", daemon=True).start()

    def _make(self, worker: _Worker) -> None:
        """Makes a process. Twice: the server that makes them may have died, too."""
        made: ProcessPoolExecutor | Exception = RuntimeError()
        begun = RawValue(c_longlong, 0)
        for _ in range(STARTS):
            if self._closed:
                return
            begun = RawValue(c_longlong, 0)
            executor = ProcessPoolExecutor(
                max_workers=1,
                mp_context=self._context,
                initializer=worker_task.begin,
                initargs=(logging.getLogger().getEffectiveLevel(), self._cache_bytes, begun),
            )
            try:
                start_server()
                executor.submit(os.getpid).result()  # once it has loaded the twin
            except (RuntimeError, OSError, EOFError) as error:  # no thread, process, memory or server
                made = error
                executor.shutdown(wait=False, cancel_futures=True)
                continue
            made = executor
            break
        self._starts.put((worker, made, begun))
        self._wake()

    def _take_started(self) -> None:
        """Gives workers the processes that have been started for them."""
        while True:
            try:
                worker, made, begun = self._starts.get_nowait()
            except queue.Empty:
                return
            worker.starting = None
            if isinstance(made, ProcessPoolExecutor):
                worker.executor, worker.begun = made, begun
                self._patience, self._lived = self._start_limit, True
                self._unstarted, self._failures, self._start_at = "", 0, 0.0
                continue
            self._unstarted = _why_unstarted(made)
            self._start_at = time.monotonic() + min(2.0**self._failures, MOST_PAUSE)
            self._failures += 1
            log.error("a worker process cannot be started now: %s", self._unstarted)

    def _look_after_server(self) -> None:
        """Replaces the server that makes processes where it starts none, or does not say that one has died."""
        now = time.monotonic()
        if now - self._looked < LOOK_EVERY:
            return
        self._looked = now
        self._end_suspended(now)
        for worker in self._workers:
            if worker.starting is not None and now - worker.given_up > self._patience:
                worker.given_up = now
                self._replace_server(f"a worker process could not be started within {self._patience:g} s")
                self._patience *= PATIENCE
                return
            dead = worker.job is not None and worker.executor is not None and _states(worker.executor) == {"Z"}
            worker.dead_since = (worker.dead_since or now) if dead else None
            if worker.dead_since is not None and now - worker.dead_since > UNNOTICED:
                worker.dead_since = None
                self._replace_server("the end of a worker process was not noticed")
                return

    def _replace_server(self, why: str) -> None:
        """Ends the server; the next start makes another. The workers that it has made end as well, without a fault."""
        log.error("%s: the process that makes them does not answer, and is replaced", why)
        self.servers_replaced += 1
        for worker in self._workers:
            if worker.job is not None:
                worker.job.tries -= 1
        kill_server()

    def _discard(self, worker: _Worker) -> None:
        """Ends a worker's process, without waiting; the next call starts another."""
        executor, worker.executor, worker.late = worker.executor, None, False
        if executor is not None:
            _kill(executor)
            executor.shutdown(wait=False, cancel_futures=True)


def take_records(reply: Reply, asset: str) -> None:
    """Hands on what a worker has logged."""
    for record in reply.records:
        record.asset = asset
        logging.getLogger(record.name).handle(record)


def _kill(executor: ProcessPoolExecutor | None) -> None:
    """Kills an executor's process."""
    for process in list((executor._processes if executor else None) or {}):
        try:
            os.kill(process, 9)
        except ProcessLookupError:
            continue


def _states(executor: ProcessPoolExecutor) -> set[str]:
    """The state of an executor's process, `Z` where it has died unnoticed; nothing where that is not known."""
    found = set()
    for process in list(executor._processes or {}):
        try:
            found.add(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0])
        except (OSError, IndexError):
            return set()
    return found


def _why_unstarted(error: Exception) -> str:
    """Why a worker's process could not be started."""
    if isinstance(error, BrokenProcessPool):
        return "it ended while it loaded the twin, and what it printed is on the standard error of the service"
    return f"{type(error).__name__}: {error}"
