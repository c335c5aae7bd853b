"""The thread that keeps raw signals, so that no window waits for the disk.

A window is offered after it has been committed and published. The file in which it waited for its turn becomes the one
that is kept; it is written again only where the window has other faults than its file says, by the rig file. Where the
disk is slower than the stream, or full, windows are left out, counted and logged: raw signals are for looking at, and
results do not depend on them. A process that is killed loses the signals that still wait here, and nothing else.
"""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from service.results.signal_store import SignalStore
from service.results.window_file import read_window
from service.runtime.outcomes import Outcome
from twin.windows import Window

log = logging.getLogger(__name__)

WAITING_BYTES = 256 * 2**20  # windows that wait to be written, together
END_WAIT = 5.0  # how long those are waited for at the end [s]


class SignalWriter:
    """Windows on their way into a `SignalStore`."""

    def __init__(self, store: SignalStore, waiting_bytes: int = WAITING_BYTES) -> None:
        self._store, self._room = store, waiting_bytes
        self._queue: queue.SimpleQueue[tuple[Outcome, Path | None, int] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting = self._windows = 0  # bytes and windows in the queue
        self._left_out = 0
        self.thread = threading.Thread(target=self._write, name="signals", daemon=True)
        self.thread.start()

    def offer(self, outcome: Outcome, file: Path | None = None) -> None:
        """Hands a committed window over, with the file in which it was kept until then; never waits."""
        size = _size(file) if file is not None else 0 if outcome.window is None else bytes_of(outcome.window)
        with self._lock:
            left_out = self._windows > 0 and self._waiting + size > self._room
            if left_out:
                self._leave_out(outcome, "the disk is slower than the stream")
            else:
                self._waiting += size
                self._windows += 1
        if not left_out:
            self._queue.put((outcome, file, size))
        elif file is not None:
            _delete(file)

    def end(self) -> None:
        """Writes what waits, as far as that takes no more than a few seconds."""
        self._queue.put(None)
        self.thread.join(END_WAIT)

    def figures(self) -> Mapping[str, float]:
        """Figures of the process for /metrics."""
        return {"signal_windows_waiting": self._windows, "signal_windows_left_out": self._left_out}

    def _write(self) -> None:
        while (item := self._queue.get()) is not None:
            outcome, file, size = item
            try:
                self._keep(outcome, file)
            except (OSError, ValueError, KeyError) as error:
                with self._lock:
                    self._leave_out(outcome, getattr(error, "strerror", None) or str(error))
            finally:
                if file is not None:
                    _delete(file)
                with self._lock:
                    self._waiting -= size
                    self._windows -= 1

    def _keep(self, outcome: Outcome, file: Path | None) -> None:
        window = outcome.window
        assert window is not None
        if file is not None and outcome.raw == "nothing":
            return
        if file is not None and outcome.raw == "other faults":
            window, file = replace(read_window(file), faults=window.faults, quality=window.quality), None
        self._store.keep(
            outcome.asset,
            outcome.index,
            window,
            revolutions=outcome.record.get("revolutions"),
            found=any(kind == "effect" for kind, _ in outcome.events),
            file=file,
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


def _delete(file: Path) -> None:
    """Deletes a file that is not needed any more; what cannot be deleted now is deleted by the next start."""
    try:
        file.unlink(missing_ok=True)
    except OSError as error:
        log.warning("%s cannot be deleted: %s", file, error.strerror or error)


def bytes_of(window: Window) -> int:
    """What a window's channels take in memory."""
    samples = (*window.accelerations.values(), *window.torques.values())
    return sum(s.values.nbytes for s in samples) + sum(e.times.nbytes for e in window.encoders.values())
