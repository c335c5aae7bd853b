"""Which windows wait to be assessed, since when and behind which machines: shown where that has changed."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

from service.results.asset_table import AssetTable
from service.results.snapshot import Snapshot, Waiting
from service.results.window_jobs import Backlog
from service.runtime.backlogs import Backlogs
from service.runtime.questions import ALL_WAIT
from service.runtime.workers import Workers

LOOK_EVERY = 1.0  # [s]
SHOWN_AFTER = 2.0  # how long the oldest window has waited before it is said to wait [s]


class BacklogWatch:
    """Called between frames."""

    def __init__(
        self,
        backlogs: Backlogs,
        workers: Workers,
        table: AssetTable,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._backlogs, self._workers, self._table = backlogs, workers, table
        self._clock, self._looked = clock, float("-inf")
        self._shown = {snapshot.asset for snapshot in table.every() if snapshot.waiting is not None}

    def __call__(self) -> None:
        """Looks at what waits, if that is due."""
        now = self._clock()
        if now - self._looked < LOOK_EVERY:
            return
        self._looked = now
        at_work, reason = frozenset(map(self._named, self._workers.at_work())), self._workers.unusable()
        for asset in {*self._backlogs.all, *self._shown}:
            shown = self._table.latest(asset)
            found = waiting_of(self._backlogs.of(asset), shown, self._named(asset), at_work, reason)
            if shown is not None and shown.waiting != found:
                self._table.note(asset, waiting=found)
            (self._shown.discard if found is None else self._shown.add)(asset)

    def _named(self, asset: str) -> str:
        shown = self._table.latest(asset)
        return asset if shown is None else shown.name


def waiting_of(
    backlog: Backlog, shown: Snapshot | None, name: str, at_work: Collection[str], reason: str | None = None
) -> Waiting | None:
    """What waits of an asset; None where nothing has waited for long. Windows that wait for people do not count.

    name     of the asset
    at_work  the names of the assets whose twins compute now
    reason   why none can compute; None where they can
    """
    question = None if shown is None else shown.question
    all_wait = question is not None and question["kind"] in ALL_WAIT
    if backlog.since_ns is None or all_wait or backlog.lag < SHOWN_AFTER:
        return None
    behind = () if name in at_work else tuple(sorted(at_work))
    return Waiting(windows=backlog.windows, since_ns=backlog.since_ns, behind=behind, reason=reason)
