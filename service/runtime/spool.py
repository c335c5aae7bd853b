"""Windows that have closed are made durable before anything else becomes of them.

The file of its frames is written first, its name as well; what names it in the database, and where its asset's stream
goes on after it, are one transaction. Then the window is acknowledged, and neither the end of the process nor a power
cut loses it. It waits until its asset's turn comes; the transaction that commits its results ends the wait.

What waits is bounded. Over a bound the oldest window of the asset with most waiting is left out as a whole: in its turn
it becomes a refused record with the reason. While the storage cannot be used, closed windows wait in memory, in the
same order and within a bound of their own; one that is left out there keeps its place, without its frames.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from service.operation.journey import Journey
from service.results.jobs import Jobs
from service.results.sql_store import SqlStore
from service.results.window_jobs import WaitingWindow, WindowJobs, Written, delete_file
from service.runtime.backlogs import Backlogs
from service.runtime.outcomes import ClosedWindow
from service.runtime.reception import Reception
from service.runtime.storage_watch import StorageWatch
from service.runtime.window_outcomes import without_room
from service.settings import Settings
from service.steady_clock import later_time_ns

log = logging.getLogger(__name__)

MOST_JOURNEYS = 10_000  # windows that wait and whose stages are remembered
TOO_MANY = "left out: more windows of the asset waited to be processed than are kept"
NOT_STORED = "left out: the storage could not be used, and more windows waited in memory than are kept there"


class _Moved(Exception):
    """Within a transaction: it keeps nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BacklogLimits:
    """How much may wait to be processed."""

    windows: int  # of one asset
    bytes: int  # of one asset, on disk
    total_windows: int
    total_bytes: int  # on disk
    memory_bytes: int  # of all assets, while the storage cannot be used

    @classmethod
    def of(cls, settings: Settings) -> BacklogLimits:
        return cls(
            windows=settings.backlog_windows,
            bytes=settings.backlog_bytes,
            total_windows=settings.backlog_total_windows,
            total_bytes=settings.backlog_total_bytes,
            memory_bytes=settings.backlog_memory_bytes,
        )


