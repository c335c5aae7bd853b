"""Coroutines that wait for something that threads do."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class ChangeSignal:
    """Wakes every coroutine that listens, from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listening: dict[object, Callable[[], None]] = {}

    @contextmanager
    def listening(self) -> Iterator[asyncio.Event]:
        """An event of the running loop that is set at each change; the reader clears it."""
        loop, changed, key = asyncio.get_running_loop(), asyncio.Event(), object()

        def wake() -> None:
            if not loop.is_closed():  # a loop that has ended meanwhile has no one waiting
                loop.call_soon_threadsafe(changed.set)

        with self._lock:
            self._listening[key] = wake
        try:
            yield changed
        finally:
            with self._lock:
                del self._listening[key]

    def wake(self) -> None:
        """Tells all listeners that something has changed."""
        with self._lock:
            listening = list(self._listening.values())
        for wake in listening:
            wake()
