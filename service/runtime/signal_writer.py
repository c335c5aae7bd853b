"""The thread that keeps raw signals, so that no window waits for the disk.

A window is offered after it has been committed and published. The file in which it waited for its turn becomes the one
that is kept. Where the disk is slower than the stream, or full, windows are left out, counted and logged: raw signals
are for looking at, and results do not depend on them. A process that is killed loses the signals that still wait here,
and nothing else.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Mapping
from pathlib import Path

from service.results.signal_store import SignalStore
from service.results.window_jobs import delete_file
from service.runtime.outcomes import Outcome

log = logging.getLogger(__name__)

WAITING_BYTES = 256 * 2**20  # files that wait to be moved, together
END_WAIT = 5.0  # how long those are waited for at the end [s]


class SignalWriter:
    """Windows on their way into a `SignalStore`."""

    def __init__(self, store: SignalStore, waiting_bytes: int = WAITING_BYTES) -> None:
        self._store, self._room = store, waiting_bytes
        self._queue: queue.SimpleQueue[tuple[Outcome, Path, int] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting = self._windows = 0  # bytes and windows in the queue
        self._left_out = 0
        self.thread = threading.Thread(target=self._write, name="signals", daemon=True)
        self.thread.start()

    def offer(self, outcome: Outcome) -> None:
        """Hands a committed window over, with the file in which it was kept until then; never waits."""
        file = outcome.file
        if file is None:
            return
        size = _size(file)
        with self._lock:
            left_out = self._windows > 0 and self._waiting + size > self._room
            if left_out:
                self._leave_out(outcome, "the disk is slower than the stream")
            else:
                self._waiting += size
                self._windows += 1
        if not left_out:
            self._queue.put((outcome, file, size))
        else:
            delete_file(file)

    def end(self) -> None:
        """Moves what waits, as far as that takes no more than a few seconds."""
        self._queue.put(None)
        self.thread.join(END_WAIT)

    def figures(self) -> Mapping[str, float]:
        """Figures of the process for /metrics."""
        return {"signal_windows_waiting": self._windows, "signal_windows_left_out": self._left_out}

    def _write(self) -> None:
        while (item := self._queue.get()) is not None:
            outcome, file, size = item
            try:
                if outcome.signals:
                    self._keep(outcome, file)
            except OSError as error:
                with self._lock:
                    self._leave_out(outcome, getattr(error, "strerror", None) or str(error))
            finally:
                delete_file(file)
                with self._lock:
                    self._waiting -= size
                    self._windows -= 1

    def _keep(self, outcome: Outcome, file: Path) -> None:
        window = outcome.window
        assert window is not None
        self._store.keep(
            outcome.asset,
            outcome.index,
            file,
            window.start_time_ns,
            revolutions=outcome.record.get("revolutions"),
            found=any(kind == "effect" for kind, _ in outcome.events),
            refused=window.quality == "refused",
        )

    def _leave_out(self, outcome: Outcome, reason: str) -> None:
        self._left_out += 1
        log.warning(
            "%s: the raw signals of window %d are not kept: %s",
            outcome.asset,
            outcome.index,
            reason,
            extra={"asset": outcome.asset},
        )


def _size(file: Path) -> int:
    """What a file takes [bytes]; 0 where there is none."""
    try:
        return file.stat().st_size
    except OSError:
        return 0
