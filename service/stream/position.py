"""How far an asset's stream has come: what has been received, and from which time on it is held in memory only."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from service.stream.order import Lane

_MOST_GAPS = 16  # of one channel that are listed


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelPosition:
    """The newest frame of a channel, and which frames before it are waited for."""

    sequence: int
    start_ns: int
    missing: tuple[tuple[int, int], ...] = ()  # sequence numbers, [first, last]


@dataclass(frozen=True, slots=True, kw_only=True)
class Position:
    """An asset's stream as of now."""

    unsettled_from_ns: int | None = None  # start of the earliest frame that is held in memory only
    settled_until_ns: int | None = None  # end of the newest window; None before the first
    channels: Mapping[str, ChannelPosition] = field(default_factory=dict)
    left_out: Mapping[str, int] = field(default_factory=dict)  # frames by cause, since the asset was first seen
    shed: int = 0  # windows that were left out for want of room, since the service was started


def missing_of(lane: Lane) -> tuple[tuple[int, int], ...]:
    """The numbers that a channel's frames wait for; those below the first of all too, since nobody knows the lowest."""
    before = -1 if lane.last is None else lane.last[0]
    gaps = []
    for _, sequence, _ in lane.queue:
        if before + 1 < sequence:
            gaps.append((before + 1, sequence - 1))
        before = sequence
    return tuple(gaps[:_MOST_GAPS])


def earliest(times: Iterable[int | None]) -> int | None:
    """The earliest of some times; None where there is none."""
    return min((time for time in times if time is not None), default=None)
