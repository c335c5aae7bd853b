"""Frames that are kept until a service has stored them, and sent again where it has not.

Whoever publishes asks for the stream's position now and then. The question travels behind the frames, so that its
answer says of all of them whether they have come, and from which time on they are held in memory only. What is not
stored yet is kept here; after the service, the router or the link was lost it is sent once more. The receiver knows
frames that come again by their sequence numbers.
"""

from __future__ import annotations

import bisect
import itertools
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from service.contract.position import PositionModel, position_of
from service.errors import DeliveryError, FrameError
from service.stream.sources.mcap import RawFrame
from service.stream.wire.codec import head_of
from service.transport.protocol import FramePublisher

ASK_FRAMES = 256  # sent between two questions, at most ...
ASK_BYTES = 2**22  # ... and so many bytes
KEPT_BYTES = 256 * 2**20  # of frames that are not stored yet
ANSWER_WAIT = 12.0  # for one answer [s]
COUNTED_WITHIN = 0.5  # frames that a question has overtaken have come after this time [s]
ON_THE_WAY = 1.5  # frames that have not come after this time are sent again [s]
SENT_AGAIN = 5  # times, without anything being stored meanwhile
STORED_WAIT = 600.0  # how long a service that answers may store nothing [s]
_NOTE_AFTER = 10.0  # waiting is said [s]
_ASK_AGAIN = (0.05, 1.0)  # shortest and longest pause between two questions [s]
_ASK_REFUSED = 0.25  # of a service that accepts none now: a window in progress goes on as soon as it does [s]
ASK_EVERY = 2.0  # a service is asked so often at least while frames are sent [s]
ASKED_TOGETHER = 64  # streams


@dataclass(slots=True)
class _Kept:
    """One frame that is not known to be stored."""

    frame: RawFrame | None  # None where there was no room to keep it
    stream: str
    label: str
    sequence: int
    start_ns: int
    size: int


@dataclass(slots=True)
class Ranges:
    """Numbers, as few ranges."""

    ranges: list[list[int]] = field(default_factory=list)  # [first, last], rising

    def add(self, number: int) -> None:
        at = bisect.bisect_right(self.ranges, number, key=lambda each: each[0])
        if at and self.ranges[at - 1][1] >= number:
            return
        self.ranges.insert(at, [number, number])
        if at + 1 < len(self.ranges) and self.ranges[at + 1][0] == number + 1:
            self.ranges[at][1] = self.ranges.pop(at + 1)[1]
        if at and self.ranges[at - 1][1] == number - 1:
            self.ranges[at - 1][1] = self.ranges.pop(at)[1]

    @property
    def holes(self) -> int:
        """Numbers between the first and the last that are not among them."""
        return sum(after[0] - before[1] - 1 for before, after in itertools.pairwise(self.ranges))


