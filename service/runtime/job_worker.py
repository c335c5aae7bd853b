"""People's jobs are carried out between two windows of their asset, in the order in which they were submitted."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from service.errors import StoreError
from service.results.job_queue import JobQueue
from service.results.jobs import Job
from service.runtime.lane import Turn
from service.runtime.lanes import Lanes
from service.runtime.place import JobKind

NO_WINDOW = "no window has been processed yet"


class JobWorker:
    """Called between frames: hands the jobs that wait to the lanes of their assets, each once.

    followed  called with each job that has been carried out
    """

    def __init__(
        self,
        queue: JobQueue,
        lanes: Lanes,
        kinds: Mapping[str, JobKind],
        followed: Callable[[Job], None] = lambda job: None,
    ) -> None:
        self._queue, self._lanes, self._kinds, self._followed = queue, lanes, kinds, followed
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
        def refuse(reason: str) -> None:
            self._queue.jobs.refuse(job.id, reason, kind.refused(job, reason))
            self._end(job)

        if self._lanes.find(job.asset) is None and not kind.begins:
            refuse(NO_WINDOW)
        else:
            self._begun.add(job.id)
            self._lanes.do(job.asset, Turn(job=job, kind=kind, refuse=refuse, ended=self._carried_out))

    def _carried_out(self, job: Job) -> None:
        self._followed(job)
        self._end(job)

    def _end(self, job: Job) -> None:
        self._begun.discard(job.id)
        self._ended = True

    def tell(self) -> None:
        """Wakes who waits for jobs that have ended: what they have led to is shown by now."""
        if self._ended:
            self._ended = False
            self._queue.done()
