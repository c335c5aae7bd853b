"""A live stream kept as a recording: `gear-twin record`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Event
from typing import NamedTuple, Protocol

from service.errors import DeliveryError, FrameError
from service.runtime.positions import PositionNetwork, Positions
from service.stream.inbox import Arrival, Inbox, InboxSource, Item, Marker
from service.stream.position import ChannelPosition, Position
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import decode
from service.stream.wire.topics import PREFIX

_FLUSH_EVERY = 2.0  # a crash costs no more than this [s]
_POLL = 0.1  # [s]


class Recorded(NamedTuple):
    """How many frames were written, and what became of the others."""

    frames: int = 0
    refused: int = 0  # that break the contract
    left_out: int = 0  # that came faster than they could be written
    missed: int = 0  # that were lost on the way


class RecorderNetwork(InboxSource, PositionNetwork, Protocol):
    """What the recorder needs of a `Transport`."""

    def counters(self) -> Mapping[str, int]: ...


class _Recorder:
    """One file in progress; a `PositionSource`."""

    def __init__(self, writer: RecordingWriter) -> None:
        self._writer = writer
        self._flushed = time.monotonic()
        self._newest: dict[str, dict[str, ChannelPosition]] = {}  # by stream and channel
        self.frames = self.refused = 0

    def take(self, item: Item) -> None:
        """Writes a frame, or answers a question about those before it."""
        if isinstance(item, Marker):
            item.reached()
        elif isinstance(item, Arrival):
            try:
                frame = decode(item.channel, item.payload)
            except FrameError:
                self.refused += 1
                return
            self._writer.write(frame.channel, frame.end_time_ns, item.payload)
            self._newest.setdefault(item.stream, {})[item.channel.label] = ChannelPosition(
                sequence=frame.sequence, start_ns=frame.start_time_ns
            )
            self.frames += 1
        if time.monotonic() - self._flushed > _FLUSH_EVERY:
            self.flush()

    def flush(self) -> None:
        """Hands what was written to the operating system."""
        self._writer.flush()
        self._flushed = time.monotonic()

    def position(self, stream: str) -> Position | None:
        """What has come of a stream, all of which is in the file now."""
        self.flush()
        return Position(channels=dict(self._newest.get(stream, {})))

    def refusal(self, stream: str) -> str | None:
        """Frames of any stream are written."""
        return None


def record(
    network: RecorderNetwork,
    inbox: Inbox,
    out: str | Path,
    *,
    stop: Event,
    duration: float = float("inf"),
    rig_text: bytes | None = None,
    description: str = "recorded live",
    prefix: str = PREFIX,
    progress: Callable[[int, int], None] = lambda frames, refused: None,
) -> Recorded:
    """Writes what arrives until `stop` is set or for `duration` [s]; DeliveryError where the file cannot be written."""
    metadata = {"asset": "", "description": description, "started": datetime.now(UTC).isoformat()}
    with network.subscribe(inbox):
        begun = time.monotonic()
        first = inbox.take(_POLL)
        while first is None and not stop.is_set() and time.monotonic() - begun < duration:
            first = inbox.take(_POLL)
        if isinstance(first, Arrival):
            metadata["asset"] = first.stream
        with RecordingWriter(out, rig_text=rig_text, metadata=metadata, prefix=prefix) as writer:
            recorder = _Recorder(writer)
            try:
                with Positions(inbox, network, recorder) as positions:
                    item = first
                    while True:
                        if item is not None:
                            recorder.take(item)
                            progress(recorder.frames, recorder.refused)
                        positions()
                        over = stop.is_set() or time.monotonic() - begun >= duration
                        if over and inbox.empty:
                            break
                        item = inbox.take(_POLL)
                    recorder.flush()
            except OSError as error:
                with suppress(OSError):
                    writer.close()
                reason = (error.strerror or "fault").lower()
                raise DeliveryError(
                    f"{out}: cannot be written any more: {reason}; {recorder.frames} frames were recorded before"
                ) from None
        missed = network.counters().get("missed_frames", 0)
        return Recorded(recorder.frames, recorder.refused, inbox.refused_frames, missed)
