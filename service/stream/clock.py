"""Frames whose time stamps contradict what came before, or the host's clock.

One such frame is a fault of its time stamp, and costs that frame. A run of them in good order, while nothing else
comes, is a clock that has been set: the asset's windows then go on at the new time. So no time stamp blinds an asset.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from datetime import UTC, datetime

from service.stream.frames import NS, Frame
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockThresholds:
    """When a time stamp is not believed, and when a clock is."""

    ahead: float = deciding(
        60.0,
        unit="s",
        meaning="time by which a frame may end after the host's clock, and after the frames before it",
        source="not derived: chosen well above the error of clocks that are kept by a time service, and below the "
        "pauses after which a wrong time would be noticed by nobody",
    )
    run: int = deciding(
        8,
        unit="frames",
        meaning="frames of one key in good order that show that its clock has been set",
        source="not derived: chosen so that some seconds of a stream are needed, and one burst is enough",
    )


DEFAULT = ClockThresholds()
_MOST_HELD = 4096  # frames of all keys


@dataclass(slots=True)
class Contradictions:
    """The frames of one asset that are held because their time is not believed, in order of arrival."""

    thresholds: ClockThresholds = DEFAULT
    held: deque[Frame] = field(default_factory=deque)
    runs: dict[str, list[Frame]] = field(default_factory=dict)  # by channel: the newest frames in good order

    @property
    def ahead_ns(self) -> int:
        """Time by which a frame may end after the host's clock [ns]."""
        return round(self.thresholds.ahead * NS)

    def hold(self, frame: Frame) -> bool:
        """Takes a frame in; whether its key has now shown that the clock was set."""
        run = self.runs.setdefault(frame.channel.label, [])
        if run and not _follows(run[-1], frame):
            if (run[-1].sequence, run[-1].start_time_ns) == (frame.sequence, frame.start_time_ns):
                return False  # the same frame again
            run.clear()
        run.append(frame)
        self.held.append(frame)
        if len(self.held) > _MOST_HELD:
            self.held.popleft()
        return len(run) >= self.thresholds.run

    def clear(self) -> list[Frame]:
        """Gives up all that is held, and answers it."""
        frames = list(self.held)
        self.held.clear()
        self.runs.clear()
        return frames


def _follows(before: Frame, frame: Frame) -> bool:
    """Whether a frame continues another in number and time."""
    middle = (before.start_time_ns + before.end_time_ns) // 2
    return frame.sequence == before.sequence + 1 and frame.start_time_ns >= max(middle, before.start_time_ns + 1)


def said(time_ns: int) -> str:
    """A time as people write it."""
    return datetime.fromtimestamp(time_ns // NS, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
