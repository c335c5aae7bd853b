"""The thread that writes raw signals, so that no window waits for the disk.

A window is offered after it has been committed and published. Where the disk is slower than the stream, or full,
windows are left out, counted and logged: raw signals are for looking at, and results do not depend on them. A process
that is killed loses the signals that still wait here, and nothing else.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Mapping

from service.results.signal_store import SignalStore
from service.runtime.pipeline import WindowOutcome
from twin.windows import Window

log = logging.getLogger(__name__)

WAITING_BYTES = 256 * 2**20  # windows that wait to be written, together
END_WAIT = 5.0  # how long those are waited for at the end [s]


class SignalWriter:
    """Windows on their way into a `SignalStore`."""

    def __init__(self, store: SignalStore, waiting_bytes: int = WAITING_BYTES) -> None:
        self._store, self._room = store, waiting_bytes
        self._queue: queue.SimpleQueue[WindowOutcome | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting = self._windows = 0  # bytes and windows in the queue
        self._left_out = 0
        self._thread = threading.Thread(target=self._write, name="signals", daemon=True)
        self._thread.start()

    def offer(self, outcome: WindowOutcome) -> None:
        """Hands a committed window over; never waits."""
        size = bytes_of(outcome.window)
        with self._lock:
            if self._windows and self._waiting + size > self._room:
                self._leave_out(outcome, "the disk is slower than the stream")
                return
            self._waiting += size
            self._windows += 1
        self._queue.put(outcome)

    def end(self) -> None:
        """Writes what waits, as far as that takes no more than a few seconds."""
        self._queue.put(None)
        self._thread.join(END_WAIT)

    def gauges(self) -> Mapping[str, float]:
        """Figures of the process for /metrics."""
        return {"signal_windows_waiting": self._windows, "signal_windows_left_out": self._left_out}

    def _write(self) -> None:
        while (outcome := self._queue.get()) is not None:
            try:
                self._store.keep(
                    outcome.asset,
                    outcome.index,
                    outcome.window,
                    revolutions=outcome.record.get("revolutions"),
                    found=any(kind == "effect" for kind, _ in outcome.events),
                )
            except OSError as error:
                with self._lock:
                    self._leave_out(outcome, error.strerror or str(error))
            finally:
                with self._lock:
                    self._waiting -= bytes_of(outcome.window)
                    self._windows -= 1

    def _leave_out(self, outcome: WindowOutcome, reason: str) -> None:
        self._left_out += 1
        log.warning("%s: the raw signals of window %d are not kept: %s", outcome.asset, outcome.index, reason)


def bytes_of(window: Window) -> int:
    """What a window's channels take in memory."""
    samples = (*window.accelerations.values(), *window.torques.values())
    return sum(s.values.nbytes for s in samples) + sum(e.times.nbytes for e in window.encoders.values())
