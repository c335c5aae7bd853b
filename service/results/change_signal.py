"""Coroutines that wait for something that threads do."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class ChangeSignal:
    """Wakes the coroutines that listen, from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listening: dict[object, tuple[str | None, Callable[[], None]]] = {}

    @contextmanager
    def listening(self, about: str | None = None) -> Iterator[asyncio.Event]:
        """An event of the running loop that is set at each change, or at those of one thing; the reader clears it."""
        loop, changed, key = asyncio.get_running_loop(), asyncio.Event(), object()

        def wake() -> None:
            if not loop.is_closed():  # a loop that has ended meanwhile has no one waiting
                loop.call_soon_threadsafe(changed.set)

        with self._lock:
            self._listening[key] = about, wake
        try:
            yield changed
        finally:
            with self._lock:
                del self._listening[key]

    def wake(self, *changed: str) -> None:
        """Tells the listeners that these things have changed, or anything where none is named."""
        with self._lock:
            listening = list(self._listening.values())
        for about, wake in listening:
            if not changed or about is None or about in changed:
                wake()
