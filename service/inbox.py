"""The bounded queue between a stream and the loop: what cannot be taken is held up, then counted.

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
from service.frames import NS, Frame
from service.pipeline import Pipeline
from service.wire.codec import decode
from service.wire.topics import Channel, parse_topic

_POLL = 0.1  # how often the loop looks whether it should end [s]
_IDLE_FACTOR = 2.5  # silence, in frames, that cannot be mere jitter
_JOIN = 0.5  # a stream just joined is collected for so long [s] ...
_JOIN_FRAMES = 2000  # ... or for so many frames
_SLOWEST = 60.0  # no stream is waited for longer than this [s]


class Arrival(NamedTuple):
    """One frame as it came in, not yet decoded."""

    channel: Channel
    payload: bytes
    received: float  # on the monotonic clock [s]


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
        self._closed = False
        self.received = 0
        self.dropped: dict[str, int] = {}  # by topic: no room in time, or the key breaks the contract
        self.errors = 0  # exceptions in callbacks

    def offer(self, topic: str, payload: bytes) -> bool:
        """Puts one payload in, waiting for room; False where it had to be dropped."""
        try:
            channel = parse_topic(topic, self._prefix)
        except FrameError:
            channel = None
        deadline = time.monotonic() + self._wait
        with self._changed:
            self.received += 1
            while channel is not None and not self._closed and not self._room(len(payload)):
                if not self._changed.wait(deadline - time.monotonic()):
                    break
            if channel is None or self._closed or not self._room(len(payload)):
                self.dropped[topic] = self.dropped.get(topic, 0) + 1
                return False
            self._items.append(Arrival(channel, payload, time.monotonic()))
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
            if not self._items:
                self._changed.wait(timeout)
            if not self._items:
                return None
            item = self._items.popleft()
            self._bytes -= len(item.payload)
            self._changed.notify_all()
            return item

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

    def _room(self, size: int) -> bool:
        return len(self._items) < self._limit and (not self._items or self._bytes + size <= self._max_bytes)


class _Rhythm:
    """One asset's stream on the wall clock: how long silence may last, and which keys are heard."""

    def __init__(self, idle_timeout: float, now: float):
        self._timeout = idle_timeout
        self._frame_length = 0.0
        self._ends: dict[str, tuple[int, float]] = {}  # end of the newest frame [ns], and when it came [s]
        self._slowest, self._seen = 0.0, 0
        self.first = self.newest = now
        self.held: deque[Frame] = deque()  # of a stream just joined: its keys need not begin together
        self.joined = False

    def note(self, frame: Frame, now: float) -> None:
        """A frame has come."""
        self.newest = now
        self._frame_length = max(self._frame_length, (frame.end_time_ns - frame.start_time_ns) / NS)
        end, when = self._ends.get(frame.channel.label, (0, now))
        if abs(frame.start_time_ns - end) < 0.5 * NS:
            self._slowest = max(self._slowest, min(now - when, _SLOWEST))
            self._seen += 1
        self._ends[frame.channel.label] = (frame.end_time_ns, now)

    @property
    def limit(self) -> float:
        """Silence that ends a window [s]: longer than frames that follow each other take to come."""
        expected = self._slowest if self._seen >= 8 else max(self._slowest, self._frame_length)
        return max(self._timeout, _IDLE_FACTOR * expected)

    def heard(self, now: float) -> list[str]:
        """The keys of which something has come lately."""
        return [label for label, (_, when) in self._ends.items() if now - when <= self.limit]


class Pump:
    """Takes arrivals through a pipeline; silence of an asset ends its window."""

    def __init__(self, inbox: Inbox, pipeline: Pipeline, idle_timeout: float = 3.0):
        self._inbox, self._pipeline, self._idle_timeout = inbox, pipeline, idle_timeout
        self._rhythms: dict[str, _Rhythm] = {}

    def run(self, stop: threading.Event) -> None:
        """Works until told to stop, and then on what has arrived by then.

        An exception of the pipeline ends it; called again, it goes on where it was.
        """
        looked = time.monotonic()
        while not stop.is_set() or self._inbox.depth:
            arrival = self._inbox.take(_POLL)
            if arrival is not None:
                self._take(arrival)
            self._feed_joined(time.monotonic())
            self._pipeline.attend()
            if time.monotonic() - looked >= _POLL and not self._inbox.depth:
                looked = time.monotonic()
                for asset, rhythm in self._rhythms.items():
                    self._close_silent(asset, rhythm, looked)
        self._feed_joined(float("inf"))

    def _take(self, arrival: Arrival) -> None:
        try:
            frame = decode(arrival.channel, arrival.payload)
        except FrameError as error:
            self._pipeline.reject(arrival.channel, error)
            return
        asset = frame.channel.asset
        rhythm = self._rhythms.setdefault(asset, _Rhythm(self._idle_timeout, arrival.received))
        rhythm.note(frame, arrival.received)
        rhythm.held.append(frame)

    def _feed_joined(self, now: float) -> None:
        """Hands frames on, except of a stream just joined, which is collected first."""
        for rhythm in self._rhythms.values():
            rhythm.joined |= now - rhythm.first >= _JOIN or len(rhythm.held) > _JOIN_FRAMES
            while rhythm.joined and rhythm.held:
                self._pipeline.feed(rhythm.held.popleft())

    def _close_silent(self, asset: str, rhythm: _Rhythm, now: float) -> None:
        """Ends the window of a stream that has fallen silent; goes on without keys that have."""
        if rhythm.held or not self._pipeline.waiting(asset):
            return
        if now - rhythm.newest > rhythm.limit:
            self._pipeline.flush(asset)
        elif now - rhythm.first > rhythm.limit:
            self._pipeline.wait_only_for(asset, rhythm.heard(now))


def pump(inbox: Inbox, pipeline: Pipeline, stop: threading.Event, idle_timeout: float = 3.0) -> None:
    """Takes arrivals through the pipeline until told to stop."""
    Pump(inbox, pipeline, idle_timeout).run(stop)
