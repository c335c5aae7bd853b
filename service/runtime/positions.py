"""How far each stream is stored: published as it changes, and answered to whoever asks.

A question travels through the stream's own queue, so that its answer is true of all frames that were sent before it on
the same link. The answer is held back while more of the asset's windows wait to be processed than its share: that is
the flow control of publishers that ask. An answer always comes.

Whoever asks in the midst of sending says so, by the name of its session: its silence until the answer, and until it
goes on or asks again, ends no window. Once it goes on with another stream, a stream's silence counts.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import NamedTuple, Protocol
from uuid import uuid4

from service.contract.position import ChannelPositionModel, PositionModel, position_text
from service.results.unknown_assets import UnknownAssets
from service.stream.frames import LENGTH_LIMITS, NS
from service.stream.inbox import Inbox
from service.stream.position import Position, earliest

Reply = Callable[[str], None]

PUBLISH_EVERY = 1.0  # of one stream, at most [s]
MOST_BACKLOG = 8  # windows of an asset that wait to be processed while its publishers are answered
BETWEEN_QUESTIONS = 1.5  # a publisher that waits asks again within this time after an answer [s]
ON_THE_WAY = 0.25  # frames that were sent before a question may come so much later than its answer goes out [s]
HELD_BACK = 10.0  # no answer is held back longer than this [s]
LONGEST_FRAME_NS = round(LENGTH_LIMITS[1] * NS)
_LOOK_EVERY = 0.1  # at what has changed [s]
_LOOK = 0.5  # how often answers that are overdue are looked for [s]
_MOST_STREAMS = 4096  # whose latest position is remembered
_MOST_SENDERS = 1024  # sessions whose last question is remembered


class PositionSource(Protocol):
    """Who knows how far a stream has come."""

    def position(self, stream: str) -> Position | None:
        """The stream's position; None where nothing is known of it."""
        ...

    def refusal(self, stream: str) -> str | None:
        """Why no frames of the stream are used at present, or None."""
        ...


class PositionNetwork(Protocol):
    """What positions need of a `Transport`."""

    def publish_position(self, stream: str, text: str) -> None: ...

    def answer_positions(self, ask: Callable[[str, Reply, str | None], None]) -> AbstractContextManager[object]: ...


class ClosedWindows(NamedTuple):
    """What is known of a stream's windows after they have closed."""

    unstored_from_ns: int | None = None  # start of the earliest that is not stored yet
    waiting: int = 0  # to be processed
    shed: int = 0  # left out because too many waited
    unassessed: str | None = None  # why none can be processed


