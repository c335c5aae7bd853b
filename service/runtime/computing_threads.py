"""Calls to twins carried out by threads of this process, for as many assets at once as a twin allows."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping

from service.runtime.computing import Call, Made, carry_out

NAME = "twin"  # how the threads' names begin


class Threads:
    """Calls in the order in which they were made, at most so many at once.

    at_once  how many calls may be carried out at once
    wake     called, by any thread, when something is ready to be collected
    """

    def __init__(self, at_once: int, wake: Callable[[], None]) -> None:
        self._wake, self._free = wake, at_once
        self._lock = threading.Lock()
        self._calls: queue.SimpleQueue[tuple[Call, Callable[[Made], None]]] = queue.SimpleQueue()
        self._made: queue.SimpleQueue[tuple[Callable[[Made], None], Made | BaseException]] = queue.SimpleQueue()
        self._ended = False
        self._began: dict[int, tuple[float, str]] = {}  # by thread: when its call began, monotonic [s], and the asset

    def start(self, call: Call, done: Callable[[Made], None]) -> None:
        """Has a call carried out; `done` is called by `collect`."""
        self._calls.put((call, done))
        with self._lock:
            if not self._free or self._ended:
                return
            self._free -= 1
        threading.Thread(target=self._work, name=f"{NAME} of {call.asset}", daemon=True).start()

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
        """The assets whose calls are being carried out."""
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
                    call, done = self._calls.get_nowait()
                except queue.Empty:
                    self._free += 1
                    return
            self._began[threading.get_ident()] = time.monotonic(), call.asset
            try:
                made: Made | BaseException = carry_out(call)
            except BaseException as error:
                made = error
            del self._began[threading.get_ident()]
            self._made.put((done, made))
            self._wake()
