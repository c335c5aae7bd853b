"""Assets that are not known: where people are to be asked, they are named here, in a bounded list that expires.

Their frames are counted in the network's callback and left out there: an unknown asset has no queue and no folder. The
list is in memory, so that no callback waits for the database; `runtime/offer_writer.py` writes it for people
(`offers.py`), and a restart begins with what was written.

Once an asset has been adopted its frames are used, but not from the middle of what a publisher sends that keeps its
frames until they are stored: it is asked to send all of them again, in their order, by another `instance` in the answer
to a question, and what it has sent before is left out still. What is on its way when it asks may come after the
question, so that it is let in by the first question before which nothing has come for a moment; until then it is
answered that nothing has come, and sends nothing.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from service.contract.position import why_unknown
from service.files.rig_difference import digest_of
from service.steady_clock import later_time_ns

log = logging.getLogger(__name__)

MOST_CHANNELS = 32  # of one unknown asset that are named
RIGS_BYTES = 2**21  # of all rig files that are offered for unknown assets, as text
ASKED_WITHIN = 30.0  # a publisher that has asked within this time is going to ask again [s] ...
NEXT_QUESTION = 15.0  # ... and is waited for so long [s]
ON_THE_WAY = 0.5  # frames that were sent before a question may come so much later than it [s]
MOST_ASKING = 1024  # publishers that are known to ask
SAY_EVERY = 60.0  # that assets are unknown is logged so often at most [s]

Elsewhere = Callable[[str], str | None]
"""Why the frames of a stream are not used here, but by another service; None where they are."""


def everything_here(stream: str) -> None:
    """One service has all streams."""


@dataclass(slots=True, kw_only=True)
class Unknown:
    """What is known of an unknown asset."""

    asset: str
    first_ns: int  # Unix time at which it was first and last received [ns]
    last_ns: int
    frames: int = 0
    channels: frozenset[str] = frozenset()
    dismissed_ns: int | None = None  # Unix time at which it was dismissed [ns]
    rig: Mapping[str, Any] | None = field(default=None, compare=False)  # the newest rig file that can be used
    digest: str | None = None  # of that
    rig_bytes: int = 0  # what its text takes


class UnknownAssets:
    """Which streams are let in, and the list of those that are not. Safe to use from several threads.

    asks    whether an unknown asset waits for a person; else everything is let in
    most    assets in the list
    expire  time without a frame, or since it was dismissed, after which one leaves it [s]
    clock   the monotonic clock [s]
    now_ns  Unix time, which is not set back [ns]
    elsewhere  which streams are another service's: their frames are left out, and nobody is asked about them
    """

    def __init__(
        self,
        *,
        asks: bool = False,
        most: int = 100,
        expire: float = 86_400.0,
        clock: Callable[[], float] = time.monotonic,
        now_ns: Callable[[], int] = later_time_ns,
        elsewhere: Elsewhere = everything_here,
    ) -> None:
        self._elsewhere = elsewhere
        self._asks, self._most, self._expire_ns = asks, most, round(expire * 1e9)
        self._clock, self._now_ns = clock, now_ns
        self._known: Callable[[str], bool] | None = None
        self._lock = threading.RLock()
        self._entries: dict[str, Unknown] = {}  # those that were dismissed, too
        self._asking: OrderedDict[str, float] = OrderedDict()  # streams whose publishers ask how far they are stored
        self._let_in: set[str] = set()
        self._renewed: set[str] = set()  # of them, those that were not known from the start
        self._waiting: dict[str, float] = {}  # adopted: until when the next question is waited for,
        self._came: dict[str, float] = {}  # and when a frame has come last, or the first question has
        self._said = float("-inf")
        self.frames = 0  # that were left out
        self.forgotten = 0  # assets that left the list for want of room

    @property
    def asks(self) -> bool:
        """Whether an unknown asset waits for a person."""
        return self._asks

    def restore(self, entries: Iterable[Unknown]) -> None:
        """Goes on with what was written before a restart."""
        with self._lock:
            for entry in entries:
                self._add(replace(entry))

    def begin(self, known: Callable[[str], bool], streams: Iterable[str]) -> None:
        """From now on only streams whose asset is known are let in; `streams` are known from the start."""
        with self._lock:
            self._let_in.update(streams)
            self._known = known

    # -- for the network's callbacks -----------------------------------------------------------------

    def admits(self, stream: str, channel: str | None = None) -> bool:
        """Whether a frame of a stream is used; one of an unknown asset is counted."""
        if (there := self._elsewhere(stream)) is not None:
            self._leave_out(stream, there)
            return False
        if not self._asks or self._known is None or stream in self._let_in:
            return True
        with self._lock:
            if self._known(stream):
                return self._begins(stream)
            self._count(stream, channel)
            return False

    def asked(self, stream: str) -> bool:
        """A publisher asks how far a stream is stored; whether the frames that follow are used."""
        if self._elsewhere(stream) is not None:
            return False
        if not self._asks or self._known is None or stream in self._let_in:
            return True
        with self._lock:
            now = self._clock()
            if self._known(stream) and not self._has_some_on_their_way(stream, now):
                self._open(stream)
                return True
            self._asking.pop(stream, None)
            self._asking[stream] = now
            if len(self._asking) > MOST_ASKING:
                self._asking.popitem(last=False)
            return False

    def offered(self, stream: str, rig: Mapping[str, Any], size: int) -> None:
        """A rig file that can be used has come for an unknown asset; the newest is kept.

        size  of its text [bytes]
        """
        if self._elsewhere(stream) is not None:
            return
        digest = digest_of(rig)
        with self._lock:
            entry = self._entry(stream)
            if entry.dismissed_ns is not None:
                return
            entry.rig, entry.digest, entry.rig_bytes, entry.last_ns = rig, digest, size, self._now_ns()
            taken = sum(each.rig_bytes for each in self._entries.values())
            for each in sorted(self._entries.values(), key=_business):
                if taken > RIGS_BYTES and each is not entry:
                    taken -= each.rig_bytes
                    each.rig, each.digest, each.rig_bytes = None, None, 0

    def is_known(self, stream: str) -> bool:
        """Whether a stream's asset is known, or everything is let in."""
        if self._elsewhere(stream) is not None:
            return False
        return not self._asks or self._known is None or stream in self._let_in or self._known(stream)

    def renewed(self, stream: str) -> bool:
        """Whether a stream was let in later than the service was started."""
        return stream in self._renewed

    def refusal(self, stream: str) -> str | None:
        """Why no frames of a stream are used, or None."""
        if (there := self._elsewhere(stream)) is not None:
            return there
        if self.is_known(stream):
            return None
        return why_unknown(stream)

    # -- for whoever writes the list -----------------------------------------------------------------

    def entries(self) -> dict[str, Unknown]:
        """The unknown assets, those that were dismissed too."""
        with self._lock:
            self._forget()
            waiting = [n for n in self._entries if self._elsewhere(n) is None and not self.is_known(n)]
            return {name: replace(self._entries[name]) for name in waiting}

    def dismiss(self, asset: str, at_ns: int) -> None:
        """Takes an asset off the list, and does not list it again until it would have been forgotten.

        at_ns  when a person has dismissed it [Unix time, ns]
        """
        with self._lock:
            entry = Unknown(asset=asset, first_ns=at_ns, last_ns=at_ns, dismissed_ns=at_ns)
            if self._entries.get(asset) != entry and at_ns >= self._now_ns() - self._expire_ns:
                self._add(entry)

    # -- within --------------------------------------------------------------------------------------

    def _begins(self, stream: str) -> bool:
        """Whether a stream whose asset has become known is let in now, rather than after a question."""
        now, until = self._clock(), self._waiting.get(stream)
        self._came[stream] = now
        if until is None:
            self._entries.pop(stream, None)
            if now - self._asking.get(stream, float("-inf")) < ASKED_WITHIN:
                self._waiting[stream] = now + NEXT_QUESTION
                return False
        elif now < until:
            return False
        self._open(stream)
        return True

    def _has_some_on_their_way(self, stream: str, now: float) -> bool:
        """Whether frames may come that were sent before a question about a stream that has become known."""
        if stream not in self._entries and stream not in self._asking and stream not in self._came:
            return False  # nothing of it was left out
        until = self._waiting.setdefault(stream, now + NEXT_QUESTION)
        return now < until and now - self._came.setdefault(stream, now) < ON_THE_WAY

    def _leave_out(self, stream: str, why: str) -> None:
        with self._lock:
            self.frames += 1
            if self._clock() - self._said < SAY_EVERY:
                return
            self._said = self._clock()
        log.warning("frames are left out: %s", why, extra={"asset": stream})

    def _open(self, stream: str) -> None:
        for part in (self._entries, self._asking, self._waiting, self._came):
            part.pop(stream, None)
        self._renewed.add(stream)
        self._let_in.add(stream)

    def _count(self, stream: str, channel: str | None) -> None:
        self.frames += 1
        entry = self._entry(stream)
        if entry.dismissed_ns is not None:
            return
        entry.frames += 1
        entry.last_ns = self._now_ns()
        if channel is not None and len(entry.channels) < MOST_CHANNELS and channel not in entry.channels:
            entry.channels |= {channel}

    def _entry(self, stream: str) -> Unknown:
        """What is known of a stream, which is listed from now on where nothing is."""
        entry = self._entries.get(stream)
        if entry is not None:
            return entry
        self._forget()
        now_ns, now = self._now_ns(), self._clock()
        entry = Unknown(asset=stream, first_ns=now_ns, last_ns=now_ns)
        self._add(entry)
        if now - self._said >= SAY_EVERY:
            self._said = now
            log.warning(
                "asset %s is unknown: its frames are left out until it is adopted (gear-twin remote assets unknown)",
                stream, extra={"asset": stream},
            )  # fmt: skip
        return entry

    def _add(self, entry: Unknown) -> None:
        """Adds an entry, for which the quietest makes room; as many that were dismissed are known as are listed."""
        self._entries.pop(entry.asset, None)
        dismissed = entry.dismissed_ns is not None
        others = [each for each in self._entries.values() if (each.dismissed_ns is not None) is dismissed]
        if len(others) >= self._most:
            del self._entries[min(others, key=_business).asset]
            self.forgotten += not dismissed
        self._entries[entry.asset] = entry

    def _forget(self) -> None:
        limit = self._now_ns() - self._expire_ns
        for name in [name for name, each in self._entries.items() if (each.dismissed_ns or each.last_ns) < limit]:
            del self._entries[name]


def _business(entry: Unknown) -> tuple[int, int]:
    """How many frames have come of an asset, and when."""
    return entry.frames, entry.last_ns
