"""Which windows wait to be assessed, since when and behind which machines: shown where that has changed."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

from service.results.asset_table import AssetTable
from service.results.snapshot import Waiting
from service.runtime.computing import Computing
from service.runtime.lane import Lane
from service.runtime.lanes import Lanes
from service.runtime.state_publication import StatePublication

LOOK_EVERY = 1.0  # [s]
SHOWN_AFTER = 2.0  # how long the oldest window has waited before it is said to wait [s]


class BacklogWatch:
    """Called between frames."""

    def __init__(
        self,
        lanes: Lanes,
        computing: Computing,
        table: AssetTable,
        publication: StatePublication,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._lanes, self._computing, self._table, self._publication = lanes, computing, table, publication
        self._clock, self._looked = clock, float("-inf")

    def __call__(self) -> None:
        """Looks at what waits, if that is due."""
        now = self._clock()
        if now - self._looked < LOOK_EVERY:
            return
        self._looked = now
        at_work, reason = frozenset(map(self._named, self._computing.at_work())), self._computing.unusable()
        for lane in self._lanes.all():
            shown = self._table.latest(lane.asset)
            found = waiting_of(lane, self._named(lane.asset), at_work, reason)
            if shown is not None and shown.waiting != found:
                self._table.note(lane.asset, waiting=found)
                self._publication.publish(lane.asset)

    def _named(self, asset: str) -> str:
        shown = self._table.latest(asset)
        return asset if shown is None else shown.name


def waiting_of(lane: Lane, name: str, at_work: Collection[str], reason: str | None = None) -> Waiting | None:
    """What waits in an asset's lane; None where nothing has waited for long. Windows that wait for people do not count.

    name     of the asset
    at_work  the names of the assets whose twins compute now
    reason   why none can compute; None where they can
    """
    entry = lane.next_entry()
    if entry is None or lane.all_wait or entry.journey.waited < SHOWN_AFTER:
        return None
    behind = () if name in at_work else tuple(sorted(at_work))
    waiting = len(lane.entries) - lane.held
    return Waiting(windows=waiting, since_ns=entry.journey.closed_ns, behind=behind, reason=reason)
