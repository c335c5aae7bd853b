"""Windows that have closed are made durable before anything else becomes of them.

The file of its frames is written first, its name as well; what names it in the database, and where its asset's stream
goes on after it, are one transaction. Then the window is acknowledged, and neither the end of the process nor a power
cut loses it. It waits until its asset's turn comes; the transaction that commits its results ends the wait.

What waits is bounded. Over a bound the oldest window of the asset with most waiting is left out as a whole: it becomes
a refused record with the reason. While the storage cannot be used, closed windows wait in memory, in the same order and
within a bound of their own; one that is left out there keeps its place, without its frames.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

from service.results.sql_store import SqlStore
from service.results.window_jobs import WaitingWindow, WindowJobs, Written, delete_file
from service.runtime.lane import Entry, Lane
from service.runtime.lanes import SHED, Lanes
from service.runtime.outcomes import ClosedWindow
from service.runtime.reception import Reception
from service.runtime.storage_watch import StorageWatch
from service.steady_clock import later_time_ns
from twin.windows import Fault, Window

log = logging.getLogger(__name__)

TOO_MANY = "left out: more windows of the asset waited to be processed than are kept"
NOT_STORED = "left out: the storage could not be used, and more windows waited in memory than are kept there"


@dataclass(frozen=True, slots=True, kw_only=True)
class BacklogLimits:
    """How much may wait to be processed."""

    windows: int  # of one asset
    bytes: int  # of one asset, on disk
    total_windows: int
    total_bytes: int  # on disk
    memory_bytes: int  # of all assets, while the storage cannot be used


class Spool:
    """Where closed windows of all assets wait for their turn.

    settled  called with an asset when a window of it is durable
    """

    def __init__(
        self,
        windows: WindowJobs,
        store: SqlStore,
        reception: Reception,
        lanes: Lanes,
        storage: StorageWatch,
        limits: BacklogLimits,
    ) -> None:
        self._windows, self._store, self._reception, self._lanes = windows, store, reception, lanes
        self._storage, self._limits = storage, limits
        self.settled: Callable[[str], object] = lambda asset: None
        self._pending: dict[str, deque[ClosedWindow]] = {}
        self._held = 0  # bytes of those, in memory
        self._unanswered: dict[str, Written] = {}  # files that the database may name: a commit had no answer

    def add(self, closed: ClosedWindow) -> None:
        """Keeps a window and hands it to its asset's lane; later, where the storage cannot be used now."""
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

    def give(self, asset: str, other: str) -> None:
        """The windows of an asset that wait in memory are another one's, once that has been committed."""
        if asset in self._pending:
            self._pending[other] = deque(replace(closed, asset=other) for closed in self._pending.pop(asset))
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
            done, _ = self._storage.attempt(partial(self._keep, pending[0]))
            if not done:
                return
            self._held -= pending.popleft().segment.nbytes
            self.settled(asset)
        del self._pending[asset]

    def _keep(self, closed: ClosedWindow) -> None:
        asset, segment = closed.asset, closed.segment
        lane = self._lanes.of(asset)
        self._make_room(lane)
        before = self._unanswered.get(asset)
        written, kept = before or self._windows.write(segment), None
        try:
            with self._windows.transaction():
                waiting = self._windows.waiting(asset)
                if waiting and waiting[-1].start_ns == segment.start_ns:  # by an earlier attempt that did not know it
                    kept = waiting[-1]
                else:
                    kept = self._windows.add_waiting(asset, written, waiting, lane.assembly)
                self._store.keep(asset, assembly=closed.assembly, quality=self._reception.quality(asset))
        except BaseException as error:
            if getattr(error, "unknown", False):
                self._unanswered[asset] = written
            elif before is None:
                delete_file(written.path)  # of no window now
            raise
        self._unanswered.pop(asset, None)
        if kept is None or kept.file != written.path.name:
            delete_file(written.path)
        if kept is None:
            entry = Entry(start_ns=segment.start_ns, segment=segment.without_frames(_fault(TOO_MANY)))
        else:
            (entry,) = entries_of(self._windows, [kept])
        closed.journey.kept_ns, entry.journey = later_time_ns(), closed.journey
        self._lanes.put(asset, entry, closed.assembly)

    # -- bounds --------------------------------------------------------------------------------------

    def _make_room(self, lane: Lane) -> None:
        """Leaves windows out until one more of an asset has room."""
        limits, lanes = self._limits, self._lanes
        while lanes.backlog(lane.asset) >= limits.windows or lane.bytes >= limits.bytes:
            if not lanes.shed(lane.asset, _refusal):
                break
        while lanes.total_backlog >= limits.total_windows or lanes.total_bytes >= limits.total_bytes:
            if not lanes.shed(lanes.most_waiting(), _refusal):
                break

    def _leave_out_pending(self) -> None:
        """The oldest window in memory, of the asset that takes most there, loses its frames and keeps its place."""
        sizes = {asset: sum(c.segment.nbytes for c in pending) for asset, pending in self._pending.items()}
        asset = max(sizes, key=lambda name: sizes[name])
        pending = self._pending[asset]
        place = next(i for i, closed in enumerate(pending) if closed.segment.nbytes)
        closed = pending[place]
        self._held -= closed.segment.nbytes
        pending[place] = replace(closed, segment=closed.segment.without_frames(_fault(NOT_STORED)))
        log.warning("%s: %s", asset, NOT_STORED, extra={"asset": asset})


def entries_of(windows: WindowJobs, waiting: Iterable[WaitingWindow]) -> list[Entry]:
    """Windows that wait on disk as places in an asset's lane."""
    return [Entry(start_ns=w.start_ns, number=w.id, file=windows.path_of(w), bytes=w.bytes) for w in waiting]


def _refusal(entry: Entry) -> Window:
    """A window on disk that is left out."""
    return Window(start_time_ns=entry.start_ns, faults=(_fault(TOO_MANY),), quality="refused")


def _fault(reason: str) -> Fault:
    """Why a window is refused whose frames are left out."""
    return Fault(kind=SHED, channel="all", count=1, action="refused", detail=reason)
