"""The thread of a process that notices what others commit, and wakes whoever waits for it in this process."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from service.errors import StoreError
from service.results.asset_table import AssetTable
from service.results.commit_watch import SOMETHING, Noticed
from service.results.sql_store import SqlStore

log = logging.getLogger(__name__)

LOOK_EVERY = 0.5  # whether the thread is to end, and for what was not noticed [s]
STOP_WAIT = 3.0  # [s]


OnCommit = Callable[[Noticed], object]
"""Called where something was committed."""


class Feed(threading.Thread):
    """Looks at the table whenever something has been committed, until ended.

    on_commit  are called then
    """

    def __init__(self, store: SqlStore, table: AssetTable, *on_commit: OnCommit) -> None:
        super().__init__(name="feed", daemon=True)
        self._store, self._table, self._on_commit, self._ended = store, table, on_commit, threading.Event()

    def run(self) -> None:
        with self._store.database.watching() as watch:
            missed = False
            while not self._ended.is_set():
                noticed = watch.wait(LOOK_EVERY)
                if noticed is None and not (watch.misses or missed):
                    continue
                missed = True
                try:
                    found = self._take(noticed or SOMETHING)
                    missed = False
                except StoreError as error:  # whoever keeps windows says it
                    log.debug("what was committed is looked at later: %s", error)
                    found = self._ended.wait(LOOK_EVERY)
                except Exception as error:  # whatever it is, the next look finds what there is
                    log.warning("what was committed cannot be looked at: %r", error, exc_info=error)
                    found = self._ended.wait(LOOK_EVERY)
                for each in self._on_commit if found or noticed is not None else ():
                    each(noticed or SOMETHING)

    def _take(self, noticed: Noticed) -> bool:
        """Looks at what has changed; whether any asset is shown otherwise."""
        if noticed.missed:
            self._table.changed()
            return True
        return bool(self._table.look() if noticed.shown is None else self._table.take(noticed.shown))

    def end(self) -> None:
        """Ends the thread."""
        self._ended.set()
        if self.is_alive():
            self.join(STOP_WAIT)
