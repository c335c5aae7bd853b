"""What front ends have written for a partition is looked at as soon as they say so: notifications of PostgreSQL."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from service.alarms.keeper import AlarmKeeper
from service.errors import StoreError
from service.fleet.databases import url_of
from service.fleet.naming import PartitionStreams
from service.fleet.notices import DISMISSED, NAMED, channel_of
from service.results.job_queue import ALARM, ASSET
from service.runtime.worker import Kept

log = logging.getLogger(__name__)

LOOK_EVERY = 5.0  # without a notification [s]
PAUSE = 1.0  # after a connection was lost [s]
STOP_WAIT = 3.0  # [s]


class Listener(threading.Thread):
    """Wakes a partition's worker, until ended.

    look     called after each notification: the worker looks at what waits
    propose  makes a rig file that was offered for an asset a proposal
    streams  of the partition: read again when a name has been given that hashes to another one
    """

    def __init__(
        self,
        database: str,
        partition: int,
        kept: Kept,
        alarms: AlarmKeeper,
        look: Callable[[], None],
        propose: Callable[[str, Mapping[str, Any]], None],
        streams: PartitionStreams,
    ) -> None:
        super().__init__(name="listener", daemon=True)
        self._url = url_of(database).set(drivername="postgresql").render_as_string(hide_password=False)
        self._partition, self._kept, self._alarms, self._look = partition, kept, alarms, look
        self._propose, self._streams, self._names_given = propose, streams, True
        self._stopping = threading.Event()

    def run(self) -> None:
        """Listens until ended; everything is looked at after each new connection."""
        import psycopg

        while not self._stopping.is_set():
            try:
                with psycopg.connect(self._url, autocommit=True, connect_timeout=5) as connection:
                    connection.execute(f"LISTEN {channel_of(self._partition)}")
                    self._listen(connection)
            except psycopg.Error as error:
                log.debug("the notifications of partition %d: %s", self._partition, error)
            except Exception as error:  # whatever it is, the next connection looks at everything
                log.warning(
                    "a notification of partition %d could not be followed: %r", self._partition, error, exc_info=error
                )
            self._stopping.wait(PAUSE)

    def end(self) -> None:
        """Ends the thread."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOP_WAIT)

    def _listen(self, connection: object) -> None:
        from psycopg import Connection as Session

        assert isinstance(connection, Session)
        look_at = 0.0
        self._names_given = True
        while not self._stopping.is_set():
            if time.monotonic() >= look_at:
                self._look_at_all()
                look_at = time.monotonic() + LOOK_EVERY
            for said in connection.notifies(timeout=0.5, stop_after=1):
                what, _, asset = said.payload.partition(" ")
                self._take_up(what, asset)
                self._look()

    def _look_at_all(self) -> None:
        """What notifications that were lost would have said."""
        kept = self._kept
        kept.queue.asked.set()
        try:
            self._read_names()
            for asset in kept.store.assets():
                self._show_new(asset)
        except StoreError as error:
            log.debug("the assets of partition %d are looked for later: %s", self._partition, error)
        self._look()

    def _take_up(self, what: str, asset: str) -> None:
        """What a front end has written concerns an asset."""
        kept = self._kept
        try:
            if what == ALARM:
                kept.told(what, asset)
            elif what == ASSET:
                self._show_new(asset)
            elif what == DISMISSED:
                kept.unknown.dismiss(asset)
            elif what == NAMED:
                self._names_given = True
                self._read_names()
            else:
                kept.queue.asked.set()
        except StoreError as error:  # whoever keeps windows says it; the next look finds what is there
            log.debug("what was announced of %s waits: %s", asset, error)

    def _read_names(self) -> None:
        if self._names_given:
            self._streams.read(self._kept.store.database)
            self._names_given = False

    def _show_new(self, asset: str) -> None:
        """An asset that a front end has created is one of the partition's from now on."""
        kept = self._kept
        if kept.table.latest(asset) is None and asset in kept.store.assets():
            adopted = kept.unknown.find(asset)
            kept.told(ASSET, asset)
            if kept.store.asset(asset).rig is None and adopted is not None and adopted.rig is not None:
                self._propose(asset, adopted.rig)
