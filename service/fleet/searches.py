"""Searches for effects as tasks of the engine, so that the windows of a partition's other assets do not wait for them.

A window is computed by the partition's own process until a search turns out to be due: then nothing has been made of
it, and the whole call is carried out elsewhere, from the same state. What is made of it joins its asset's order as that
of any other call would: the asset's next window is received and kept meanwhile, and computed after it, because the
state that a search leads to is what that window is compared with. The results are those of one process, bit for bit.

Where the engine does not do it, for whatever reason, or not in time, the partition's own process does.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial

from service.runtime.computing import UNREADABLE, Call, Computing, Made
from service.runtime.curves import Curves
from service.runtime.worker_processes import take_records
from service.runtime.worker_task import Reply, Task, Tasks

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Search:
    """A task that the engine has been given, and how it is called off."""

    reply: Future[Reply]
    cancel: Callable[[], object]


Submit = Callable[[Task], Search]


@dataclass(slots=True, eq=False, kw_only=True)
class _Job:
    call: Call
    done: Callable[[Made], None]
    search: Search
    since: float  # on the monotonic clock [s]


class Searches:
    """Calls as another place carries them out, apart from searches.

    inner   where windows are computed, and searches that nobody else makes
    submit  gives a task to the engine
    tasks   makes them of calls
    keep    called with an asset and its wear curves where there are new ones
    limit   after which a search is made here [s]
    wake    called, by any thread, when something is ready to be collected
    """

    def __init__(
        self,
        inner: Computing,
        submit: Submit,
        *,
        tasks: Tasks,
        keep: Callable[[str, Curves], object],
        limit: float,
        wake: Callable[[], None],
    ) -> None:
        self._inner, self._submit, self._tasks, self._keep = inner, submit, tasks, keep
        self._limit, self._wake = limit, wake
        self._jobs: set[_Job] = set()
        self._done = self._failed = 0

    def start(self, call: Call, done: Callable[[Made], None]) -> None:
        """Has a call carried out; `done` is called by `collect`."""
        if call.ask.verb == "window":
            self._inner.start(replace(call, hand_back=True), partial(self._made, call, done))
        else:
            self._inner.start(call, done)

    def collect(self) -> None:
        """Hands on what has been made, and calls off searches that take too long."""
        self._inner.collect()
        now = time.monotonic()
        for job in [job for job in self._jobs if job.search.reply.done() or now - job.since > self._limit]:
            self._jobs.remove(job)
            self._take(job)

    def close(self) -> None:
        """Begins nothing more, and calls off what the engine has been given."""
        jobs, self._jobs = self._jobs, set()
        for job in jobs:
            job.search.cancel()
        self._inner.close()

    def unusable(self) -> str | None:
        """Why nothing can be computed, or None."""
        return self._inner.unusable()

    def at_work(self) -> tuple[str, ...]:
        """The assets whose calls are being carried out."""
        return (*self._inner.at_work(), *(job.call.asset for job in self._jobs))

    def figures(self) -> Mapping[str, float]:
        """Figures for /metrics."""
        return {
            **self._inner.figures(),
            "engine_searches": float(len(self._jobs)),
            "engine_searches_made": float(self._done),
            "engine_searches_failed": float(self._failed),
        }

    def _made(self, call: Call, done: Callable[[Made], None], made: Made) -> None:
        if not made.handed_back:
            done(made)
            return
        try:
            search = self._submit(self._tasks.of(call))
        except Exception as error:  # whatever the engine has to say
            self._here(call, done, f"{type(error).__name__}: {error}")
            return
        job = _Job(call=call, done=done, search=search, since=time.monotonic())
        self._jobs.add(job)
        search.reply.add_done_callback(lambda reply: self._wake())

    def _take(self, job: _Job) -> None:
        reply = job.search.reply
        if not reply.done():
            job.search.cancel()
            why = f"it took longer than {self._limit:g} s"
        elif reply.cancelled():
            why = "it was called off"
        elif (error := reply.exception()) is not None:
            why = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
        elif _is_without_file(reply.result()):
            why = "the file of the window cannot be read there; do all nodes see the folder?"
        else:
            self._done += 1
            take_records(reply.result(), job.call.asset)
            curves = reply.result().curves
            if curves is not None:
                self._keep(job.call.asset, curves)
            job.done(reply.result().made)
            return
        self._here(job.call, job.done, why)

    def _here(self, call: Call, done: Callable[[Made], None], why: str) -> None:
        self._failed += 1
        log.warning("a search for effects was not made by the engine, and is made here: %s", why,
                    extra={"asset": call.asset})  # fmt: skip
        self._inner.start(call, done)


def _is_without_file(reply: Reply) -> bool:
    window = reply.made.window
    return window is not None and any(fault.kind == UNREADABLE for fault in window.faults)