class Spool:
    """Where closed windows of all assets wait for their turn.

    settled  called with an asset when a window of it is durable
    """

    def __init__(
        self,
        windows: WindowJobs,
        store: SqlStore,
        reception: Reception,
        backlogs: Backlogs,
        storage: StorageWatch,
        limits: BacklogLimits,
        *,
        settled: Callable[[str], object],
    ) -> None:
        self._windows, self._store, self._reception, self._backlogs = windows, store, reception, backlogs
        self._storage, self._limits, self._settled = storage, limits, settled
        self._jobs = Jobs(windows.database)
        self._assemblies: dict[str, Mapping[str, Any]] = {}  # by asset: where its stream goes on after what is stored
        self._journeys: dict[int, Journey] = {}  # by job
        self._pending: dict[str, deque[ClosedWindow]] = {}
        self._held = 0  # bytes of those, in memory
        self._unanswered: dict[str, Written] = {}  # files that the database may name: a commit had no answer

    def add(self, closed: ClosedWindow) -> None:
        """Keeps a window; later, where the storage cannot be used now."""
        self._pending.setdefault(closed.asset, deque()).append(closed)
        self._held += closed.segment.nbytes
        self._keep_all(closed.asset)
        while self._held > self._limits.memory_bytes:
            self._leave_out_pending()

    def retry(self) -> bool:
        """Tries again to keep what waits in memory; whether nothing waits any more."""
        for asset in list(self._pending):
            self._keep_all(asset)
        return not self._pending

    def unstored_from_ns(self, asset: str) -> int | None:
        """Start of the earliest window that has closed and is not durable yet; None where all are."""
        pending = self._pending.get(asset)
        return min((closed.segment.start_ns for closed in pending.copy()), default=None) if pending else None

    def goes_on(self, asset: str, assembly: Mapping[str, Any]) -> None:
        """Where an asset's stream goes on, by what an earlier run has stored."""
        self._assemblies[asset] = assembly

    def journey(self, job: int) -> Journey:
        """The stages of a window that waits no longer."""
        return self._journeys.pop(job, None) or Journey()

    def give(self, asset: str, other: str) -> None:
        """The windows of an asset that wait in memory are another one's, as those that waited in the table."""
        if asset in self._pending:
            self._pending[other] = deque(replace(closed, asset=other) for closed in self._pending.pop(asset))
        if asset in self._assemblies:
            self._assemblies[other] = self._assemblies[asset]
        if asset in self._unanswered:
            self._unanswered[other] = self._unanswered.pop(asset)

    @property
    def held_bytes(self) -> int:
        """What the windows that wait in memory take [bytes]."""
        return self._held

    # -- durable -------------------------------------------------------------------------------------

    def _keep_all(self, asset: str) -> None:
        pending = self._pending[asset]
        while pending:
            done, kept = self._storage.attempt(partial(self._keep, pending[0]))
            if not (done and kept):
                return
            self._held -= pending.popleft().segment.nbytes
            self._settled(asset)
        del self._pending[asset]

    def _keep(self, closed: ClosedWindow) -> bool:
        """Keeps a window; False where its stream may no longer be its asset's, and that is to be followed first."""
        asset, segment = closed.asset, closed.segment
        self._make_room(asset)
        before = self._unanswered.get(asset)
        written = before or self._windows.write(segment)
        try:
            with self._windows.transaction() as db:
                self._windows.database.ensure(db, asset)
                if self._jobs.unfollowed(asset):
                    raise _Moved
                kept = self._kept(asset, segment.start_ns, written)
                self._store.keep(asset, assembly=closed.assembly, quality=self._reception.quality(asset))
        except _Moved:
            self._unanswered[asset] = written
            return False
        except BaseException as error:
            if getattr(error, "unknown", False):
                self._unanswered[asset] = written
            elif before is None:
                delete_file(written.path)  # of no window now
            raise
        self._unanswered.pop(asset, None)
        if kept is not None and kept.file != written.name:
            delete_file(written.path)
        closed.journey.kept_ns = later_time_ns()
        if kept is not None:
            self._journeys[kept.id] = closed.journey
        if len(self._journeys) > MOST_JOURNEYS:
            del self._journeys[next(iter(self._journeys))]
        self._assemblies[asset] = closed.assembly
        self._backlogs.changed()
        return True

    def _kept(self, asset: str, start_ns: int, written: Written) -> WaitingWindow | None:
        """The row of a window: a new one, or that of an earlier attempt of which nobody knew.

        None where that attempt was committed, and the window has been processed since.
        """
        if asset in self._unanswered:
            for waiting in self._windows.waiting(asset):
                if waiting.start_ns == start_ns:
                    return waiting
            if self._store.has_window(asset, start_ns):
                return None
        return self._windows.add_waiting(asset, written, self._assemblies.get(asset, {}))

    # -- bounds --------------------------------------------------------------------------------------

    def _make_room(self, asset: str) -> None:
        """Leaves windows out until one more of an asset has room."""
        limits, backlogs = self._limits, self._backlogs
        own = backlogs.now(asset)
        while own.all_windows >= limits.windows or own.bytes >= limits.bytes:
            if not self._leave_out(asset, self._windows.waiting(asset)):
                break
            own = backlogs.now(asset)
        while backlogs.windows >= limits.total_windows or backlogs.bytes >= limits.total_bytes:
            crowded = backlogs.most_waiting()
            if not self._leave_out(crowded, self._windows.waiting(crowded)):
                break
            backlogs.now(crowded)

    def _leave_out(self, asset: str, waiting: Iterable[WaitingWindow]) -> bool:
        """Leaves the oldest window out that waits and may not be at work; False where there is none."""
        next_one = self._windows.next(asset)
        for window in waiting:
            if window.file is not None and (next_one is None or window.id != next_one.id):
                self._windows.leave_out(window, TOO_MANY)
                self._backlogs.changed()
                return True
        return False

    def _leave_out_pending(self) -> None:
        """The oldest window in memory, of the asset that takes most there, loses its frames and keeps its place."""
        sizes = {asset: sum(c.segment.nbytes for c in pending) for asset, pending in self._pending.items()}
        asset = max(sizes, key=lambda name: sizes[name])
        pending = self._pending[asset]
        place = next(i for i, closed in enumerate(pending) if closed.segment.nbytes)
        closed = pending[place]
        self._held -= closed.segment.nbytes
        pending[place] = replace(closed, segment=closed.segment.without_frames(without_room(NOT_STORED)))
        log.warning("%s: %s", asset, NOT_STORED, extra={"asset": asset})
