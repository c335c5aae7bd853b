"""People's jobs are carried out between two windows of their asset, in the order in which they were submitted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

from service.errors import StoreError
from service.results.job_queue import JobQueue
from service.results.jobs import Job, Jobs
from service.runtime.computing import Ask, Made
from service.runtime.lane import Lane, Turn
from service.runtime.lanes import Lanes

NO_WINDOW = "no window has been processed yet"


def nothing(lane: Lane, job: Job) -> Ask | None:
    """Nothing is asked of the twin."""
    return None


class JobKind(NamedTuple):
    """How a kind of job is carried out.

    then     what follows, with what the twin has made, in one transaction (`once`)
    ask      what is asked of the twin; None where nothing is
    refused  the outcome of a job that cannot be carried out, by the reason
    begins   whether it can be carried out before the asset's first window
    """

    then: Callable[[Lane, Job, Made], None]
    ask: Callable[[Lane, Job], Ask | None] = nothing
    refused: Callable[[Job, str], Mapping[str, Any] | None] = lambda job, reason: None
    begins: bool = False


@contextmanager
def once(jobs: Jobs, job: Job, outcome: Mapping[str, Any] | None) -> Iterator[bool]:
    """The transaction of a job. False where an earlier attempt, of which that was not known, has committed it.

    What is shown, and what the lanes know, is brought up to date after it in either case: once everything has been
    read that is needed for that, so that a storage which fails meanwhile leaves nothing half done.
    """
    with jobs.transaction():
        yield jobs.end(job.id, outcome)


class JobWorker:
    """Called between frames: hands the jobs that wait to the lanes of their assets, each once."""

    def __init__(self, queue: JobQueue, lanes: Lanes, kinds: Mapping[str, JobKind]) -> None:
        self._queue, self._lanes, self._kinds = queue, lanes, kinds
        self._begun: set[int] = set()
        self._ended = False  # whether a job has ended of which nobody has been told

    def __call__(self) -> None:
        """Hands over what waits, where something new does."""
        if not self._queue.asked.is_set():
            return
        try:
            for job in self._queue.pending():
                if job.id not in self._begun:
                    self._begin(job, self._kinds[job.kind])
        except StoreError:
            self._queue.asked.set()  # some still wait
            raise

    def _begin(self, job: Job, kind: JobKind) -> None:
        def then(lane: Lane, made: Made) -> None:
            kind.then(lane, job, made)
            self._end(job)

        def refuse(reason: str) -> None:
            self._queue.jobs.refuse(job.id, reason, kind.refused(job, reason))
            self._end(job)

        if self._lanes.find(job.asset) is None and not kind.begins:
            refuse(NO_WINDOW)
        else:
            self._begun.add(job.id)
            self._lanes.do(job.asset, Turn(ask=partial(_asked, kind, job), then=then, refuse=refuse))

    def _end(self, job: Job) -> None:
        self._begun.discard(job.id)
        self._ended = True

    def tell(self) -> None:
        """Wakes who waits for jobs that have ended: what they have led to is shown by now."""
        if self._ended:
            self._ended = False
            self._queue.done()


def _asked(kind: JobKind, job: Job, lane: Lane) -> Ask | None:
    return kind.ask(lane, job)