class Delivery:
    """Sends frames and keeps them until they are stored.

    wait   how long a service that is away is waited for [s]
    note   called with a line about what is being waited for
    """

    def __init__(
        self,
        publisher: FramePublisher,
        *,
        wait: float = 30.0,
        most_bytes: int = KEPT_BYTES,
        note: Callable[[str], None] = lambda line: None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._publisher, self._wait, self._most_bytes, self._note = publisher, wait, most_bytes, note
        self._clock, self._sleep = clock, sleep
        self._kept: deque[_Kept] = deque()
        self._bytes = self._unkept = 0
        self._since_asked = [0, 0]  # frames and bytes
        self._ahead = (ASK_FRAMES, ASK_BYTES)
        self._asked = clock()
        self._sent: dict[tuple[str, str], Ranges] = {}  # sequence numbers by stream and channel
        self._last: dict[tuple[str, str], tuple[int, int]] = {}  # by stream and channel: the newest frame sent
        self._before: dict[tuple[str, str], int] = {}  # by stream and channel: where the newest lay that was there [ns]
        self._first: set[tuple[str, str]] = set()  # of them, those whose first frame is not known to have come
        self._disordered: set[tuple[str, str]] = set()  # of them, those that were not sent in order of time
        self._instances: dict[str, set[str]] = {}
        self._left_out: dict[str, tuple[Counter[str], Counter[str]]] = {}  # by service: at first, and by now
        self._reason: str | None = None
        self._noted = False
        self._noted_reason: str | None = None
        self._resent = clock()  # when all that is kept was sent again last
        self._sending = True  # whether frames follow after an answer
        self.invalid = 0  # frames that no service can read
        self.settled = 0
        self.unassessed: str | None = None  # why what is stored cannot be assessed at present, by the newest answer

    # -- sending -------------------------------------------------------------------------------------

    def begin(self, streams: Iterable[str]) -> None:
        """Asks about streams together, of which `send` would ask one by one before it sends their first frames."""
        for stream, positions in self._positions(stream for stream in streams if stream not in self._instances):
            self._note_services(stream, positions)  # what was left out before this began

    def send(self, frame: RawFrame) -> None:
        """Sends one frame and keeps it; waits where too much is on its way."""
        stream = frame.channel.asset
        self.begin([stream])
        if not self._publisher.linked(frame.channel):
            self._send_again()
        if (stream, frame.channel.label) in self._first:  # no gap would show later that it was lost
            self._until(lambda: True, or_refused=True)
        self._publisher.publish(frame)
        self._keep(frame)
        self._since_asked[0] += 1
        self._since_asked[1] += len(frame.payload)
        frames, size = self._since_asked
        if frames >= self._ahead[0] or size >= self._ahead[1] or self._clock() - self._asked >= ASK_EVERY:
            self._until(lambda: True)

    def finish(self) -> None:
        """Returns once all that was sent is stored; DeliveryError with how much is not, and why."""
        self._sending = False
        self._until(lambda: not self._kept)
        self._until_counted()

    def left_out(self) -> dict[str, int]:
        """Frames that a service has not used since this began, by cause."""
        found: Counter[str] = Counter({"invalid": self.invalid})  # of an asset that is unknown, nobody else counts them
        for first, now in self._left_out.values():
            found |= now - first
        del found["duplicate"]  # sent again, or stored before
        found["lost"] -= sum(each.holes for each in self._sent.values())  # were not there to be sent
        found["sequence_jump"] -= sum(len(each.ranges) - 1 for each in self._sent.values())  # nor were these
        return {cause: number for cause, number in sorted(found.items()) if number > 0}

    # -- waiting -------------------------------------------------------------------------------------

    def _until_counted(self) -> None:
        """Waits for the causes of frames that lie before the newest of which a service knew when this began.

        That they have come shows by nothing else, and a question may overtake them: no cause is new for a while then.
        """
        earlier = {key[0] for key, (_, start) in self._last.items() if start <= self._before.get(key, start - 1)}
        while earlier:
            counted = dict(self._left_out)
            self._sleep(COUNTED_WITHIN)
            for stream, positions in self._positions(sorted(earlier)):
                self._note_services(stream, positions)
            if self._left_out == counted:
                return

    def _until(self, enough: Callable[[], bool], *, or_refused: bool = False) -> None:
        """Asks until all frames sent have come and it is enough, or a service says why it takes none at present."""
        pause, progress = _ASK_AGAIN[0], (self.settled, 0)
        moved = answered = arrived = self._clock()
        sent_again = 0
        self._noted = False
        while True:
            if not self._publisher.linked():
                self._send_again()
                answered = arrived = self._clock()
            come, said = self._ask()
            self._note_reason()
            if or_refused and self._reason:
                return
            now = self._clock()
            if said:
                answered = now
            if (self.settled, self._received) != progress:
                progress, moved, pause = (self.settled, self._received), now, _ASK_AGAIN[0]
                sent_again = sent_again if come else 0
            if self._reason:  # the service has them, or will use those that are sent once it accepts frames again
                arrived, sent_again = now, 0
            if come:
                arrived = now
                self._first.clear()
                if enough():
                    self._since_asked, self._asked = [0, 0], now
                    return
            if now - answered > self._wait or (self._reason and now - moved > self._wait) or now - moved > STORED_WAIT:
                self._give_up(answered=now - answered <= self._wait)
            if now - max(arrived, moved, self._resent) > ON_THE_WAY and said and not (come or self._reason):
                sent_again += 1
                if sent_again > SENT_AGAIN:
                    self._give_up(answered=True)
                self._send_again()
                arrived = self._clock()
            self._note_waiting(now - moved)
            self._sleep(pause)
            pause = min(2 * pause, _ASK_AGAIN[1] if self._reason is None else _ASK_REFUSED)

    def _note_waiting(self, seconds: float) -> None:
        """Says once what is waited for."""
        if seconds > _NOTE_AFTER and not self._noted:
            self._noted = True
            self._note(f"waiting for the service to store {len(self._kept)} frames")

    def _note_reason(self) -> None:
        """Says at once why frames are not used, where that is new."""
        if self._reason is not None and self._reason != self._noted_reason:
            self._note(f"{self._reason}; the frames are kept for {self._wait:g} s")
        self._noted_reason = self._reason

    def _ask(self) -> tuple[bool, bool]:
        """Whether all frames sent have come, by everyone who answers; and whether anyone does."""
        streams = {each.stream for each in self._kept}
        come, anyone, restarted = True, False, False
        self._reason = None
        self._received = 0
        for stream, positions in self._positions(sorted(streams)):
            anyone |= bool(positions)
            if not positions:
                come = False
                continue
            anew = self._note_services(stream, positions)
            restarted |= anew
            self._reason = next((p.reason for p in positions if not p.accepting), self._reason)
            self.unassessed = next((p.unassessed for p in positions if p.unassessed), None)
            here = [not p.behind and p.accepting and self._has_come(stream, p) for p in positions]
            self._received += sum(p.backlog for p in positions)
            self._received += sum(each.start_time_ns for p in positions for each in p.channels.values())
            if all(here) and not anew:
                self._settle(stream, positions)
            else:
                come = False
        if restarted:  # once for all streams, however many have found that out
            self._send_again()
        return come, anyone or not streams

    def _positions(self, streams: Iterable[str]) -> Iterator[tuple[str, list[PositionModel]]]:
        """The positions of streams, each behind all frames that were sent before."""
        asked: deque[tuple[str, Iterable[str | bytes]]] = deque()
        for stream in streams:
            asked.append((stream, self._publisher.ask(stream, ANSWER_WAIT, sending=self._sending)))
            if len(asked) == ASKED_TOGETHER:
                yield _answers(*asked.popleft())
        for each in asked:
            yield _answers(*each)

    def _has_come(self, stream: str, position: PositionModel) -> bool:
        """Whether the newest frames sent are the newest that have come."""
        for (of, label), (sequence, start) in self._last.items():
            if of != stream:
                continue
            newest = position.channels.get(label)
            if newest is None:
                return False
            passed = (of, label) not in self._disordered and newest.start_time_ns > start
            if not passed and (newest.sequence, newest.start_time_ns) != (sequence, start):
                return False
        return True

    def _note_services(self, stream: str, positions: Iterable[PositionModel]) -> bool:
        """Whether a service has been started anew since it answered last."""
        restarted = False
        known = self._instances.setdefault(stream, set())
        for position in positions:
            key = f"{stream} {position.instance}"
            self._ahead = min(self._ahead[0], position.ahead_frames), min(self._ahead[1], position.ahead_bytes)
            if position.instance not in known:
                restarted |= bool(known)
                known.add(position.instance)
                for label, newest in position.channels.items():  # a gap after it was there before
                    self._sent.setdefault((stream, label), Ranges()).add(newest.sequence)
                    before = self._before.get((stream, label), newest.start_time_ns)
                    self._before[stream, label] = max(before, newest.start_time_ns)
                self._left_out[key] = (Counter(position.left_out), Counter(position.left_out))
            self._left_out[key] = (self._left_out[key][0], Counter(position.left_out))
        return restarted

    def _settle(self, stream: str, positions: list[PositionModel]) -> None:
        """Forgets what everyone who answers has stored, and sends again what someone waits for."""
        held_from = min((p.unsettled_from_ns for p in positions if p.unsettled_from_ns is not None), default=None)
        waited_for = [
            (label, first, last)
            for position in positions
            for label, channel in position.channels.items()
            for first, last in channel.missing
        ]
        kept: deque[_Kept] = deque()
        missing = []
        for each in self._kept:
            if each.stream == stream and any(
                each.label == label and first <= each.sequence <= last for label, first, last in waited_for
            ):
                missing.append(each)
                kept.append(each)
            elif each.stream == stream and (held_from is None or each.start_ns < held_from):
                self.settled += 1
                if each.frame is not None:
                    self._bytes -= each.size
            else:
                kept.append(each)
        self._kept = kept
        self._put_again(missing)

    # -- what is kept --------------------------------------------------------------------------------

    def _keep(self, frame: RawFrame) -> None:
        try:
            sequence, start = head_of(frame.channel, frame.payload)
        except FrameError:
            self.invalid += 1  # the service counts it: there is nothing to store
            return
        stream, label, size = frame.channel.asset, frame.channel.label, len(frame.payload)
        if (stream, label) not in self._last:
            self._first.add((stream, label))
        self._note_last(stream, label, sequence, start)
        self._sent.setdefault((stream, label), Ranges()).add(sequence)
        self._kept.append(_Kept(frame, stream, label, sequence, start, size))
        self._bytes += size
        while self._bytes > self._most_bytes:
            oldest = next(each for each in self._kept if each.frame is not None)
            oldest.frame = None
            self._bytes -= oldest.size
            self._unkept += 1
            if self._unkept == 1:
                self._note(
                    f"more than {self._most_bytes / 2**20:g} MiB of frames are not stored yet: the oldest are kept no "
                    "longer, and would be lost if the service ended now"
                )

    def _send_again(self) -> None:
        """Waits for the subscribers to come back, then sends what is not known to be stored."""
        try:
            self._publisher.relink(self._wait)
        except DeliveryError as error:
            raise DeliveryError(f"{self._not_stored()}: {error}") from None
        lost = sum(each.frame is None for each in self._kept)
        if lost:
            raise DeliveryError(
                f"{lost} frames are not stored: the service was lost while more than "
                f"{self._most_bytes / 2**20:g} MiB of frames waited to be stored; repeat the replay"
            )
        self._put_again(self._kept)
        self._resent = self._clock()

    def _put_again(self, frames: Iterable[_Kept]) -> None:
        for each in list(frames):
            if each.frame is not None:
                self._publisher.publish(each.frame)
                self._note_last(each.stream, each.label, each.sequence, each.start_ns)

    def _note_last(self, stream: str, label: str, sequence: int, start: int) -> None:
        """A frame was sent, be it again."""
        if start < self._last.get((stream, label), (0, 0))[1]:
            self._disordered.add((stream, label))
        self._last[stream, label] = (sequence, start)

    def _not_stored(self) -> str:
        return f"{len(self._kept)} frames are not stored"

    def _give_up(self, *, answered: bool) -> None:
        if self._reason:
            why = self._reason
        elif not answered:
            why = f"nobody has answered for {self._wait:g} s what is stored; is the service running?"
        else:
            why = "the service answers, and stores nothing more; does somebody else publish on the same keys?"
        raise DeliveryError(f"{self._not_stored()}: {why}")


def _answers(stream: str, texts: Iterable[str | bytes]) -> tuple[str, list[PositionModel]]:
    """Waits for the answers about a stream."""
    return stream, [position for position in map(position_of, texts) if position is not None]
