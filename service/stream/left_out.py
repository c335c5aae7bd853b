"""Stretches of a stream's time of which the service left out frames before they were assembled.

There was no room for them, or they came while their asset was retired, or before it was adopted. A window that such a
stretch touches lacks frames that had come: it is refused, with the reason. Nothing is made of what is left of a burst.
Frames that are sent again later, before a window has been refused for them, are not left out: their window is whole.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from service.stream.frames import LATEST_START
from service.stream.samples import Span
from twin.windows import Fault

_MOST = 64  # stretches remembered; beyond, the two oldest are taken for one
_MOST_STARTS = 2048  # frames of a stretch that are known one by one, the newest

NO_ROOM, MANY_STREAMS, UNKNOWN = "no_room", "too_many_streams", "unknown_asset"
RETIRED, UNOPENED, ANOTHERS = "retired", "unopened", "another_asset"
REASONS = {
    NO_ROOM: "they came faster than they could be used, and their queue was full",
    MANY_STREAMS: "frames of too many assets waited at once",
    UNKNOWN: "they came before the asset was adopted",
    RETIRED: "they came while the asset was retired",
    UNOPENED: "they came while the storage could not be used, and there was no more room to keep them in memory",
    ANOTHERS: "they came before their stream was said to be this asset's",
}
"""Why frames are left out, as faults say it."""


class Missing(NamedTuple):
    """Frames that were left out: some are known one by one, the others by the time between two starts."""

    begin_ns: int  # start of the earliest of those others, Unix time [ns] ...
    end_ns: int  # ... and after the start of the latest of them
    frames: Mapping[str, int]  # all of them, by channel
    cause: str = NO_ROOM
    starts: Mapping[tuple[str, int], int] = {}  # of those that are known, by channel and sequence number [ns]

    @property
    def for_room(self) -> bool:
        """Whether they were meant to be used, and had no room."""
        return self.cause in (NO_ROOM, MANY_STREAMS)


@dataclass(slots=True)
class Growing:
    """Frames that are left out one after another, for one reason."""

    cause: str
    begin: int = 0  # of those that are not known one by one [ns]
    last: int = 0
    frames: Counter[str] = field(default_factory=Counter)
    starts: dict[tuple[str, int], int] = field(default_factory=dict)

    def add(self, label: str, sequence: int, start: int) -> None:
        """One more frame."""
        self.frames[label] += 1
        self.starts[label, sequence] = start
        if len(self.starts) > _MOST_STARTS:
            self._widen(*[self.starts.pop(next(iter(self.starts)))] * 2)

    def join(self, other: Missing) -> None:
        """Frames that were left out before they came so far."""
        self.frames.update(other.frames)
        if other.end_ns:
            self._widen(other.begin_ns, other.end_ns - 1)
        for (label, sequence), start in other.starts.items():
            self.add(label, sequence, start)
            self.frames[label] -= 1

    def _widen(self, begin: int, last: int) -> None:
        self.begin, self.last = min(self.begin or begin, begin), max(self.last, last)

    @property
    def missing(self) -> Missing:
        """All of them so far."""
        return Missing(self.begin, self.last + 1 if self.begin else 0, self.frames, self.cause, self.starts)


@dataclass(slots=True)
class Stretch:
    """From the first start of a frame that was left out to after the last one, Unix time [ns]; and single frames."""

    begin: int
    end: int
    frames: int
    cause: str = NO_ROOM
    starts: dict[tuple[str, int], int] = field(default_factory=dict)
    said: bool = False  # whether a window has been refused for it

    @property
    def makes_windows(self) -> bool:
        """Whether it is a refused window where it touches none: its frames were meant to be used."""
        return self.cause in (NO_ROOM, MANY_STREAMS)

    def touches(self, after: int, before: int) -> bool:
        """Whether a frame starts after a time and before another [ns]."""
        if self.begin < self.end and self.begin < before and self.end - 1 > after:
            return True
        return any(after < start < before for start in self.starts.values())

    def divided(self, after: int, before: int) -> tuple[Stretch, Stretch]:
        """Those single frames that start after a time and before another, with all that is not single; and the rest."""
        here = {key: start for key, start in self.starts.items() if after < start < before}
        rest = {key: start for key, start in self.starts.items() if key not in here}
        others = Stretch(0, 0, len(rest), self.cause, rest, self.said)
        begin, end = (self.begin, self.end) if self.begin < self.end else (min(here.values()), max(here.values()) + 1)
        begin, end = min([begin, *here.values()]), max([end, *(start + 1 for start in here.values())])
        return Stretch(begin, end, self.frames - len(rest), self.cause, said=self.said), others


@dataclass(slots=True)
class LeftOut:
    """The stretches of one asset that windows to come may touch, in order of time."""

    stretches: list[Stretch] = field(default_factory=list)
    windows: int = 0  # that were refused for want of room

    def add(self, missing: Missing) -> None:
        """Frames of a stretch were left out."""
        starts = dict(missing.starts)
        new = Stretch(missing.begin_ns, missing.end_ns, sum(missing.frames.values()), missing.cause, starts)
        self.stretches = sorted([*self.stretches, new], key=lambda each: each.begin)
        while len(self.stretches) > _MOST:
            first, second = (each.divided(0, LATEST_START)[0] for each in self.stretches[:2])
            both = Stretch(
                min(first.begin, second.begin), max(first.end, second.end), first.frames + second.frames, second.cause
            )
            self.stretches[:2] = [both]

    def came(self, label: str, sequence: int, start: int) -> bool:
        """Whether a frame that has come is one of those that were left out before, and is so no longer."""
        for each in self.stretches:
            if each.starts.get((label, sequence)) == start:
                del each.starts[label, sequence]
                each.frames -= 1
                if each.begin >= each.end and not each.starts:
                    self.stretches.remove(each)
                return True
        return False

    @property
    def earliest(self) -> int | None:
        """Begin of the earliest stretch for which a window is still to be refused [ns]."""
        return min((each.begin for each in self.stretches if each.makes_windows and not each.said), default=None)

    def faults(self, span: Span, before: int, after: int, longest: int) -> list[Fault]:
        """Why a window cannot be used that a stretch touches; empty where none does.

        before, after  by how much a stretch may end before the window or begin after it and still be of the same
                       burst [ns]
        longest        how long a frame of it may be, of which the stretch knows the start alone [ns]
        """
        times = span.start_ns - before - longest, span.end_ns + after
        touching = []
        for each in [x for x in self.stretches if x.touches(*times)]:
            here, rest = each.divided(*times)
            self.stretches = [x for x in self.stretches if x is not each] + [here] + ([rest] if rest.starts else [])
            touching.append(here)
        found = []
        for cause in dict.fromkeys(each.cause for each in touching):
            of_cause = [each for each in touching if each.cause == cause]
            frames, new = (sum(x.frames for x in of_cause if not (x.said and unsaid)) for unsaid in (False, True))
            detail = f"{frames} frames left out: {REASONS[cause]}"
            kind = "shed" if of_cause[0].makes_windows else "left_out"
            found.append(Fault(kind=kind, channel="", count=max(new, 1), action="refused", detail=detail))
        self.windows += any(fault.kind == "shed" for fault in found)
        for each in touching:
            each.said = True
        return found

    def alone(self, until: float, passed: int) -> Iterator[Span]:
        """The stretches that end before a time and have touched no window [ns], as windows of their own.

        passed  end of the newest window [ns]
        """
        for each in [x for x in self.stretches if x.makes_windows and not x.said and x.end < until]:
            each.begin = max(each.begin, passed)
            if each.begin < each.end:
                yield Span(each.begin, each.end)
                passed = each.end
            each.said = True

    def forget(self, passed: int, longest: int) -> None:
        """Gives up what no window after a time can touch [ns]."""
        for each in self.stretches:
            each.starts = {key: start for key, start in each.starts.items() if start + longest > passed}
        self.stretches = [
            each
            for each in self.stretches
            if each.starts
            or (each.begin < each.end and not (each.said or not each.makes_windows))
            or (each.begin < each.end and each.end + longest > passed)
        ]
