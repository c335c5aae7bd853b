"""What is said on a channel of a fleet's database, by notifications of PostgreSQL, is followed by a thread."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable

from service.errors import StoreError
from service.fleet.databases import url_of

log = logging.getLogger(__name__)

LOOK_EVERY = 2.0  # without a notification [s]
WAIT = 0.5  # for a notification, and until the thread ends [s]
GATHER = 0.02  # during which notifications are taken together [s]
PAUSE = 1.0  # after the connection was lost [s]
STOP_WAIT = 3.0  # [s]


class Follower(threading.Thread):
    """Follows a channel, until ended; what a notification that was lost would have said is found by looks."""

    def __init__(self, database: str, channel: str, name: str) -> None:
        super().__init__(name=name, daemon=True)
        self._url = url_of(database).set(drivername="postgresql").render_as_string(hide_password=False)
        self._channel, self._stopping = channel, threading.Event()

    def begun(self) -> None:
        """Called after each new connection: anything may have been said before."""

    def look(self) -> None:
        """Called now and then."""

    def take(self, said: Iterable[str]) -> None:
        """Called with what has been said."""

    def lost(self, error: Exception) -> None:
        """Called where the database cannot be used now."""

    def run(self) -> None:
        """Works until ended."""
        import psycopg

        while not self._stopping.is_set():
            try:
                with psycopg.connect(self._url, autocommit=True, connect_timeout=5) as connection:
                    connection.execute(f"LISTEN {self._channel}")
                    self.begun()
                    look_at = 0.0
                    while not self._stopping.is_set():
                        if time.monotonic() >= look_at:
                            self.look()
                            look_at = time.monotonic() + LOOK_EVERY
                        said = [each.payload for each in connection.notifies(timeout=WAIT, stop_after=1)]
                        if said:
                            said += [each.payload for each in connection.notifies(timeout=GATHER)]
                            self.take(dict.fromkeys(said))
            except (psycopg.Error, StoreError) as error:
                log.debug("the notifications on %s: %s", self._channel, error)
                self.lost(error)
            except Exception as error:  # whatever it is, the next connection looks at everything
                log.warning("a notification on %s could not be followed: %r", self._channel, error, exc_info=error)
            self._stopping.wait(PAUSE)

    def end(self) -> None:
        """Ends the thread."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOP_WAIT)
