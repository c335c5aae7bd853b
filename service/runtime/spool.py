"""Windows that have closed are made durable before anything else becomes of them.

The window's file, what names it in the database, and where its asset's stream goes on after it are one transaction.
From then on the window is acknowledged, and no end of the process loses it. It waits until its asset's turn comes;
the transaction that commits its results ends the wait.
"""

from __future__ import annotations

import logging

from service.results.asset_life import AssetLife
from service.results.store import ResultStore
from service.runtime.lane import Entry
from service.runtime.lanes import Lanes
from service.runtime.outcomes import ClosedWindow
from service.runtime.reception import Reception

log = logging.getLogger(__name__)

NO_ROOM = "there was no room to keep this window until its turn: too many windows of the asset wait"


class Spool:
    """Where closed windows of all assets wait for their turn."""

    def __init__(self, life: AssetLife, store: ResultStore) -> None:
        self._life, self._store = life, store

    def add(self, closed: ClosedWindow, reception: Reception, lanes: Lanes) -> None:
        """Keeps a window, and hands it to its asset's lane."""
        asset, window = closed.asset, closed.window
        lanes.of(asset)
        with self._life.transaction():
            kept = self._life.add_waiting(asset, window)
            self._store.keep(asset, assembly=closed.assembly, quality=reception.quality(asset))
            newest = self._life.waiting(asset)[-1] if kept else None
        if newest is None:
            log.warning("%s: %s", asset, NO_ROOM, extra={"asset": asset})
            entry = Entry(start_ns=window.start_time_ns, window=window, refuse=NO_ROOM)
        else:
            file = self._life.file_of(newest.id)
            entry = Entry(start_ns=newest.start_ns, number=newest.id, file=file, bytes=newest.bytes)
        lanes.put(asset, entry, closed.assembly)

    def waiting(self, asset: str) -> list[Entry]:
        """The windows of an asset that an earlier run of the service has left, in order."""
        return [
            Entry(start_ns=w.start_ns, number=w.id, file=self._life.file_of(w.id), bytes=w.bytes)
            for w in self._life.waiting(asset)
        ]
