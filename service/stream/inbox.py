"""The bounded queues between the network's callbacks and the loop: one for each stream, taken in turn.

A callback only puts a raw payload into its stream's queue, and never waits: a callback that waits holds up every other
key of its session. Streams are taken in turn, by bytes, so that one that floods its queue delays no other.

What finds no room is left out as a stretch of time, of all channels, the oldest first, from the stream with most
waiting. The loop is given the stretch in place of the frames, so that no window is made of what is left of it.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple, Protocol

from service.errors import FrameError
from service.stream.channels import CHANNEL_KINDS
from service.stream.left_out import MANY_STREAMS, NO_ROOM, UNKNOWN, Growing, Missing
from service.stream.wire.codec import quick_head_of, start_time_of
from service.stream.wire.topics import Channel, parse_topic

TURN_BYTES = 2**18  # of one stream before the next one's turn
OVERHEAD_BYTES = 256  # of one frame in a queue, beside its payload
MOST_STREAMS = 1024  # with a queue at one time
MOST_MARKERS = 64  # of one stream
MOST_CHANNELS = 256  # of one stream that are announced
MOST_LEFT_OUT = 64  # streams that are not admitted whose frames' numbers are known
_SHARE = 0.5  # of all room that one stream may have
_FREED = 0.25  # share of a stream's queue that is left out at once, at least
SAY_ERRORS_EVERY = 60.0  # that an exception of a callback is logged [s]
_KNOWN_TOPICS = 8192  # whose channels need not be parsed again

BAD_KEY, CLOSED = "bad_key", "closed"

log = logging.getLogger(__name__)


class Arrival(NamedTuple):
    """One frame as it came in, not yet decoded."""

    channel: Channel
    payload: bytes
    received: float  # on the monotonic clock [s]
    source: str | None = None  # who published it, where the network says so

    @property
    def stream(self) -> str:
        return self.channel.asset

    @property
    def size(self) -> int:
        return len(self.payload) + OVERHEAD_BYTES


class Marker(NamedTuple):
    """A question that is answered after all frames before it in its stream's queue."""

    stream: str
    reached: Callable[[], None]  # called once, by the loop

    @property
    def size(self) -> int:
        return OVERHEAD_BYTES


class Shed(NamedTuple):
    """A stretch of a stream's time of which frames were left out, for want of room or before they were admitted."""

    stream: str
    missing: Missing

    @property
    def size(self) -> int:
        return OVERHEAD_BYTES


Item = Arrival | Marker | Shed


class InboxSource(Protocol):
    """Anything that puts what it receives into an inbox while it is open."""

    def subscribe(self, inbox: Inbox) -> AbstractContextManager[object]: ...


@dataclass(slots=True)
class _Queue:
    """What waits of one stream."""

    items: deque[Item] = field(default_factory=deque)
    frames: int = 0
    bytes: int = 0
    markers: int = 0
    turn: int = TURN_BYTES  # bytes that may be taken before the next stream's turn

    def add(self, item: Item) -> None:
        self.items.append(item)
        self._count(item, 1)

    def pop(self) -> Item:
        item = self.items.popleft()
        self._count(item, -1)
        return item

    def _count(self, item: Item, sign: int) -> None:
        self.frames += sign * isinstance(item, Arrival)
        self.markers += sign * isinstance(item, Marker)
        self.bytes += sign * item.size

    def load(self, most_frames: int, most_bytes: int) -> float:
        """Share of all room that the frames have; 0 where none wait."""
        return max(self.frames / most_frames, self.bytes / most_bytes) if self.frames else 0.0

    def shed(self, stream: str) -> None:
        """Leaves out the oldest stretch of the frames, which stands at the head of the queue instead."""
        arrivals = [item for item in self.items if isinstance(item, Arrival)]
        starts = [start_time_of(item.channel, item.payload) or 0 for item in arrivals]
        freed, begin, last = 0, 0, 0
        for start, item in sorted(zip(starts, arrivals, strict=True), key=lambda pair: pair[0]):
            if freed >= _FREED * self.bytes and start > last:
                break
            begin, last, freed = begin or start, start, freed + item.size
        gone = {id(item) for start, item in zip(starts, arrivals, strict=True) if start <= last}
        frames = Counter(item.channel.label for item in arrivals if id(item) in gone)
        kept = deque(item for item in self.items if id(item) not in gone)
        if kept and isinstance(kept[0], Shed) and kept[0].missing.cause == NO_ROOM:
            before = kept[0].missing
            kept.popleft()
            begin, last = min(before.begin_ns, begin or last), max(before.end_ns - 1, last)
            frames.update(before.frames)
        kept.appendleft(Shed(stream, Missing(begin or last, last + 1, frames)))
        self.items, self.frames, self.bytes, self.markers = deque(), 0, 0, 0
        for each in kept:
            self.add(each)


