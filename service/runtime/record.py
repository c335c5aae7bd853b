"""A live stream kept as a recording: `gear-twin record`."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from threading import Event

from service.errors import FrameError
from service.stream.inbox import Inbox, InboxSource
from service.stream.sources.mcap_write import RecordingWriter
from service.stream.wire.codec import decode
from service.stream.wire.topics import PREFIX

_FLUSH_EVERY = 2.0  # a crash costs no more than this [s]
_POLL = 0.1  # [s]


def record(
    source: InboxSource,
    inbox: Inbox,
    out: str | Path,
    *,
    stop: Event,
    duration: float = float("inf"),
    rig_text: bytes | None = None,
    description: str = "recorded live",
    prefix: str = PREFIX,
    progress: Callable[[int, int], None] = lambda frames, refused: None,
) -> tuple[int, int]:
    """Writes what arrives until `stop` is set or for `duration` [s]; answers frames written and refused."""
    started = datetime.now(UTC).isoformat()
    metadata = {"asset": "", "description": description, "started": started}
    frames = refused = 0
    with source.subscribe(inbox):
        first = inbox.take(_POLL)
        begun = flushed = time.monotonic()
        while first is None and not stop.is_set() and time.monotonic() - begun < duration:
            first = inbox.take(_POLL)
        if first is not None:
            metadata["asset"] = first.channel.asset
        with RecordingWriter(out, rig_text=rig_text, metadata=metadata, prefix=prefix) as writer:
            arrival = first
            while True:
                if arrival is not None:
                    try:
                        frame = decode(arrival.channel, arrival.payload)
                    except FrameError:
                        refused += 1
                    else:
                        writer.write(frame.channel, frame.end_time_ns, arrival.payload)
                        frames += 1
                    progress(frames, refused)
                now = time.monotonic()
                if now - flushed > _FLUSH_EVERY:
                    writer.flush()
                    flushed = now
                if arrival is None and (stop.is_set() or now - begun >= duration):
                    break
                if now - begun >= duration and not inbox.depth:
                    break
                arrival = inbox.take(_POLL)
    return frames, refused
