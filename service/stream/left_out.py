"""Stretches of a stream's time of which frames were left out before they were assembled, for want of room.

A window that such a stretch touches lacks frames that had come. It is refused, with the reason, and a stretch that no
window touches is a refused window of its own: whatever is left out is said, and nothing is made of what is left.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from service.stream.samples import Span
from twin.windows import Fault

_MOST = 64  # stretches remembered; beyond, the two oldest are taken for one


@dataclass(slots=True)
class Stretch:
    """From the first start of a frame that was left out to after the last one, Unix time [ns]."""

    begin: int
    end: int
    frames: int
    said: bool = False  # whether a window has been refused for it


@dataclass(slots=True)
class LeftOut:
    """The stretches of one asset that windows to come may touch, in order of time."""

    stretches: list[Stretch] = field(default_factory=list)
    windows: int = 0  # that were refused

    def add(self, begin: int, end: int, frames: int) -> None:
        """Frames of a stretch were left out."""
        self.stretches = sorted([*self.stretches, Stretch(begin, end, frames)], key=lambda each: each.begin)
        while len(self.stretches) > _MOST:
            first, second, *rest = self.stretches
            both = Stretch(first.begin, max(first.end, second.end), first.frames + second.frames)
            self.stretches = [both, *rest]

    @property
    def earliest(self) -> int | None:
        """Begin of the earliest stretch for which no window has been refused yet [ns]."""
        return min((each.begin for each in self.stretches if not each.said), default=None)

    def fault(self, span: Span, before: int, after: int) -> Fault | None:
        """Why a window cannot be used that a stretch touches; None where none does.

        before, after  by how much a stretch may end before the window or begin after it and still be of the same
                       burst [ns]
        """
        touching = [x for x in self.stretches if x.begin < span.end_ns + after and x.end > span.start_ns - before]
        if not touching:
            return None
        frames, new = (sum(x.frames for x in touching if not (x.said and unsaid)) for unsaid in (False, True))
        for each in touching:
            each.said = True
        self.windows += 1
        detail = f"{frames} frames left out: they came faster than they could be used, and their queue was full"
        return Fault(kind="shed", channel="", count=max(new, 1), action="refused", detail=detail)

    def alone(self, until: float, passed: int) -> Iterator[Span]:
        """The stretches that end before a time and have touched no window [ns], as windows of their own.

        passed  end of the newest window [ns]
        """
        for each in [x for x in self.stretches if not x.said and x.end < until]:
            each.begin = max(each.begin, passed)
            if each.begin < each.end:
                yield Span(each.begin, each.end)
                passed = each.end
            each.said = True

    def forget(self, passed: int) -> None:
        """Gives up what no window after a time can touch [ns]."""
        self.stretches = [each for each in self.stretches if not (each.said and each.end < passed)]
