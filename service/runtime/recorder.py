"""From what comes on the network to recordings, be it one file or a folder of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from service.errors import FrameError
from service.stream.inbox import Arrival, Item, Marker
from service.stream.wire.codec import decode
from service.stream.wire.topics import Channel


class Recorded(NamedTuple):
    """How many frames were written, and what became of the others."""

    frames: int = 0
    refused: int = 0  # that break the contract
    left_out: int = 0  # that came faster than they could be written
    missed: int = 0  # that were lost on the way


class Recordings(Protocol):
    """Where frames are written: one file, or a folder."""

    def write(self, channel: Channel, start_ns: int, end_ns: int, payload: bytes) -> None: ...


class Recorder:
    """Takes frames to recordings, as they came; those that break the contract are counted.

    asset_of  the asset of a stream; None where its frames are not recorded
    noted     called with each frame that was written: its stream, channel, number and start [ns]
    """

    def __init__(
        self,
        recordings: Recordings,
        asset_of: Callable[[str], str | None] = lambda stream: stream,
        noted: Callable[[str, str, int, int], None] = lambda stream, label, sequence, start_ns: None,
    ) -> None:
        self._recordings, self._asset_of, self._noted = recordings, asset_of, noted
        self.frames = self.refused = 0

    def take(self, item: Item) -> None:
        """Writes a frame, or answers a question about those before it."""
        if isinstance(item, Marker):
            item.reached()
        elif isinstance(item, Arrival) and (asset := self._asset_of(item.stream)) is not None:
            try:
                frame = decode(item.channel, item.payload)
            except FrameError:
                self.refused += 1
                return
            channel = item.channel if asset == item.stream else item.channel._replace(asset=asset)
            self._recordings.write(channel, frame.start_time_ns, frame.end_time_ns, item.payload)
            self._noted(item.stream, item.channel.label, frame.sequence, frame.start_time_ns)
            self.frames += 1
