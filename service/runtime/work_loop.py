"""Whoever computes: takes assets of which a job waits, one after the other, and carries the job out.

    loop.run(watch)       until `ended` is set

Any number of loops, in any number of processes, share the tables and nothing else. Each asset is claimed by one of them
while it is at work on it; what waits is a row, so that nobody hands anything out.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from service.errors import StoreError
from service.results.at_work import AtWork
from service.results.commit_watch import CommitWatch
from service.results.jobs import Jobs
from service.runtime.work import Work

log = logging.getLogger(__name__)

LOOK_EVERY = 1.0  # for jobs of which nothing was noticed, and those that have waited for another worker [s]
FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0  # between two attempts to commit [s]
STOPPED_PAUSE = 60.0  # between two attempts to go on with an asset that is damaged [s]


class WorkLoop:
    """One of those who compute.

    name      who it is, the same after a restart
    searches  whether it carries out jobs that lead to a search for effects, which may take long
    at        called with the asset that is being worked on, and None afterwards
    stuck     called with why nothing can be read or committed now, and None once it can
    """

    def __init__(
        self,
        work: Work,
        jobs: Jobs,
        claims: AtWork,
        name: str,
        *,
        searches: bool = True,
        at: Callable[[str | None], object] = lambda asset: None,
        stuck: Callable[[StoreError | None], object] = lambda why: None,
    ) -> None:
        self._work, self._jobs, self._claims, self._name, self._searches = work, jobs, claims, name, searches
        self._at, self._stuck = at, stuck
        self._unstored: str | None = None  # the asset of which something is to be committed
        self._stopped: dict[str, float] = {}  # assets that are damaged, and until when nothing is done of them
        self.ended = threading.Event()

    def run(self, watch: CommitWatch) -> None:
        """Works until ended."""
        pause = FIRST_PAUSE
        while not self.ended.is_set():
            try:
                if not self.turn():
                    watch.wait(LOOK_EVERY)
                if pause != FIRST_PAUSE:
                    self._stuck(None)
                pause = FIRST_PAUSE
            except (StoreError, OSError) as error:  # whoever receives frames says it
                log.debug("nothing can be read or committed now: %s", error)
                self._stuck(error if isinstance(error, StoreError) else StoreError(str(error)))
                self.ended.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)
            except MemoryError:
                raise
            except Exception as error:
                log.warning("no job can be carried out now: %r", error, exc_info=error)
                self._stuck(StoreError(f"{type(error).__name__}: {error}"))
                self.ended.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)

    def turn(self) -> bool:
        """Carries one job out; False where there is none for this loop now.

        StoreError or OSError where it cannot be committed now: the next turn goes on with it.
        """
        if self._unstored is not None:
            return self._carry_out(self._unstored)
        for asset in self._jobs.due(self._name, searches=self._searches):
            if not self._pauses(asset) and self._claims.take(asset) and self._carry_out(asset):
                return True
        return False

    def _pauses(self, asset: str) -> bool:
        """Whether an asset is damaged, and was looked at a moment ago."""
        return time.monotonic() < self._stopped.get(asset, float("-inf"))

    def _carry_out(self, asset: str) -> bool:
        """Carries out a job of an asset that is claimed; whether it has ended, or is another's by now."""
        self._unstored = None
        try:
            self._at(asset)
            turned = self._work.turn(asset, hand_back=not self._searches)
            if turned.unstored is not None:
                self._unstored = asset
                raise turned.unstored
            if turned.search:
                self._jobs.hand_on(asset)
        except MemoryError:  # the process ends, and what it was at stays to be seen
            raise
        except BaseException:
            self._leave(asset)
            raise
        self._leave(asset)
        if turned.stopped is not None:
            self._stopped[asset] = time.monotonic() + STOPPED_PAUSE
        return turned.job is not None or turned.search

    def _leave(self, asset: str) -> None:
        """Gives an asset back, unless something of it is still to be committed."""
        if self._unstored is None:
            self._at(None)
            self._claims.give_back(asset)
