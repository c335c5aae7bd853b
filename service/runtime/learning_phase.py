"""A new asset's first moment: its frames are held until all its channels have had time to begin.

Keys start at different times. Frames that were processed as they come would close the first window without the
channels that begin a little later.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from service.stream.frames import Frame
from service.stream.position import ChannelPosition

LEARN_WAIT = 0.5  # how long a new asset's channels are awaited before its first window [s]
LEARN_BYTES = 64 * 2**20  # frames of a new asset held meanwhile, at most [bytes]


@dataclass(slots=True)
class _Held:
    """A new asset's frames."""

    since: float  # [s]
    frames: list[Frame] = field(default_factory=list)
    bytes: int = 0


class LearningPhase:
    """Holds the frames of assets whose channels are not known yet."""

    def __init__(self, wait: float = LEARN_WAIT, most_bytes: int = LEARN_BYTES) -> None:
        self._wait, self._most_bytes = wait, most_bytes
        self._held: dict[str, _Held] = {}

    @property
    def assets(self) -> list[str]:
        """The assets whose frames are held."""
        return list(self._held)

    def begin(self, asset: str, now: float) -> None:
        """Holds the asset's frames from now on [s]."""
        self._held[asset] = _Held(now)

    def holds(self, asset: str) -> bool:
        """Whether the asset's frames are held."""
        return asset in self._held

    def earliest(self, asset: str) -> int | None:
        """Start of the earliest frame that is held of an asset [ns]."""
        held = self._held.get(asset)
        return min((f.start_time_ns for f in held.frames), default=None) if held else None

    def newest(self, asset: str) -> dict[str, ChannelPosition]:
        """The newest frame that is held of each of an asset's channels."""
        held = self._held.get(asset)
        frames = {frame.channel.label: frame for frame in held.frames} if held else {}
        return {
            label: ChannelPosition(sequence=frame.sequence, start_ns=frame.start_time_ns)
            for label, frame in frames.items()
        }

    def add(self, frame: Frame, now: float) -> list[Frame]:
        """Holds a frame; answers all held frames, in the order received, once the phase is over."""
        held = self._held[frame.channel.asset]
        held.frames.append(frame)
        held.bytes += frame.nbytes
        if now - held.since < self._wait and held.bytes < self._most_bytes:
            return []
        return self.end(frame.channel.asset)

    def end(self, asset: str) -> list[Frame]:
        """Ends the phase; answers the frames that were held."""
        held = self._held.pop(asset, None)
        return held.frames if held else []
