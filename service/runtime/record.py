"""A live stream kept as one recording: `gear-twin record --out`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Event
from typing import Protocol

from service.errors import DeliveryError
from service.file_faults import writing
from service.runtime.positions import PositionNetwork, Positions
from service.runtime.recorder import Recorded, Recorder
from service.stream.inbox import Arrival, Inbox, InboxSource
from service.stream.position import ChannelPosition, Position
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.topics import PREFIX, Channel

_FLUSH_EVERY = 2.0  # a crash costs no more than this [s]
_POLL = 0.1  # [s]


class RecorderNetwork(InboxSource, PositionNetwork, Protocol):
    """What the recorder of one file needs of a `Transport`."""

    def counters(self) -> Mapping[str, int]: ...


class _OneFile:
    """One file in progress, of all assets; a `PositionSource`."""

    def __init__(self, writer: RecordingWriter) -> None:
        self._writer = writer
        self._flushed = time.monotonic()
        self._newest: dict[str, dict[str, ChannelPosition]] = {}  # by stream and channel

    def write(self, channel: Channel, start_ns: int, end_ns: int, payload: bytes) -> None:
        self._writer.write(channel, end_ns, payload)

    def note(self, stream: str, label: str, sequence: int, start_ns: int) -> None:
        """Notes how far a stream has come."""
        self._newest.setdefault(stream, {})[label] = ChannelPosition(sequence=sequence, start_ns=start_ns)

    def turn(self) -> None:
        """Hands what was written to the operating system, where that is due."""
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
        with writing(out):
            opened = RecordingWriter(out, rig_text=rig_text, metadata=metadata, prefix=prefix)
        with opened as writer:
            file = _OneFile(writer)
            recorder = Recorder(file, noted=file.note)
            try:
                with Positions(inbox, network, file) as positions:
                    item = first
                    while True:
                        if item is not None:
                            recorder.take(item)
                            progress(recorder.frames, recorder.refused)
                        file.turn()
                        positions()
                        over = stop.is_set() or time.monotonic() - begun >= duration
                        if over and inbox.empty:
                            break
                        item = inbox.take(_POLL)
                    file.flush()
            except OSError as error:
                with suppress(OSError):
                    writer.close()
                reason = (error.strerror or "fault").lower()
                raise DeliveryError(
                    f"{out}: cannot be written any more: {reason}; {recorder.frames} frames were recorded before"
                ) from None
        missed = network.counters().get("missed_frames", 0)
        return Recorded(recorder.frames, recorder.refused, inbox.refused_frames, missed)
