"""From the inbox to the pipeline: decoding, streams just joined, windows that end in silence."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import Protocol

from service.errors import FrameError
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import NS, Frame
from service.stream.inbox import Arrival, Inbox
from service.stream.wire.codec import decode
from service.stream.wire.topics import Channel

_POLL = 0.1  # how often the loop looks whether it should end [s]
_IDLE_FACTOR = 2.5  # silence, in frames, that cannot be mere jitter
_JOIN = 0.5  # a stream just joined is collected for so long [s] ...
_JOIN_FRAMES = 2000  # ... or for so many frames
_SLOWEST = 60.0  # no stream is waited for longer than this [s]
_LATE = 3.0  # silence of a key that is no mere delay of a busy machine, however short the idle timeout is [s]
_TOGETHER_NS = NS  # keys of one burst end within this time, beyond the length of a frame


class _Rhythm:
    """One asset's stream on the wall clock: how long silence may last, and which keys are heard."""

    def __init__(self, idle_timeout: float, now: float):
        self._timeout = idle_timeout
        self._frame_length = 0.0
        self._ends: dict[str, tuple[int, float, float]] = {}  # newest frame's end [ns], when it came, held up till then
        self._slowest, self._seen = 0.0, 0
        self.first = self.newest = now
        self.held: deque[Frame] = deque()  # of a stream just joined: its keys need not begin together
        self.joined = False

    def note(self, frame: Frame, now: float, held: float) -> None:
        """A frame has come; what held it up here, `held` [s] since the inbox was opened, is not its stream's rhythm.

        A slow channel's frames go on between windows: they neither make nor break a silence.
        """
        if CHANNEL_KINDS[frame.channel.kind].slow:
            return
        self.newest = now
        self._frame_length = max(self._frame_length, (frame.end_time_ns - frame.start_time_ns) / NS)
        end, when, held_before = self._ends.get(frame.channel.label, (0, now, held))
        if abs(frame.start_time_ns - end) < 0.5 * NS:
            took = now - when - (held - held_before)
            self._slowest = max(self._slowest, min(took, _SLOWEST))
            self._seen += 1
        self._ends[frame.channel.label] = (frame.end_time_ns, now, held)

    @property
    def limit(self) -> float:
        """Silence that ends a window [s]: longer than frames that follow each other take to come."""
        expected = self._slowest if self._seen >= 8 else max(self._slowest, self._frame_length)
        return max(self._timeout, _IDLE_FACTOR * expected)

    def patience(self, now: float) -> float:
        """Silence that ends the window in progress [s]: longer where a key has not come as far as the others.

        A window that is closed without a channel is committed for good, and a stream just joined may have more keys.
        """
        newest = max((end for end, _, _ in self._ends.values()), default=0)
        together = _TOGETHER_NS + round(self._frame_length * NS)
        behind = any(newest - end > together and now - when <= _SLOWEST for end, when, _ in self._ends.values())
        return max(self.limit, _LATE) if behind or now - self.first <= _LATE else self.limit

    def heard(self, now: float, held_until: float) -> list[str]:
        """The keys of which something has come lately, or could not come since the inbox held it up."""
        limit = max(self.limit, _LATE)
        return [label for label, (_, when, _) in self._ends.items() if now - max(when, held_until) <= limit]


class FrameConsumer(Protocol):
    """Whom the pump drives: a `Pipeline`, or the service's `Intake` before one."""

    def feed(self, frame: Frame) -> None: ...

    def reject(self, channel: Channel, error: FrameError) -> None: ...

    def flush(self, asset: str) -> None: ...

    def waiting(self, asset: str) -> bool: ...

    def wait_only_for(self, asset: str, labels: Iterable[str]) -> None: ...


class Pump:
    """Takes arrivals to a consumer; silence of an asset ends its window.

    between  called between frames, at least every tenth of a second while no window is being processed
    """

    def __init__(
        self,
        inbox: Inbox,
        consumer: FrameConsumer,
        idle_timeout: float = 3.0,
        between: Callable[[], None] = lambda: None,
    ):
        self._inbox, self._consumer, self._idle_timeout, self._between = inbox, consumer, idle_timeout, between
        self._rhythms: dict[str, _Rhythm] = {}

    def run(self, stop: threading.Event) -> None:
        """Works until `stop` is set, then processes what has arrived by then.

        An exception of the consumer ends it; called again, it goes on where it was.
        """
        looked = time.monotonic()
        while not stop.is_set() or self._inbox.depth:
            arrival = self._inbox.take(_POLL)
            if arrival is not None:
                self._take(arrival)
            self._feed_joined(time.monotonic())
            self._between()
            if time.monotonic() - looked >= _POLL and not self._inbox.depth and not self._inbox.holding:
                looked = time.monotonic()
                for asset, rhythm in self._rhythms.items():
                    self._close_silent(asset, rhythm, looked)
        self._feed_joined(float("inf"))

    def _take(self, arrival: Arrival) -> None:
        try:
            frame = decode(arrival.channel, arrival.payload)
        except FrameError as error:
            self._consumer.reject(arrival.channel, error)
            return
        asset = frame.channel.asset
        rhythm = self._rhythms.setdefault(asset, _Rhythm(self._idle_timeout, arrival.received))
        rhythm.note(frame, arrival.received, arrival.held)
        rhythm.held.append(frame)

    def _feed_joined(self, now: float) -> None:
        """Hands frames on, except of a stream just joined, which is collected first."""
        for rhythm in self._rhythms.values():
            rhythm.joined |= now - rhythm.first >= _JOIN or len(rhythm.held) > _JOIN_FRAMES
            while rhythm.joined and rhythm.held:
                self._consumer.feed(rhythm.held.popleft())

    def _close_silent(self, asset: str, rhythm: _Rhythm, now: float) -> None:
        """Ends the window of a stream that has fallen silent; goes on without keys that have."""
        if rhythm.held or not self._consumer.waiting(asset):
            return
        held_until = self._inbox.held_until
        if now - max(rhythm.newest, held_until) > rhythm.patience(now):
            self._consumer.flush(asset)
        elif now - rhythm.first > max(rhythm.limit, _LATE):
            self._consumer.wait_only_for(asset, rhythm.heard(now, held_until))


def pump(
    inbox: Inbox,
    consumer: FrameConsumer,
    stop: threading.Event,
    idle_timeout: float = 3.0,
    between: Callable[[], None] = lambda: None,
) -> None:
    """Takes arrivals to a consumer until `stop` is set."""
    Pump(inbox, consumer, idle_timeout, between).run(stop)