class Inbox:
    """The queues of all streams, bounded in frames and bytes, filled by callbacks and emptied by one loop.

    frames, max_bytes  of all streams together; one stream may have half of it
    admits             whether frames of a stream are used, asked with the channel of each; called in callbacks
    known              whether a stream's asset is known: the others have half of the room for announcements
    """

    def __init__(
        self,
        frames: int = 4096,
        max_bytes: int = 256 * 2**20,
        prefix: str = "gearbox",
        admits: Callable[[str, str | None], bool] = lambda stream, channel: True,
        known: Callable[[str], bool] = lambda stream: True,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._admits, self._known, self._clock = admits, known, clock
        self._most_frames, self._most_bytes, self._prefix = frames, max_bytes, prefix
        self._queues: dict[str, _Queue] = {}
        self._turns: deque[str] = deque()  # streams of which something waits, in the order of their turns
        self._frames = self._bytes = 0
        self._changed = threading.Condition()
        self._closed = self._woken = False
        self._announced: dict[str, Counter[str]] = {}  # by stream: publishers by channel
        self._growing: dict[str, Growing] = {}  # by stream: frames that were left out since one was admitted
        self.received = 0
        self.refused: Counter[str] = Counter()  # frames by cause
        self.errors = 0  # exceptions in callbacks
        self._say_error_at = -math.inf  # on the clock, when the next of them is logged [s]

    def offer(self, topic: str, payload: bytes, source: str | None = None) -> bool:
        """Puts one payload in, with who published it; False where it had to be left out."""
        channel = _channel_of(topic, self._prefix)
        admitted = channel is None or self._admits(channel.asset, channel.label)
        with self._changed:
            self.received += 1
            if channel is None or self._closed:
                self.refused[BAD_KEY if channel is None else CLOSED] += 1
                return False
            queue = self._queue(channel.asset) if admitted else None
            if queue is None:
                self._leave_out(channel, payload, MANY_STREAMS if admitted else UNKNOWN)
                return False
            if (before := self._growing.pop(channel.asset, None)) is not None:
                self._add(queue, Shed(channel.asset, before.missing))
            self._add(queue, Arrival(channel, payload, self._clock(), source))
            while (victim := self._without_room(channel.asset)) is not None:
                self._shed(victim)
            return True

    def _leave_out(self, channel: Channel, payload: bytes, cause: str) -> None:
        """Notes a frame that gets no place in a queue: its stream may be admitted in the midst of a burst."""
        self.refused[cause] += 1
        head = None if CHANNEL_KINDS[channel.kind].slow else quick_head_of(channel, payload)
        if head is None:
            return
        if channel.asset not in self._growing and len(self._growing) >= MOST_LEFT_OUT:
            fewest = min(self._growing, key=lambda each: self._growing[each].frames.total())
            del self._growing[fewest]
        self._growing.setdefault(channel.asset, Growing(cause)).add(channel.label, *head)

    def ask(self, stream: str, reached: Callable[[], None]) -> bool:
        """Puts a question behind the frames of a stream; False where there is no room for it."""
        with self._changed:
            queue = None if self._closed else self._queue(stream)
            if queue is None or queue.markers >= MOST_MARKERS:
                return False
            self._add(queue, Marker(stream, reached))
            return True

    def announce(self, topic: str, *, there: bool) -> None:
        """A publisher of a topic is there, or is so no longer."""
        channel = _channel_of(topic, self._prefix)
        if channel is None:
            return
        most = MOST_STREAMS if self._known(channel.asset) else MOST_STREAMS // 2
        with self._changed:
            labels = self._announced.get(channel.asset, Counter())
            room = channel.asset in self._announced or len(self._announced) < most
            if there and room and (channel.label in labels or len(labels) < MOST_CHANNELS):
                labels[channel.label] += 1
            elif not there and labels[channel.label] > 1:
                labels[channel.label] -= 1
            else:
                del labels[channel.label]
            if labels:
                self._announced[channel.asset] = labels
            else:
                self._announced.pop(channel.asset, None)

    def announced(self, stream: str) -> tuple[str, ...]:
        """The channels of a stream that have a publisher which says so."""
        with self._changed:
            return tuple(self._announced.get(stream, ()))

    def guarded(
        self, topic: Callable[[], str], payload: Callable[[], bytes], source: Callable[[], str | None] = lambda: None
    ) -> None:
        """As `offer`, for callbacks whose exceptions nobody would see: they are counted, and logged once in a while."""
        try:
            self.offer(topic(), payload(), source())
        except Exception as error:
            with self._changed:
                self.errors += 1
                count, now = self.errors, self._clock()
                due = now >= self._say_error_at
                self._say_error_at = now + SAY_ERRORS_EVERY if due else self._say_error_at
            if due:
                log.warning(
                    "a frame could not be received, %d such errors since the start: %r", count, error, exc_info=error
                )

    def take(self, timeout: float) -> Item | None:
        """The next item of the stream whose turn it is, or None after the timeout [s]."""
        with self._changed:
            if not self._turns and not self._woken:
                self._changed.wait(timeout)
            self._woken = False
            if not self._turns:
                return None
            stream = self._turns[0]
            queue = self._queues[stream]
            frames, size = queue.frames, queue.bytes
            item = queue.pop()
            self._frames += queue.frames - frames
            self._bytes += queue.bytes - size
            queue.turn -= item.size
            if not queue.items:
                self._turns.popleft()
                del self._queues[stream]
            elif queue.turn <= 0:
                queue.turn += TURN_BYTES
                self._turns.rotate(-1)
            return item

    def wake(self) -> None:
        """Lets `take` answer now, be it None: whoever takes has something else to do."""
        with self._changed:
            self._woken = True
            self._changed.notify_all()

    def close(self) -> None:
        """Takes nothing more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def depth(self) -> int:
        """Frames waiting, of all streams."""
        return self._frames

    @property
    def bytes(self) -> int:
        """Bytes waiting, of all streams."""
        return self._bytes

    @property
    def ahead(self) -> tuple[int, int]:
        """Frames and bytes that a publisher may send before it asks whether they have been taken."""
        share = _SHARE / 2
        return max(int(share * self._most_frames), 1), max(int(share * self._most_bytes), 1)

    @property
    def empty(self) -> bool:
        """Whether nothing waits, be it a frame, a question or what is left of frames."""
        return not self._turns

    def waits(self, stream: str) -> bool:
        """Whether anything of a stream waits."""
        return stream in self._queues

    @property
    def refused_frames(self) -> int:
        """Frames that were left out."""
        return self.refused.total()

    def _queue(self, stream: str) -> _Queue | None:
        """The stream's queue; None where it has none and there are too many."""
        if stream not in self._queues:
            if len(self._queues) >= MOST_STREAMS:
                return None
            self._queues[stream] = _Queue()
            self._turns.append(stream)
        return self._queues[stream]

    def _add(self, queue: _Queue, item: Item) -> None:
        queue.add(item)
        self._frames += isinstance(item, Arrival)
        self._bytes += item.size
        self._changed.notify_all()

    def _without_room(self, stream: str) -> str | None:
        """The stream that frames must be left out of, now that one has been added to a stream."""
        loads = self._most_frames, self._most_bytes
        if self._frames > self._most_frames or self._bytes > self._most_bytes:
            most = max(self._queues, key=lambda each: self._queues[each].load(*loads))
            return most if self._queues[most].frames else None
        return stream if self._queues[stream].load(*loads) > _SHARE else None

    def _shed(self, stream: str) -> None:
        queue = self._queues[stream]
        frames, size = queue.frames, queue.bytes
        queue.shed(stream)
        self.refused[NO_ROOM] += frames - queue.frames
        self._frames += queue.frames - frames
        self._bytes += queue.bytes - size


@lru_cache(maxsize=_KNOWN_TOPICS)
def _channel_of(topic: str, prefix: str) -> Channel | None:
    try:
        return parse_topic(topic, prefix)
    except FrameError:
        return None
