"""The first frame of each key after a start, held against the newest that is stored of it.

Whoever joins a network is given what publishers still hold, and nobody says whether that was all of it: an answer that
takes too long ends early, and may leave out whole keys. Where the first frame of a key does not follow the newest one
that is stored, publishers are asked for that key once more, and what lies behind the gap waits until they have
answered, and until publishers that keep frames have had time to notice the start and to send them again; silence does
not end the window before. They are asked, too, where nothing of a key has come that others of its stream have gone on
without. What is missing after that is gone: it is a fault of the window that it was of.
"""

from __future__ import annotations

import logging
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

from service.runtime.reception import Reception
from service.stream.channels import CHANNEL_KINDS
from service.stream.wire.topics import Channel

log = logging.getLogger(__name__)

ANSWER_WAIT = 10.0  # for the publishers of one key [s]
SENT_AGAIN_WITHIN = 8.0  # publishers that keep frames ask every 2 s, and send again what is not stored [s]
LOOK_EVERY = 0.25  # whether a gap has been filled [s]
BEHIND_OTHERS = 1.0  # what comes of a key so long after the first of its stream is no matter of the network's order [s]
MOST_ASKED = 32  # keys at the same time
_MOST_KEYS = 2**16  # whose first frame has been seen


class Caches(Protocol):
    """What is needed of a `Transport`."""

    def ask_again(self, channel: Channel, seconds: float, done: Callable[[], None]) -> None: ...


class _Held(NamedTuple):
    """A key whose frames wait."""

    least: float  # waits until then, on the monotonic clock [s] ...
    until: float = float("inf")  # ... and no longer than this; infinite before its publishers are asked
    answered: bool = False


class FirstFrames:
    """Looks at the first frame of each key.

    behind    puts a call behind the frames of a stream that have come; where there is no room for it, it is not made
    asset_of  the asset that a stream belongs to at present
    """

    def __init__(
        self,
        reception: Reception,
        caches: Caches,
        behind: Callable[[str, Callable[[], None]], object],
        *,
        asset_of: Callable[[str], str] = lambda stream: stream,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._reception, self._caches, self._behind, self._clock = reception, caches, behind, clock
        self._asset_of = asset_of
        self._seen: set[Channel] = set()
        self._begun: set[str] = set()  # streams
        self._held: dict[Channel, _Held] = {}
        self._holding: Counter[str] = Counter()  # keys that are held, by stream
        self._missing: dict[Channel, float] = {}  # keys of which nothing has come, and when they are asked for [s]
        self._due: deque[Channel] = deque()  # keys that are to be asked for
        self._asked: set[Channel] = set()  # keys that are being asked for
        self._look_at = 0.0

    def fed(self, channel: Channel, asset: str) -> None:
        """A frame of a stream's channel has been handed to the asset that the stream belongs to."""
        if channel in self._seen or len(self._seen) >= _MOST_KEYS or CHANNEL_KINDS[channel.kind].slow:
            return
        begins = channel.asset not in self._begun
        self._seen.add(channel)
        self._begun.add(channel.asset)
        self._missing.pop(channel, None)
        position = self._reception.position(asset) if begins else None
        if position is not None:
            self._await(channel.asset, position.channels)
        gap = self._reception.first_gap(asset, channel.label)
        if gap is None:
            return
        log.info(
            "%s: frames %d to %d of %s have not come: their publishers are asked once more",
            asset, *gap, channel.label, extra={"asset": asset},
        )  # fmt: skip
        self._reception.hold(asset, channel.label, True)
        self._held[channel] = _Held(self._clock() + SENT_AGAIN_WITHIN)
        self._holding[channel.asset] += 1
        self._due.append(channel)

    def __call__(self) -> None:
        """Asks for keys that others have gone on without, and lets go on what has waited too long for an answer.

        Called between frames.
        """
        if not (self._held or self._missing or self._due):
            return
        now = self._clock()
        for channel in [channel for channel, due in self._missing.items() if due < now]:
            del self._missing[channel]
            log.info(
                "%s: nothing of %s has come since the start: its publishers are asked once more",
                channel.asset, channel.label, extra={"asset": channel.asset},
            )  # fmt: skip
            self._due.append(channel)
        while self._due and len(self._asked) < MOST_ASKED:
            self._ask(self._due.popleft(), now)
        if now >= self._look_at:
            self._look_at = now + LOOK_EVERY
            for channel, held in list(self._held.items()):
                if (held.answered and held.least < now) or held.until < now or not self._waits(channel):
                    self._asked.discard(channel)
                    self._go_on(channel)

    def holds(self, stream: str) -> bool:
        """Whether frames of a stream wait for those before them: its silence ends no window then."""
        return stream in self._holding

    def _waits(self, channel: Channel) -> bool:
        """Whether anything before the frames of a key is missing still."""
        return self._reception.first_gap(self._asset_of(channel.asset), channel.label) is not None

    def _ask(self, channel: Channel, now: float) -> None:
        """Has the publishers of a key asked."""
        if channel in self._held:
            self._held[channel] = self._held[channel]._replace(until=now + 2 * ANSWER_WAIT)
        self._asked.add(channel)
        self._caches.ask_again(channel, ANSWER_WAIT, lambda: self._answered(channel))

    def _await(self, stream: str, labels: Iterable[str]) -> None:
        """Something of a stream has come: all its channels that make windows are to follow."""
        due = self._clock() + BEHIND_OTHERS
        for label in labels:
            kind, _, name = label.partition("/")
            channel = Channel(stream, kind, name)
            if channel not in self._seen and not CHANNEL_KINDS[kind].slow:
                self._missing[channel] = due

    def _answered(self, channel: Channel) -> None:
        """All that publishers still have lies in the stream's queue; called by any thread."""
        self._asked.discard(channel)
        self._behind(channel.asset, lambda: self._note_answer(channel))

    def _note_answer(self, channel: Channel) -> None:
        if channel in self._held:
            self._held[channel] = self._held[channel]._replace(answered=True)

    def _go_on(self, channel: Channel) -> None:
        if self._held.pop(channel, None) is not None:
            self._holding -= Counter([channel.asset])
            self._reception.hold(self._asset_of(channel.asset), channel.label, False)
