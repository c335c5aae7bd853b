"""What a service of `Type=notify` tells systemd: that it is ready, that it is alive, that it ends (sd_notify(3)).

Outside of systemd nothing is told to anybody.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable

from service.operation.health import Health

_WAIT = 0.2  # how long a line may wait for systemd to read earlier ones: the loop that answers HTTP tells it [s]
READY, STOPPING, ALIVE = "READY=1", "STOPPING=1", "WATCHDOG=1"


def notify(*lines: str) -> bool:
    """Tells systemd something; False where it is not asked for, or cannot be told."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    if address.startswith("@"):  # of the abstract namespace
        address = f"\0{address[1:]}"
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as to:
            to.settimeout(_WAIT)
            to.connect(address)
            to.sendall("\n".join(lines).encode())
    except OSError:
        return False
    return True


class Watchdog:
    """Tells systemd that the service is alive, as often as it asks for, while no loop is late.

    tell  passes lines on to it
    """

    def __init__(
        self,
        health: Health,
        tell: Callable[..., object] = notify,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._health, self._tell, self._clock = health, tell, clock
        self._every = watchdog_pause()
        self._next = 0.0

    def __call__(self) -> None:
        """Called with every turn of a loop."""
        if self._every is None or self._clock() < self._next:
            return
        self._next = self._clock() + self._every
        if not self._health.late():
            self._tell(ALIVE)


def watchdog_pause() -> float | None:
    """How often systemd wants to be told: a third of its limit [s]; None where it does not.

    Its service is this process, or the one that has forked it.
    """
    if os.environ.get("WATCHDOG_PID", str(os.getpid())) not in map(str, (os.getpid(), os.getppid())):
        return None
    try:
        limit = int(os.environ.get("WATCHDOG_USEC", "0")) / 1e6
    except ValueError:
        return None
    return limit / 3 if limit > 0 else None
