"""Assets that are not known: where people are to be asked, they are named here, in a bounded list that expires.

Their frames are counted in the network's callback and left out there: an unknown asset has no queue, no row in the
database and no folder. The list is kept in memory: after a restart it fills with what still sends.

Once an asset has been adopted its frames are used, but not from the middle of what a publisher sends that keeps its
frames until they are stored: it is asked to send all of them again, in their order, by another `instance` in the answer
to its next question, and what it sends before that question is left out still.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from service.contract.position import why_unknown

log = logging.getLogger(__name__)

MOST_CHANNELS = 32  # of one unknown asset that are named
RIGS_BYTES = 2**21  # of all rig files that are offered for unknown assets, as text
ASKED_WITHIN = 30.0  # a publisher that has asked within this time is going to ask again [s] ...
NEXT_QUESTION = 15.0  # ... and is waited for so long [s]
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
    channels: set[str] = field(default_factory=set)
    rig: Mapping[str, Any] | None = None  # the newest rig file that was offered for it, which can be used
    rig_bytes: int = 0  # what its text takes
    seen: float = 0.0  # when it was received last, on the monotonic clock [s]


class UnknownList(Protocol):
    """The unknown assets as people see them."""

    @property
    def asks(self) -> bool: ...

    @property
    def frames(self) -> int: ...

    @property
    def forgotten(self) -> int: ...

    def listed(self) -> list[Unknown]: ...

    def find(self, asset: str) -> Unknown | None: ...

    def dismiss(self, asset: str) -> None: ...


class UnknownAssets:
    """Which streams are let in, and the list of those that are not. Safe to use from several threads.

    asks    whether an unknown asset waits for a person; else everything is let in
    most    assets in the list
    expire  time without a frame after which one leaves it [s]
    elsewhere  which streams are another service's: their frames are left out, and nobody is asked about them
    """

    def __init__(
        self,
        *,
        asks: bool = False,
        most: int = 100,
        expire: float = 86_400.0,
        clock: Callable[[], float] = time.monotonic,
        now_ns: Callable[[], int] = time.time_ns,
        elsewhere: Elsewhere = everything_here,
    ) -> None:
        self._elsewhere = elsewhere
        self._asks, self._most, self._expire = asks, most, expire
        self._clock, self._now_ns = clock, now_ns
        self._known: Callable[[str], bool] | None = None
        self._lock = threading.RLock()
        self._listed: dict[str, Unknown] = {}
        self._dismissed: OrderedDict[str, float] = OrderedDict()  # until when
        self._asking: OrderedDict[str, float] = OrderedDict()  # streams whose publishers ask how far they are stored
        self._let_in: set[str] = set()
        self._renewed: set[str] = set()  # of them, those that were not known from the start
        self._waiting: dict[str, float] = {}  # adopted: until when the next question is waited for
        self._said = float("-inf")
        self.frames = 0  # that were left out
        self.forgotten = 0  # assets that left the list for want of room

    @property
    def asks(self) -> bool:
        """Whether an unknown asset waits for a person."""
        return self._asks

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
            if self._known(stream):
                self._open(stream)
                return True
            self._asking.pop(stream, None)
            self._asking[stream] = self._clock()
            if len(self._asking) > MOST_ASKING:
                self._asking.popitem(last=False)
            return False

    def offered(self, stream: str, rig: Mapping[str, Any], size: int) -> None:
        """A rig file that can be used has come for an unknown asset; the newest is kept.

        size  of its text [bytes]
        """
        with self._lock:
            if self._is_dismissed(stream) or self._elsewhere(stream) is not None:
                return
            entry = self._listed.get(stream) or self._list(stream)
            entry.rig, entry.rig_bytes = rig, size
            entry.seen, entry.last_ns = self._clock(), self._now_ns()
            taken = sum(each.rig_bytes for each in self._listed.values())
            for each in sorted(self._listed.values(), key=lambda each: (each.frames, each.seen)):
                if taken > RIGS_BYTES and each is not entry:
                    taken -= each.rig_bytes
                    each.rig, each.rig_bytes = None, 0

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

    # -- for people ----------------------------------------------------------------------------------

    def listed(self) -> list[Unknown]:
        """The unknown assets, the busiest first."""
        with self._lock:
            self._forget()
            found = [each for each in self._listed.values() if self._is_unknown(each.asset)]
            return sorted(found, key=lambda each: (-each.frames, each.asset))

    def find(self, asset: str) -> Unknown | None:
        """An unknown asset of the list."""
        with self._lock:
            self._forget()
            return self._listed.get(asset) if self._is_unknown(asset) else None

    def dismiss(self, asset: str) -> None:
        """Takes an asset off the list, and does not list it again until it would have been forgotten."""
        with self._lock:
            self._listed.pop(asset, None)
            self._dismissed.pop(asset, None)
            self._dismissed[asset] = self._clock() + self._expire
            if len(self._dismissed) > self._most:
                self._dismissed.popitem(last=False)

    def figures(self) -> dict[str, float]:
        """Figures for /metrics."""
        return {
            "unknown_assets": len(self.listed()),
            "unknown_asset_frames": self.frames,
            "unknown_assets_forgotten": self.forgotten,
        }

    # -- within --------------------------------------------------------------------------------------

    def _begins(self, stream: str) -> bool:
        """Whether a stream whose asset has become known is let in now, rather than after a question."""
        now, until = self._clock(), self._waiting.get(stream)
        if until is None:
            entry = self._listed.pop(stream, None)
            asking = now - self._asking.get(stream, float("-inf")) < ASKED_WITHIN
            if entry is not None and entry.frames and asking:
                self._waiting[stream] = now + NEXT_QUESTION
                return False
        elif now < until:
            return False
        self._open(stream)
        return True

    def _is_unknown(self, stream: str) -> bool:
        """Whether a stream waits for people."""
        return self._elsewhere(stream) is None and not self.is_known(stream)

    def _leave_out(self, stream: str, why: str) -> None:
        with self._lock:
            self.frames += 1
            if self._clock() - self._said < SAY_EVERY:
                return
            self._said = self._clock()
        log.warning("frames are left out: %s", why, extra={"asset": stream})

    def _open(self, stream: str) -> None:
        for part in (self._listed, self._asking, self._waiting, self._dismissed):
            part.pop(stream, None)
        self._renewed.add(stream)
        self._let_in.add(stream)

    def _count(self, stream: str, channel: str | None) -> None:
        self.frames += 1
        if self._is_dismissed(stream):
            return
        entry = self._listed.get(stream) or self._list(stream)
        entry.frames += 1
        entry.seen, entry.last_ns = self._clock(), self._now_ns()
        if channel is not None and len(entry.channels) < MOST_CHANNELS:
            entry.channels.add(channel)

    def _list(self, stream: str) -> Unknown:
        self._forget()
        while len(self._listed) >= self._most:
            quietest = min(self._listed.values(), key=lambda each: (each.frames, each.seen))
            del self._listed[quietest.asset]
            self.forgotten += 1
        now_ns, now = self._now_ns(), self._clock()
        entry = self._listed[stream] = Unknown(asset=stream, first_ns=now_ns, last_ns=now_ns, seen=now)
        if now - self._said >= SAY_EVERY:
            self._said = now
            log.warning(
                "asset %s is unknown: its frames are left out until a person adopts it (gear-twin assets unknown)",
                stream, extra={"asset": stream},
            )  # fmt: skip
        return entry

    def _is_dismissed(self, stream: str) -> bool:
        until = self._dismissed.get(stream)
        if until is not None and until < self._clock():
            del self._dismissed[stream]
            until = None
        return until is not None

    def _forget(self) -> None:
        limit = self._clock() - self._expire
        for name in [name for name, each in self._listed.items() if each.seen < limit]:
            del self._listed[name]
