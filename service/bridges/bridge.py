"""What all bridges have in common: a thread of their own that tries again, and that nothing waits for.

A bridge reads the table's latest states and never holds the service up. A connection that fails or is lost is tried
again with growing pauses; each cause is logged once, every failure is counted.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

log = logging.getLogger(__name__)

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 60.0  # between attempts; it doubles [s]
STEADY = 60.0  # a connection that has lasted so long begins with the first pause again [s]
STOP_WAIT = 3.0  # how long a bridge is waited for at the end [s]
LOOK_EVERY = 0.5  # how often a bridge without changes looks whether it should end [s]


class BridgeDown(Exception):
    """The other side cannot be reached, or has been lost; trying again later may succeed."""


class Bridge(Protocol):
    """One connection to another network."""

    @property
    def name(self) -> str:
        """What it is called in log and metrics."""
        ...

    @property
    def peer(self) -> str:
        """Where it connects to, or listens at; without secrets."""
        ...

    def serve(self, stopping: threading.Event, up: Callable[[], None]) -> None:
        """Works until `stopping` is set, and calls `up` once it is connected. BridgeDown where it cannot go on."""
        ...

    def figures(self) -> Mapping[str, Any]:
        """Figures for /metrics, by name."""
        ...


class BridgeThread(threading.Thread):
    """Keeps one bridge at work until ended."""

    def __init__(
        self, bridge: Bridge, *, first_pause: float = FIRST_PAUSE, clock: Callable[[], float] = time.monotonic
    ):
        super().__init__(name=bridge.name, daemon=True)
        self._bridge, self._first_pause, self._clock = bridge, first_pause, clock
        self._stopping = threading.Event()
        self._connected_at: float | None = None
        self._failures = 0
        self._cause: str | None = None  # that was logged last, and holds

    def run(self) -> None:
        """Works until ended."""
        pause = self._first_pause
        while not self._stopping.is_set():
            self._connected_at = None
            try:
                self._bridge.serve(self._stopping, self._up)
            except BridgeDown as error:
                self._failed(str(error))
            except Exception as error:
                self._failed(f"internal error: {type(error).__name__}: {error}", trace=True)
            if self._connected_at is not None and self._clock() - self._connected_at >= STEADY:
                pause = self._first_pause
            self._connected_at = None
            self._stopping.wait(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def end(self) -> None:
        """Ends the thread."""
        self._stopping.set()
        if self.is_alive():
            self.join(STOP_WAIT)

    def figures(self) -> dict[str, Any]:
        """Figures for /metrics."""
        name = self._bridge.name
        own = {"connected": float(self._connected_at is not None), "failures": float(self._failures)}
        return {f"{name}_{key}": value for key, value in (own | dict(self._bridge.figures())).items()}

    def _up(self) -> None:
        self._connected_at = self._clock()
        again = f" again after {self._failures} failures" if self._failures else ""
        log.info("%s: %s is connected%s", self._bridge.name, self._bridge.peer, again)
        self._cause = None

    def _failed(self, cause: str, trace: bool = False) -> None:
        self._failures += 1
        if cause != self._cause and not self._stopping.is_set():
            self._cause = cause
            log.warning(
                "%s: %s: %s; it is tried again with growing pauses",
                self._bridge.name, self._bridge.peer, cause, exc_info=trace,
            )  # fmt: skip


class Helper(Protocol):
    """A thread that works for a bridge."""

    def start(self) -> None: ...

    def end(self) -> None: ...


class Bridges:
    """All bridges of a service; none where none is set."""

    def __init__(self, bridges: Iterable[Bridge] = (), helpers: Iterable[Helper] = ()) -> None:
        self._threads, self._helpers = tuple(BridgeThread(bridge) for bridge in bridges), tuple(helpers)

    def start(self) -> None:
        """Begins to connect; nothing waits for it."""
        for thread in (*self._helpers, *self._threads):
            thread.start()

    def end(self) -> None:
        """Ends all of them."""
        for thread in (*self._threads, *self._helpers):
            thread.end()

    def figures(self) -> dict[str, Any]:
        """Figures of all of them for /metrics."""
        return {key: value for thread in self._threads for key, value in thread.figures().items()}
