"""Whether the loops of the process are alive: each says so with every turn, and one that has not for long has hung.

    beat = health.loop("reception")
    while True: ...; beat()

`/healthz` and the watchdog of systemd read it. Whether frames can be accepted and stored is what `/readyz` says.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from service.contract.base import iso_time

LIMIT = 120.0  # above the longest wait of a loop for a lock, a server or a disk [s]
READY = 10.0  # time without a turn after which a loop that still may go on takes no frames [s]

HTTP = "HTTP"
RECEPTION = "reception and storage"
FEED = "what others have committed"
WEBHOOKS = "webhooks"
FLEET = "fleet"

LOOPS = {
    HTTP: "answers requests, and tells systemd that the service is alive",
    RECEPTION: "assembles frames to windows, makes them durable and publishes results",
    FEED: "the thread that hears of what other processes have committed",
    WEBHOOKS: "the thread that sends messages about alarms",
    FLEET: "the thread of a front end or of a partition of a fleet that follows what others have written",
}
"""Every loop, and what it does."""


@dataclass(frozen=True, slots=True)
class Late:
    """A loop that has hung or ended."""

    name: str
    since_ns: int  # Unix time of its last turn [ns]

    def __str__(self) -> str:
        return f"{self.name}: no turn since {iso_time(self.since_ns)}"


@dataclass(slots=True)
class _Loop:
    beaten: float  # on the monotonic clock [s]
    thread: threading.Thread | None = field(default=None)


class Health:
    """The loops of one process.

    limit  time without a turn after which a loop is late [s]
    clock  the monotonic clock [s]
    """

    def __init__(self, limit: float = LIMIT, clock: Callable[[], float] = time.monotonic) -> None:
        self._limit, self._clock = limit, clock
        self._loops: dict[str, _Loop] = {}
        self._elsewhere: Callable[[], Sequence[Late]] = tuple

    def loop(self, name: str) -> Callable[[], None]:
        """Expects turns of a loop from now on; what it calls with each."""
        known = self._loops[name] = _Loop(self._clock())

        def beat() -> None:
            known.beaten = self._clock()

        return beat

    def thread(self, name: str, thread: threading.Thread) -> None:
        """Expects a thread to live from now on; how long it waits for its work does not matter."""
        self._loops[name] = _Loop(self._clock(), thread)

    def includes(self, elsewhere: Callable[[], Sequence[Late]]) -> None:
        """The late loops of other processes are among those of this one from now on."""
        self._elsewhere = elsewhere

    def late(self, limit: float | None = None) -> list[Late]:
        """The loops that have hung or ended; within another limit where one is given [s]."""
        now, limit, found = self._clock(), self._limit if limit is None else limit, []
        for name, known in list(self._loops.items()):
            if known.thread is not None and known.thread.is_alive():
                known.beaten = now
            elif known.thread is not None or now - known.beaten > limit:
                found.append(Late(name, time.time_ns() - round((now - known.beaten) * 1e9)))
        return [*found, *self._elsewhere()]
