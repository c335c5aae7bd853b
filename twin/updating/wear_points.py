"""What windows measured of the wear, kept so that a depth which is inspected later can be weighed against it.

    z = x + h·b + v

x  true work at the window, cumulative  [rad/N]      z  work of the depth that the window gave
h  what all depths by one method are off by together, one standard deviation; b is the same for neighbouring depths
v  what is independent from window to window
"""

from __future__ import annotations

from dataclasses import dataclass, replace

MOST_POINTS = 120


@dataclass(frozen=True, slots=True, kw_only=True)
class WearPoint:
    """One window's measure of the wear."""

    revolutions: float  # N, of the pinion
    depth: float  # [m]
    work: float  # z [rad/N]
    shared_std: float  # h [rad/N]
    own_std: float  # of v [rad/N]

    def rescaled(self, factor: float) -> WearPoint:
        """The same depth on another curve, whose work at it is `factor` times this one's."""
        return replace(
            self, work=self.work * factor, shared_std=self.shared_std * factor, own_std=self.own_std * factor
        )  # fmt: skip


Points = tuple[WearPoint, ...]


def with_point(points: Points, point: WearPoint) -> Points:
    """The points with one more; every second of the older half is dropped where they become too many."""
    points = (*points, point)
    if len(points) <= MOST_POINTS:
        return points
    half = MOST_POINTS // 2
    return (*points[:half:2], *points[half:])
