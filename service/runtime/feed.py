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

LOOK_EVERY = 0.5  # whether the thread is to end, and again after a failure [s]
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
        self._behind = False  # whether a look has failed since the latest

    def run(self) -> None:
        with self._store.database.watching() as watch:
            while not self._ended.is_set():
                noticed = watch.wait(LOOK_EVERY)
                if noticed is None and not self._behind:
                    continue
                try:
                    self.turn(noticed or SOMETHING)
                except Exception as error:  # whatever it is, the next look finds what there is
                    if not isinstance(error, StoreError):  # which whoever keeps windows says
                        log.warning("what was committed cannot be looked at: %r", error, exc_info=error)
                    self._ended.wait(LOOK_EVERY)
                for each in self._on_commit:
                    each(noticed or SOMETHING)

    def turn(self, noticed: Noticed) -> None:
        """Takes note of what was noticed, and looks for what was not."""
        if noticed.missed:
            self._table.changed()
        self._table.take(noticed.shown)
        if noticed.look or self._behind:
            self._behind = True
            self._table.look()
            self._behind = False

    def end(self) -> None:
        """Ends the thread."""
        self._ended.set()
        if self.is_alive():
            self.join(STOP_WAIT)
