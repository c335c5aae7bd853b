"""Which frames of a key have been used: sequence numbers against times, by a few points.

A frame that comes again has a number and a time that lie between the same two points; the same number at another time
is another frame: of a publisher that counts anew, or of a clock that was set. Points are thinned out with age, and each
time the clock is set a new stretch begins, so that frames of earlier stretches are still recognised.
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field
from typing import Any

from service.stream.frames import LENGTH_LIMITS, NS

_MOST_POINTS = 48  # of one stretch
_RECENT = 8  # of them that are never thinned out
_MOST_STRETCHES = 4
_SLOWER = 3.0  # times slower than the stretch on average, and ...
_BEFORE_NS = 60 * NS  # ... so much earlier, frames before its first point are taken for frames that were missed

Point = tuple[int, int]  # start [ns], sequence


@dataclass(slots=True)
class Timeline:
    """The points of one key, stretch by stretch; each stretch rises in time."""

    stretches: list[list[Point]] = field(default_factory=lambda: [[]])

    def note(self, start: int, sequence: int) -> None:
        """A frame that has been used, later than all before it since the clock was last set."""
        points = self.stretches[-1]
        if not points or start > points[-1][0]:
            points.append((start, sequence))
            if len(points) > _MOST_POINTS:
                del points[1:-_RECENT:2]

    def begin_stretch(self) -> None:
        """The clock has been set."""
        if self.stretches[-1]:
            self.stretches = [*self.stretches[1 - _MOST_STRETCHES :], []]

    def holds(self, start: int, sequence: int, newest: Point) -> bool:
        """Whether a frame lies on the newest stretch, `newest` being the last of it."""
        return _lies_on([*self.stretches[-1], newest], start, sequence)

    def held_before(self, start: int, sequence: int) -> bool:
        """Whether a frame lies on a stretch before the clock was last set.

        One from before a stretch does not: since then the clock has been set, so that it may be another recording's.
        """
        return any(
            bool(points) and start >= points[0][0] and _lies_on(points, start, sequence)
            for points in self.stretches[:-1]
        )

    def to_dict(self) -> list[list[list[int]]]:
        """JSON-safe."""
        return [[list(point) for point in points] for points in self.stretches]

    @classmethod
    def from_dict(cls, data: Any) -> Timeline:
        return cls(stretches=[[(int(start), int(number)) for start, number in points] for points in data] or [[]])


def _lies_on(points: list[Point], start: int, sequence: int) -> bool:
    if not points:
        return False
    at = bisect.bisect_right(points, start, key=lambda point: point[0])
    if at == 0:  # before the first: missed then, where its number is lower by as much as the time allows
        (first_start, first), (last_start, last) = points[0], points[-1]
        pace = (last_start - first_start) / (last - first) if last > first else LENGTH_LIMITS[1] * NS
        return sequence < first and first_start - start <= _BEFORE_NS + _SLOWER * pace * (first - sequence)
    if at == len(points):
        return start == points[-1][0] and sequence == points[-1][1]
    low, high = points[at - 1][1], points[at][1]
    return low <= sequence <= high if low <= high else sequence >= low or sequence <= high
