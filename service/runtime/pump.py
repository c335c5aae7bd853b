"""From the inbox to the consumer: decoding, windows that end in silence, channels that are late or have ended."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from typing import Protocol

from service.errors import FrameError
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import NS, Frame
from service.stream.inbox import Arrival, Inbox, Item, Marker, Shed
from service.stream.left_out import Missing
from service.stream.publishers import Publishers
from service.stream.wire.codec import decode
from service.stream.wire.topics import Channel

_POLL, _POLL_SELDOM = 0.1, 0.5  # how often the loop looks for silence, and where nothing has come for a while [s]
_QUIET = 10.0  # that while [s]
_STARVED = 0.25  # a turn of the loop that takes longer was held up: the rest of it is no silence of a stream [s]
_IDLE_FACTOR = 2.5  # silence, in frames, that cannot be mere jitter
_SLOWEST = 60.0  # no stream is waited for longer than this [s]
JOINED = 3.0  # a stream just joined may have channels that nobody knows of; they are awaited for so long [s]
_FORGET = 0.5 ** (1 / 1000)  # of the slowest frame with each that comes: half in a thousand
_MOST_STREAMS = 4096  # whose rhythm is known
_MOST_CHANNELS = 256  # of one stream
_TOGETHER_NS = NS  # channels of one burst end within this time, beyond the length of a frame
CHANNEL_WAIT = 10.0  # how long a channel is waited for that the others have gone on without [s]


@dataclass(slots=True)
class _Heard:
    """What has been received of one channel."""

    end: int = 0  # of the newest frame [ns]
    received: float = 0.0  # when that came, on the monotonic clock [s]
    waited: float = 0.0  # how long the sender had waited for answers by then [s]
    late_since: float | None = None  # when the others were first seen to have gone on without it, on the pump's clock
    ended: bool = False  # waited for in vain; not waited for again until it sends
    publishers: Publishers = field(default_factory=Publishers)


@dataclass(slots=True)
class _Sender:
    """When frames of a session's streams have come, on the monotonic clock [s]."""

    stream: str  # of the newest frame
    newest: float = float("-inf")
    of_another: float = float("-inf")  # the newest frame of another stream than that

    def note(self, stream: str, received: float) -> None:
        """A frame came."""
        if stream != self.stream:
            self.stream, self.of_another = stream, self.newest
        self.newest = received

    def of_others(self, stream: str) -> float:
        """When the newest frame came that is of another stream."""
        return self.of_another if stream == self.stream else self.newest


class _Rhythm:
    """The streams of one asset in time: how long silence may last, and which channels are waited for.

    `now` is the pump's clock, which stands still while the process does: a service that was suspended, or that had no
    processor, has not heard silence. Frames that came meanwhile are still on their way to it.
    """

    def __init__(self, idle_timeout: float, channel_wait: float, now: float):
        self._timeout, self._channel_wait = idle_timeout, channel_wait
        self._frame_length = 0.0
        self._heard: dict[str, _Heard] = {}
        self._slowest, self._seen = 0.0, 0
        self.first = self.newest = now
        self.stream = ""  # that the newest frame is of
        self.streams: set[str] = set()
        self.sender: str | None = None  # the session that the newest frame came from
        self._looked = now
        self._waited = 0.0  # how long the sender has waited for answers [s]

    def note(self, frame: Frame, received: float, now: float) -> None:
        """A frame has come.

        A slow channel's frames go on between windows: they neither make nor break a silence.
        """
        if CHANNEL_KINDS[frame.channel.kind].slow:
            return
        self.newest = now
        self._frame_length = max(self._frame_length, (frame.end_time_ns - frame.start_time_ns) / NS)
        label = frame.channel.label
        if label not in self._heard and len(self._heard) >= _MOST_CHANNELS:
            return
        heard = self._heard.setdefault(label, _Heard())
        if abs(frame.start_time_ns - heard.end) < 0.5 * NS:
            taken = received - heard.received - (self._waited - heard.waited)
            self._slowest = max(_FORGET * self._slowest, min(taken, _SLOWEST))
            self._seen += 1
        heard.end, heard.received, heard.waited = frame.end_time_ns, received, self._waited
        heard.late_since, heard.ended = None, False

    def look(self, now: float, waits: bool) -> None:
        """A look at the stream; the time since the last one is no silence where its sender waits for an answer."""
        if waits:
            self.newest = min(self.newest + now - self._looked, now)
            self._waited += now - self._looked
        self._looked = now

    def note_publisher(self, label: str, source: str, received: float) -> tuple[str, str] | None:
        """The two publishers that send on a channel's key in turn; None where there is no proof of that."""
        heard = self._heard.get(label)
        return None if heard is None else heard.publishers.note(source, received)

    @property
    def limit(self) -> float:
        """Silence that ends a window [s]: longer than frames that follow each other take to come."""
        expected = self._slowest if self._seen >= 8 else max(self._slowest, self._frame_length)
        return max(self._timeout, _IDLE_FACTOR * expected)

    def awaited(self, labels: Iterable[str], now: float) -> set[str]:
        """Of the channels that a stream has had, or should have, those whose frames are late and still waited for.

        A channel is late once the others have gone on without it, however long it had been silent before that: a
        stream that begins anew after hours has its channels one after the other, as the network brings them. A window
        that is closed without a channel stays so for good.
        """
        newest = max((heard.end for heard in self._heard.values()), default=0)
        together = _TOGETHER_NS + round(self._frame_length * NS)
        late = set()
        for label in {*labels, *self._heard}:
            heard = self._heard.setdefault(label, _Heard())
            if newest - heard.end <= together:
                heard.late_since = None
            elif not heard.ended:
                heard.late_since = now if heard.late_since is None else heard.late_since
                heard.ended = now - heard.late_since > self._channel_wait
                late |= set() if heard.ended else {label}
        return late

    @property
    def ended(self) -> set[str]:
        """The channels that were waited for in vain."""
        return {label for label, heard in self._heard.items() if heard.ended}

    def is_over(self, late: Collection[str], now: float) -> bool:
        """Whether silence has ended the window in progress, of which some channels are late."""
        limit = max(self.limit, JOINED) if now - self.first <= JOINED else self.limit
        return not late and now - self.newest > limit


