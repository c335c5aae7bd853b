"""The bounded queue between a stream and the loop: what finds no room is delayed, then dropped and counted.

The stream's callback only puts raw payloads in; a full queue holds it up for a while (back-pressure on
the publisher), and what still finds no room is dropped and counted, key by key.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import NamedTuple, Protocol

from service.errors import FrameError
from service.stream.wire.topics import Channel, parse_topic


class Arrival(NamedTuple):
    """One frame as it came in, not yet decoded."""

    channel: Channel
    payload: bytes
    received: float  # on the monotonic clock [s]
    held: float = 0.0  # how long full queues had held the streams up by then, all together [s]


class InboxSource(Protocol):
    """Anything that puts what it receives into an inbox while it is open."""

    def subscribe(self, inbox: Inbox) -> AbstractContextManager[object]: ...


class Inbox:
    """A queue bounded in frames and bytes, filled by callbacks and emptied by one loop."""

    def __init__(self, frames: int = 4096, max_bytes: int = 256 * 2**20, wait: float = 60.0, prefix: str = "gearbox"):
        self._limit, self._max_bytes, self._wait, self._prefix = frames, max_bytes, wait, prefix
        self._items: deque[Arrival] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._closed = self._woken = False
        self._held = 0.0
        self.held_until = 0.0  # when a stream was last held up, on the monotonic clock [s]
        self.holding = 0  # streams that are being held up
        self.received = 0
        self.dropped: dict[str, int] = {}  # by topic: no room in time, or the key breaks the contract
        self.errors = 0  # exceptions in callbacks

    def offer(self, topic: str, payload: bytes) -> bool:
        """Puts one payload in, waiting for room; False where it had to be dropped."""
        try:
            channel = parse_topic(topic, self._prefix)
        except FrameError:
            channel = None
        begun = time.monotonic()
        with self._changed:
            self.received += 1
            if channel is not None and not self._closed and not self._room(len(payload)):
                self._hold(len(payload), begun)
            if channel is None or self._closed or not self._room(len(payload)):
                self.dropped[topic] = self.dropped.get(topic, 0) + 1
                return False
            self._items.append(Arrival(channel, payload, time.monotonic(), self._held))
            self._bytes += len(payload)
            self._changed.notify_all()
            return True

    def guarded(self, topic: Callable[[], str], payload: Callable[[], bytes]) -> None:
        """As `offer`, for callbacks whose exceptions nobody would see: they are counted."""
        try:
            self.offer(topic(), payload())
        except Exception:
            self.errors += 1

    def take(self, timeout: float) -> Arrival | None:
        """The next arrival, or None after the timeout [s]."""
        with self._changed:
            if not self._items and not self._woken:
                self._changed.wait(timeout)
            self._woken = False
            if not self._items:
                return None
            item = self._items.popleft()
            self._bytes -= len(item.payload)
            self._changed.notify_all()
            return item

    def wake(self) -> None:
        """Lets `take` answer now, be it None: whoever takes has something else to do."""
        with self._changed:
            self._woken = True
            self._changed.notify_all()

    def close(self) -> None:
        """Takes nothing more; whoever waits for room is let go."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def depth(self) -> int:
        """Frames waiting."""
        return len(self._items)

    @property
    def dropped_frames(self) -> int:
        return sum(self.dropped.values())

    def _hold(self, size: int, begun: float) -> None:
        """Waits for room, with the lock held; time for which several streams wait is counted once."""
        self.holding += 1
        while not self._closed and not self._room(size):
            if not self._changed.wait(begun + self._wait - time.monotonic()):
                break
        self.holding -= 1
        now = time.monotonic()
        self._held += now - max(begun, self.held_until)
        self.held_until = now

    def _room(self, size: int) -> bool:
        return len(self._items) < self._limit and (not self._items or self._bytes + size <= self._max_bytes)
