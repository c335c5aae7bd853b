"""Which assets have jobs that wait: one job of an asset is carried out at a time, those of several assets side by side.

turns.wake(asset)      something of it may wait by now
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

from service.runtime.computing import Computing, Turn, Turned
from service.runtime.storage_watch import StorageWatch

log = logging.getLogger(__name__)


class Turns:
    """The turns of all assets. Driven by one thread.

    done   called with what was done, where a job has ended or waits for people
    timed  called with what was asked of a twin and how long its parts took [s]
    """

    def __init__(
        self,
        computing: Computing,
        storage: StorageWatch,
        done: Callable[[Turned], None],
        timed: Callable[[str, Mapping[str, float]], object] = lambda verb, parts: None,
    ) -> None:
        self._computing, self._storage, self._done, self._timed = computing, storage, done, timed
        self._busy: dict[str, bool] = {}  # assets at work, and whether something more may wait of them
        self._later: set[str] = set()  # assets whose turn waits for the storage ...
        self._trial: str | None = None  # ... and the one by whose turn it is seen whether that can be used again
        self.stopped: list[tuple[str, str]] = []  # assets of which nothing more is done, and why ...
        self._over: set[str] = set()  # ... until the next start
        self._tried: dict[str, int] = {}  # by asset: the job of which nobody knows whether it was committed
        self.faults = 0  # of the program, each of which cost a job

    def wake(self, *assets: str) -> None:
        """Something of these assets may wait to be done."""
        for asset in assets:
            if asset in self._over:
                continue
            if asset in self._busy:
                self._busy[asset] = True
            elif self._storage.reason is not None:
                self._later.add(asset)
            else:
                self._start(asset)

    def retry(self) -> bool:
        """Goes on with the assets that waited for the storage, one after the other; whether none waits any more."""
        while self._later and (self._trial is None or self._storage.reason is None):
            self._trial = min(self._later)
            self._later.remove(self._trial)
            self._start(self._trial)
        return not self._later and self._trial is None

    def _start(self, asset: str) -> None:
        self._busy[asset] = False
        self._computing.start(Turn(asset=asset, tried=self._tried.pop(asset, 0)), self._turned)

    def at_work(self, asset: str) -> bool:
        """Whether a job of an asset is being carried out."""
        return asset in self._busy

    def _turned(self, turned: Turned) -> None:
        asset = turned.asset
        more = self._busy.pop(asset) or turned.more
        self._trial = None if asset == self._trial else self._trial
        if turned.parts:
            self._timed(turned.verb, turned.parts)
        if turned.stopped is not None:
            self.stopped.append((asset, turned.stopped))
            self._over.add(asset)
            log.error("%s", turned.stopped, extra={"asset": asset})
            return
        if turned.unstored is not None:
            self._storage.failed(turned.unstored)
            self._tried[asset] = turned.job or 0
            self._later.add(asset)
            return
        if turned.job is not None:
            self.faults += turned.fault
            self._done(turned)
        if more:
            self.wake(asset)
