"""Turns carried out by threads of this process, for as many assets at once as a twin allows."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping

from service.runtime.computing import Turn, Turned

NAME = "twin"  # how the threads' names begin


class Threads:
    """Turns in the order in which they were asked for, at most so many at once.

    at_once  how many may be carried out at once
    work     carries one out
    wake     called, by any thread, when something is ready to be collected
    """

    def __init__(self, at_once: int, work: Callable[[Turn], Turned], wake: Callable[[], None]) -> None:
        self._work_of, self._wake, self._free = work, wake, at_once
        self._lock = threading.Lock()
        self._calls: queue.SimpleQueue[tuple[Turn, Callable[[Turned], None]]] = queue.SimpleQueue()
        self._made: queue.SimpleQueue[tuple[Callable[[Turned], None], Turned | BaseException]] = queue.SimpleQueue()
        self._ended = False
        self._began: dict[int, tuple[float, str]] = {}  # by thread: when its turn began, monotonic [s], and the asset

    def start(self, turn: Turn, done: Callable[[Turned], None]) -> None:
        """Has a turn carried out; `done` is called by `collect`."""
        self._calls.put((turn, done))
        with self._lock:
            if not self._free or self._ended:
                return
            self._free -= 1
        threading.Thread(target=self._work, name=f"{NAME} of {turn.asset}", daemon=True).start()

    def collect(self) -> None:
        """Hands on what has been made. An exception of the program is raised here, by the thread that collects."""
        while True:
            try:
                done, made = self._made.get_nowait()
            except queue.Empty:
                return
            if isinstance(made, BaseException):
                raise made
            done(made)

    def close(self) -> None:
        """Begins nothing more; what is being carried out is left to itself."""
        self._ended = True

    def unusable(self) -> str | None:
        """Threads do not end by themselves."""
        return None

    def at_work(self) -> tuple[str, ...]:
        """The assets whose turns are being carried out."""
        return tuple(asset for _, asset in self._began.copy().values())

    def figures(self) -> Mapping[str, float]:
        """Figures for /metrics."""
        began = [since for since, _ in self._began.copy().values()]
        return {
            "workers": 0,
            "workers_busy": 0,
            "worker_deaths": 0,
            "worker_servers_replaced": 0,
            "twin_calls_waiting": self._calls.qsize(),
            "twin_call_seconds": max((time.monotonic() - since for since in began), default=0.0),
        }

    def _work(self) -> None:
        while not self._ended:
            with self._lock:
                try:
                    turn, done = self._calls.get_nowait()
                except queue.Empty:
                    self._free += 1
                    return
            self._began[threading.get_ident()] = time.monotonic(), turn.asset
            try:
                made: Turned | BaseException = self._work_of(turn)
            except BaseException as error:
                made = error
            del self._began[threading.get_ident()]
            self._made.put((done, made))
            self._wake()
