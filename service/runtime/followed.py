"""What others have committed is followed by who receives frames: in the order of the tables, each thing once.

Assets that have changed are published; what people's jobs mean for streams is carried out; and windows whose results
have come are told, with the stages that they went through.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.errors import FAULT
from service.operation.journey import Arrived
from service.results.asset_changes import AssetChanges
from service.results.jobs import Job, Jobs
from service.results.sql_store import SqlStore
from service.runtime.backlogs import Backlogs
from service.runtime.positions import Positions
from service.runtime.routes import Routes
from service.runtime.spool import Spool
from service.runtime.state_publication import StatePublication
from service.runtime.storage_watch import StorageWatch
from service.steady_clock import later_time_ns

Timed = Callable[[str, Mapping[str, float]], object]
"""Called with what was asked of a twin, and how long its parts took [s]."""


class Followed:
    """Called between frames.

    changes   assets that have changed
    carry_on  called with each job of people that has ended and was not refused
    arrived   called with each window whose results have come
    ended     jobs that the start has found ended
    """

    def __init__(
        self,
        changes: AssetChanges,
        store: SqlStore,
        publication: StatePublication,
        backlogs: Backlogs,
        spool: Spool,
        storage: StorageWatch,
        *,
        routes: Routes,
        positions: Positions,
        carry_on: Callable[[Job], None],
        arrived: Arrived,
        timed: Timed,
        alarms: AlarmKeeper | None,
        ended: Iterable[Job] = (),
    ) -> None:
        self._changes, self._store, self._jobs = changes, store, Jobs(store.database)
        self._publication, self._backlogs, self._spool, self._storage = publication, backlogs, spool, storage
        self._routes, self._positions, self._carry_on, self._alarms = routes, positions, carry_on, alarms
        self._arrived, self._timed = arrived, timed
        self._next = store.next_indices()  # by asset: of the window to come
        self._new: dict[str, None] = {}  # assets of which something may have been committed
        self._carried: set[int] = set()  # jobs that have been carried on, and not yet noted as that
        self.faults = 0  # of the program, each of which cost a job
        changes.take(0)  # all that is known at the start is read from the tables
        self._jobs.follow(*ended)

    def __call__(self) -> None:
        """Follows what has been committed since."""
        changed = self._changes.take(0)
        if changed:
            self._new |= dict.fromkeys(changed)
            for asset in changed:
                self._publication.publish(asset)
                self._positions.moved(*self._routes.streams_of(asset))
            self._backlogs.changed()
            if self._alarms is not None:
                self._alarms.look()
        if self._new:
            self._storage.attempt(self._follow)

    def _follow(self) -> None:
        jobs = self._jobs.ended()
        for job in jobs:
            if job.id not in self._carried:
                if job.refused is None:
                    self._carry_on(job)
                self._note(job.stages or {}, job.refused)
                self._carried.add(job.id)
        self._jobs.follow(*jobs)
        self._carried.clear()
        while self._new:
            self._follow_windows(next(iter(self._new)))
            self._new.pop(next(iter(self._new)))

    def _follow_windows(self, asset: str) -> None:
        for index, record, stages in self._store.arrived(asset, self._next.get(asset, 0)):
            journey = self._spool.journey(stages.get("job", 0))
            for name in ("started_ns", "made_ns", "stored_ns"):
                setattr(journey, name, stages.get(name, 0))
            journey.parts, journey.published_ns = stages.get("parts", {}), later_time_ns()
            self._note(stages, record.get("reason"))
            self._arrived(asset, index, record.get("quality", ""), journey)
            self._next[asset] = index + 1

    def _note(self, stages: Mapping[str, Any], refused: str | None) -> None:
        self.faults += (refused or "").startswith(FAULT)
        if stages.get("parts"):
            self._timed(stages["verb"], stages["parts"])