class Positions:
    """The positions of all streams on a network.

    inbox      in whose queues questions wait
    network    on which positions are published
    source     who knows them
    pending    the windows of a stream that have closed
    unknown    the streams that are not used, which have no queue
    moved      streams of which something has come since their position was published: who feeds them adds to it
    """

    def __init__(
        self,
        inbox: Inbox,
        network: PositionNetwork,
        source: PositionSource,
        *,
        pending: Callable[[str], ClosedWindows] = lambda stream: ClosedWindows(),
        unknown: UnknownAssets | None = None,
        moved: set[str] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._inbox, self._network, self._source = inbox, network, source
        self._unknown = unknown or UnknownAssets()
        self._pending, self._clock = pending, clock
        self.instance = uuid4().hex
        self._lock = threading.Lock()
        self._open: dict[int, tuple[float, str, Reply, str | None]] = {}  # questions without an answer, by number
        self._asking: Counter[str | None] = Counter()  # how many of them each session has asked
        self._answered: OrderedDict[str, float] = OrderedDict()  # when sessions that send were last answered
        self._asked = 0
        self._held_back: list[tuple[str, int]] = []
        self._moved = set() if moved is None else moved
        self._published: dict[str, tuple[float, PositionModel]] = {}  # when, and what
        self._looked = float("-inf")
        self._ending = threading.Event()

    def __enter__(self) -> Positions:
        self._watch = threading.Thread(target=self._answer_overdue, name="positions", daemon=True)
        self._watch.start()
        self._answering = self._network.answer_positions(self.ask)
        self._answering.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._answering.__exit__(None, None, None)
        self._ending.set()
        self._watch.join()
        for number in list(self._open):
            self._close(number, self._behind)

    # -- questions -----------------------------------------------------------------------------------

    def ask(self, stream: str, reply: Reply, sender: str | None = None) -> None:
        """Takes a question of a network's callback; `reply` is given the answer, from any thread.

        sender  the session that asks, where it goes on sending after the answer
        """
        if not self._unknown.asked(stream):
            reply(position_text(self.latest(stream)))
            return
        with self._lock:
            self._asked += 1
            number = self._asked
            self._open[number] = (self._clock(), stream, reply, sender)
            self._asking[sender] += 1
        if not self._inbox.ask(stream, lambda: self.reached(stream, number)):
            self._close(number, self._behind)

    def waits(self, sender: str, heard: float) -> bool:
        """Whether a session that sends waits for an answer, or has not gone on, and may ask again soon.

        heard  when the newest frame of its other streams came, on the monotonic clock: well after the newest answer,
               the session has gone on [s]
        """
        with self._lock:
            answered = self._answered.get(sender, float("-inf"))
            asks_again = heard - answered <= ON_THE_WAY and self._clock() - answered < BETWEEN_QUESTIONS
            return asks_again or sender in self._asking

    def asks(self, sender: str) -> bool:
        """Whether a session that sends has asked what is stored: it sends a recording, and no live stream."""
        with self._lock:
            return sender in self._answered or sender in self._asking

    def reached(self, stream: str, number: int) -> None:
        """The question has come to the head of its stream's queue."""
        if self._pending(stream).waiting > MOST_BACKLOG:
            self._held_back.append((stream, number))
        else:
            self._close(number, self._text)

    # -- publication ---------------------------------------------------------------------------------

    def moved(self, *streams: str) -> None:
        """Something of some streams has come, or has been stored."""
        self._moved.update(streams)

    def __call__(self) -> None:
        """Publishes what has changed, and answers what was held back; called between frames by who feeds them."""
        now = self._clock()
        if now - self._looked < _LOOK_EVERY:
            return
        self._looked = now
        waiting, self._held_back = self._held_back, []
        for stream, number in waiting:
            if number in self._open:
                self.reached(stream, number)
        for stream in list(self._moved):
            self._publish(stream, now)

    def _publish(self, stream: str, now: float) -> None:
        """Publishes a stream's position: at once where more of it is stored, else not more than once a second."""
        at, before = self._published.get(stream, (float("-inf"), None))
        model = self._model(stream)
        if now - at < PUBLISH_EVERY and before and model.settled_until_ns == before.settled_until_ns:
            return
        self._moved.discard(stream)
        if model != before:
            self._network.publish_position(stream, position_text(model))
        self._published.pop(stream, None)
        self._published[stream] = (now, model)
        if len(self._published) > _MOST_STREAMS:
            del self._published[next(iter(self._published))]

    def _text(self, stream: str) -> str:
        return position_text(self._model(stream))

    def latest(self, stream: str) -> PositionModel:
        """What was published last, and what holds now: whether frames are used, and how many windows wait.

        Frames that came since are not in it.
        """
        _, known = self._published.get(stream, (0.0, None))
        known = known or PositionModel(asset=stream, instance=self.instance, accepting=True)
        refusal = self._source.refusal(stream)
        closed = self._pending(stream)
        now = {
            "accepting": refusal is None, "reason": refusal, "instance": self._instance_of(stream),
            "backlog": closed.waiting, "unassessed": closed.unassessed,
        }  # fmt: skip
        return known.model_copy(update=now)

    def _behind(self, stream: str) -> str:
        known = self.latest(stream)
        return position_text(known.model_copy(update={"behind": True}))

    def _instance_of(self, stream: str) -> str:
        """Another one where earlier frames must be sent again: after a start, and where the asset has been adopted."""
        return f"{self.instance}-adopted" if self._unknown.renewed(stream) else self.instance

    def _model(self, stream: str) -> PositionModel:
        found = self._source.position(stream) or Position()
        closed = self._pending(stream)
        closed_from = closed.unstored_from_ns
        stored_until = found.settled_until_ns
        if closed_from is not None:
            stored_until = None if stored_until is None else min(stored_until, closed_from)
            closed_from -= LONGEST_FRAME_NS  # a frame of its first part may have begun in the window before
        refusal = self._source.refusal(stream)
        return PositionModel(
            asset=stream,
            instance=self._instance_of(stream),
            accepting=refusal is None,
            reason=refusal,
            unsettled_from_ns=earliest([found.unsettled_from_ns, closed_from]),
            settled_until_ns=stored_until,
            channels=_channels(found),
            left_out=dict(found.left_out),
            ahead_frames=self._inbox.ahead[0],
            ahead_bytes=self._inbox.ahead[1],
            backlog=closed.waiting,
            unassessed=closed.unassessed,
            shed=found.shed + closed.shed,
        )

    def _close(self, number: int, text_of: Callable[[str], str]) -> None:
        with self._lock:
            question = self._open.pop(number, None)
            if question is not None:
                self._asking -= Counter([question[3]])
            if question is not None and question[3] is not None:
                self._answered.pop(question[3], None)
                self._answered[question[3]] = self._clock()
                if len(self._answered) > _MOST_SENDERS:
                    self._answered.popitem(last=False)
        if question is not None:
            _, stream, reply, _ = question
            reply(text_of(stream))

    def _answer_overdue(self) -> None:
        while not self._ending.wait(_LOOK):
            limit = self._clock() - HELD_BACK
            for number, (asked, _, _, _) in list(self._open.items()):
                if asked < limit:
                    self._close(number, self._behind)


def _channels(position: Position) -> Mapping[str, ChannelPositionModel]:
    return {
        label: ChannelPositionModel(sequence=each.sequence, start_time_ns=each.start_ns, missing=list(each.missing))
        for label, each in sorted(position.channels.items())
    }
