"""Deletes what is older than it is kept, in small transactions between windows, as long as the service runs."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

from service.errors import StoreError
from service.results.retention import Retention, delete_old
from service.results.sql_store import SqlStore
from service.results.window_jobs import delete_file
from service.settings import Settings

log = logging.getLogger(__name__)

PAUSE = 300.0  # between two looks at all assets [s]
BREATH = 0.05  # between two transactions, in which windows are committed [s]


def retention_of(settings: Settings) -> Retention:
    """How long what is kept."""
    return Retention(
        whole_days=settings.keep_whole_days,
        every=settings.keep_every,
        days=settings.keep_days,
        events=settings.keep_events,
        alarms=settings.keep_alarms,
    )


class RetentionJob(threading.Thread):
    """The thread that keeps the database bounded, with the segments that go with their windows."""

    def __init__(self, store: SqlStore, retention: Retention, segments: Path, pause: float = PAUSE) -> None:
        super().__init__(name="retention", daemon=True)
        self._store, self._retention, self._segments, self._pause = store, retention, segments, pause
        self._stopping = threading.Event()
        self.deleted = 0  # rows since the start

    def run(self) -> None:
        """Looks at all assets again and again, until ended."""
        while not self._stopping.wait(BREATH):
            try:
                for asset in self._store.assets():
                    self._clear(asset)
            except StoreError as error:  # the next look tries again
                log.warning("nothing old could be deleted: %s", error)
            if self._stopping.wait(self._pause):
                return

    def _clear(self, asset: str) -> None:
        while not self._stopping.wait(BREATH):
            count = delete_old(
                self._store.database, asset, self._retention, unnamed=lambda file: delete_file(self._segments / file)
            )
            self.deleted += count
            if not count:
                return

    def end(self) -> None:
        """Ends the thread between two transactions."""
        self._stopping.set()
        if self.is_alive():
            self.join()

    def figures(self) -> dict[str, float]:
        """What `/metrics` says of it."""
        return {"old_rows_deleted": self.deleted}