class FrameConsumer(Protocol):
    """Whom the pump drives: a `Pipeline`, or the service's `Streams` before its `Intake`."""

    def feed(self, frame: Frame) -> None: ...

    def reject(self, channel: Channel, error: FrameError) -> None: ...

    def leave_out(self, asset: str, missing: Missing) -> None: ...

    def note_publishers(self, asset: str, label: str, two: tuple[str, str]) -> None: ...

    def note_recorded(self, asset: str, recorded: bool) -> None: ...

    def flush(self, asset: str) -> None: ...

    def waiting(self, asset: str) -> bool: ...

    def channels(self, asset: str) -> Collection[str]: ...

    def expect(self, asset: str, labels: Iterable[str]) -> None: ...

    def wait_only_for(self, asset: str, labels: Iterable[str]) -> None: ...


class Pump:
    """Takes arrivals to a consumer; silence of an asset ends its window, whatever names its frames have.

    idle_timeout  silence that ends a window [s]
    channel_wait  how long a channel is waited for that the others have gone on without [s]
    holding       whether publishers are asked to wait: their silence ends no window then
    waits         whether a session that sends frames waits for an answer, or has been given one and not gone on;
                  called with its name and when the newest frame of its other streams came [s]
    asks          whether a session asks what is stored of what it sends: it sends a recording
    between       called between frames, and at least every half second
    asset_of      the asset that a stream belongs to at present
    clock         the monotonic clock [s]
    """

    def __init__(
        self,
        inbox: Inbox,
        consumer: FrameConsumer,
        idle_timeout: float = 3.0,
        between: Callable[[], None] = lambda: None,
        *,
        channel_wait: float = CHANNEL_WAIT,
        holding: Callable[[], bool] = lambda: False,
        waits: Callable[[str, float], bool] = lambda sender, heard: False,
        asks: Callable[[str], bool] = lambda sender: False,
        asset_of: Callable[[str], str] = lambda stream: stream,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._inbox, self._consumer, self._idle_timeout, self._between = inbox, consumer, idle_timeout, between
        self._channel_wait, self._holding, self._waits, self._clock = channel_wait, holding, waits, clock
        self._asset_of, self._asks = asset_of, asks
        self._rhythms: dict[str, _Rhythm] = {}  # by asset
        self._senders: dict[str, _Sender] = {}  # by session
        self._now = 0.0  # stands still while the process does, and while publishers wait [s]
        self._turned = self._came = clock()
        self._looked = 0.0

    def run(self, stop: threading.Event) -> None:
        """Works until `stop` is set, then processes what has arrived by then.

        An exception of the consumer ends it; called again, it goes on where it was.
        """
        while not stop.is_set() or not self._inbox.empty:
            poll = _POLL if self._turned - self._came < _QUIET or self._holding() else _POLL_SELDOM
            self.turn(self._inbox.take(poll), poll)
            self._between()

    def turn(self, item: Item | None, poll: float = _POLL) -> None:
        """One turn of the loop: what has arrived, if anything has, and from time to time a look for silence.

        poll  how long it was waited for at most [s]
        """
        turned = self._clock()
        if not self._holding():
            self._now += min(turned - self._turned, _STARVED + poll - _POLL)
        self._turned = turned
        self._came = self._came if item is None else turned
        if isinstance(item, Arrival):
            self._take(item)
        elif isinstance(item, Shed):
            self._consumer.leave_out(item.stream, item.missing)
        elif isinstance(item, Marker):
            item.reached()
        if self._now - self._looked >= _POLL:
            self._looked = self._now
            self._look_for_silence()

    def _take(self, arrival: Arrival) -> None:
        try:
            frame = decode(arrival.channel, arrival.payload)
        except FrameError as error:
            self._consumer.reject(arrival.channel, error)
            return
        stream = frame.channel.asset
        rhythm = self._rhythm(stream)
        new = stream not in rhythm.streams
        rhythm.stream = stream
        rhythm.streams.add(stream)
        rhythm.note(frame, arrival.received, self._now)
        if arrival.source is not None:
            rhythm.sender = arrival.source.partition("/")[0]
            self._note_sender(rhythm.sender, stream, arrival.received)
            label = frame.channel.label
            two = rhythm.note_publisher(label, arrival.source, arrival.received)
            if two is not None:
                self._consumer.note_publishers(stream, label, two)
            self._consumer.note_recorded(stream, self._asks(rhythm.sender))
        self._consumer.feed(frame)
        if new:
            self._consumer.expect(stream, self._inbox.announced(stream))

    def _note_sender(self, sender: str, stream: str, received: float) -> None:
        """A frame came from a session; that of which nothing has come longest is given up for a new one."""
        found = self._senders.pop(sender, None) or _Sender(stream)
        if len(self._senders) >= _MOST_STREAMS:
            del self._senders[next(iter(self._senders))]
        self._senders[sender] = found
        found.note(stream, received)

    def _rhythm(self, stream: str) -> _Rhythm:
        """The rhythm of a stream's asset; that of the one which has been silent longest is given up for a new one."""
        asset = self._asset_of(stream)
        found = self._rhythms.pop(asset, None) or self._begun(asset)
        if len(self._rhythms) >= _MOST_STREAMS:
            del self._rhythms[next(iter(self._rhythms))]
        self._rhythms[asset] = found
        return found

    def _begun(self, asset: str) -> _Rhythm:
        """The rhythm of an asset that has none: that of a stream which has just become its."""
        for known_as, rhythm in self._rhythms.items():
            if any(self._asset_of(stream) == asset for stream in rhythm.streams):
                return self._rhythms.pop(known_as)
        return _Rhythm(self._idle_timeout, self._channel_wait, self._now)

    def _sender_waits(self, stream: str, sender: str | None) -> bool:
        """Whether the session that sends a stream waits for an answer."""
        found = None if sender is None else self._senders.get(sender)
        return found is not None and self._waits(str(sender), found.of_others(stream))

    def _look_for_silence(self) -> None:
        """Ends the windows of assets that have fallen silent."""
        for known_as, rhythm in list(self._rhythms.items()):
            asset = self._asset_of(rhythm.stream)
            if asset != known_as:  # the stream has been found to be another machine's
                del self._rhythms[known_as]
                rhythm = self._rhythms.setdefault(asset, rhythm)
            rhythm.streams = {stream for stream in rhythm.streams if self._asset_of(stream) == asset}
            if not any(self._inbox.waits(stream) for stream in rhythm.streams):
                self._close_silent(rhythm)

    def _close_silent(self, rhythm: _Rhythm) -> None:
        """Ends the window of an asset that has fallen silent; goes on without channels that have ended."""
        stream = rhythm.stream
        if not all(self._consumer.waiting(each) for each in rhythm.streams):
            return
        channels = self._consumer.channels(stream)
        if new := {label for each in rhythm.streams for label in self._inbox.announced(each)} - set(channels):
            self._consumer.expect(stream, new)
            channels = self._consumer.channels(stream)
        rhythm.look(self._now, self._sender_waits(stream, rhythm.sender))
        late = rhythm.awaited(channels, self._now)
        if rhythm.is_over(late, self._now):
            self._consumer.flush(stream)
        elif rhythm.ended:
            self._consumer.wait_only_for(stream, set(channels) - rhythm.ended)
