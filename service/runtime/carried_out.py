"""What follows a job that whoever computes has carried out and committed: it is shown, and the streams follow it.

They follow before the asset's next job is begun: what has come of its stream since the commit can still be moved.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from service.alarms.keeper import AlarmKeeper
from service.operation.journey import Arrived
from service.results.asset_table import AssetTable
from service.results.job_queue import JobQueue
from service.results.jobs import WINDOW, Job
from service.runtime.backlogs import Backlogs
from service.runtime.computing import Turned
from service.runtime.positions import Positions
from service.runtime.spool import Spool
from service.runtime.state_publication import StatePublication
from service.runtime.storage_watch import StorageWatch
from service.runtime.streams import Streams
from service.steady_clock import later_time_ns


class CarriedOut:
    """Called with what was done of an asset.

    followed  called with each job of people that has been carried out
    arrived   called with each window that has been shown
    """

    def __init__(
        self,
        table: AssetTable,
        queue: JobQueue,
        publication: StatePublication,
        backlogs: Backlogs,
        spool: Spool,
        storage: StorageWatch,
        *,
        streams: Streams,
        positions: Positions,
        followed: Callable[[Job], None],
        arrived: Arrived,
        alarms: AlarmKeeper | None,
    ) -> None:
        self._table, self._queue, self._publication, self._backlogs = table, queue, publication, backlogs
        self._spool, self._streams, self._positions, self._alarms = spool, streams, positions, alarms
        self._storage = storage
        self._followed, self._arrived = followed, arrived
        self._follow: deque[int] = deque()  # people's jobs that have ended
        self._ended = False  # whether one has of which nobody has been told

    def __call__(self, turned: Turned) -> None:
        """Shows what was done."""
        asset = turned.asset
        assert turned.job is not None
        self._table.changed(asset)
        self._publication.publish(asset)
        self._backlogs.changed()
        if self._alarms is not None:
            self._alarms.look()
        if turned.kind != WINDOW:
            self._follow.append(turned.job)
            self._storage.attempt(self.follow)
        elif not turned.held:
            journey = self._spool.journey(turned.job)
            journey.started_ns, journey.made_ns, journey.stored_ns = turned.started_ns, turned.made_ns, turned.stored_ns
            journey.parts, journey.published_ns = turned.parts, later_time_ns()
            self._arrived(asset, turned.index, turned.grade, journey)
            self._positions.moved(*self._streams.streams_of(asset))

    def follow(self) -> None:
        """Follows the jobs that have ended, as far as that has not been done."""
        while self._follow:
            job = self._queue.jobs.job(self._follow[0])
            if job.refused is None:
                self._followed(job)
            self._follow.popleft()
            self._ended = True

    def tell(self) -> None:
        """Wakes who waits for jobs that have ended: what they have led to is shown by now."""
        if self._ended:
            self._ended = False
            self._queue.done()
