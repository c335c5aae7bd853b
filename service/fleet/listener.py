"""What front ends have written for a partition is looked at as soon as they say so: notifications of PostgreSQL."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import sqlalchemy as sa
from sqlalchemy import Connection

from service.alarms.keeper import AlarmKeeper
from service.fleet.databases import url_of
from service.runtime.worker import Kept

log = logging.getLogger(__name__)

LOOK_EVERY = 5.0  # without a notification [s]
PAUSE = 1.0  # after a connection was lost [s]
STOP_WAIT = 3.0  # [s]
DECISION, CHANGE, ALARM = "decision", "change", "alarm"


def channel_of(partition: int) -> str:
    """The channel on which a partition's worker listens."""
    return f"gear_twin_{partition:03d}"


def announce(db: Connection, partition: int, what: str, asset: str) -> None:
    """Says, with the present transaction, that something waits for a partition's worker."""
    db.execute(sa.text("SELECT pg_notify(:on, :said)"), {"on": channel_of(partition), "said": f"{what} {asset}"})


class Listener(threading.Thread):
    """Wakes a partition's worker, until ended.

    look  called after each notification: the worker looks at what waits
    """

    def __init__(
        self, database: str, partition: int, kept: Kept, alarms: AlarmKeeper, look: Callable[[], None]
    ) -> None:
        super().__init__(name="listener", daemon=True)
        self._url = url_of(database).set(drivername="postgresql").render_as_string(hide_password=False)
        self._partition, self._kept, self._alarms, self._look = partition, kept, alarms, look
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
        while not self._stopping.is_set():
            if time.monotonic() >= look_at:
                self._kept.decisions.asked.set()
                self._kept.changes.asked.set()
                self._look()
                look_at = time.monotonic() + LOOK_EVERY
            for said in connection.notifies(timeout=0.5, stop_after=1):
                what, _, asset = said.payload.partition(" ")
                if what == ALARM:
                    self._alarms.changed(asset)
                (self._kept.decisions if what == DECISION else self._kept.changes).asked.set()
                self._look()
