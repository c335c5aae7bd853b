"""Coroutines that wait for something that threads do."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol, TypeVar

from starlette.concurrency import run_in_threadpool


class Awaited(Protocol):
    """What is carried out by others."""

    @property
    def done(self) -> bool: ...


W = TypeVar("W", bound=Awaited)


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


class DoneSignal(ChangeSignal):
    """Coroutines that wait until something that is kept has been carried out.

    look_every  time after which they look without having been woken [s]; None where whoever carries it out wakes them
    """

    def __init__(self, look_every: float | None = None) -> None:
        super().__init__()
        self._look_every, self._closed, self._released = look_every, False, 0

    async def done(self, read: Callable[[int], W], number: int, seconds: float) -> W | None:
        """What `read` answers once it is done; None after so many seconds, or where it is released before.

        No thread is held meanwhile.
        """
        released = self._released
        with self.listening() as changed:
            try:
                async with asyncio.timeout(seconds):
                    while not self._closed and released == self._released:
                        changed.clear()  # before reading: what is done while reading sets it again
                        waiting = await run_in_threadpool(read, number)
                        if waiting.done:
                            return waiting
                        with suppress(TimeoutError):
                            await asyncio.wait_for(changed.wait(), self._look_every)
            except TimeoutError:
                pass
        return None

    def release(self) -> None:
        """Releases all who wait now: nothing can be carried out at present."""
        self._released += 1
        self.wake()

    def close(self) -> None:
        """Releases all who wait, and who come later."""
        self._closed = True
        self.wake()
