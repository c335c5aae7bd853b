"""The frames of one window as one file: an MCAP recording, uncompressed, payloads as they came.

Its last message, of the topic `segment`, says which part of each frame the window has, and what its stream knew when it
closed. A file is read whole or not at all: all that is read lies in chunks with checksums.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mcap.records import Channel as ChannelRecord
from mcap.records import McapRecord, Message

from service.stream.frames import Frame
from service.stream.pieces import Piece, size_of
from service.stream.samples import Span
from service.stream.segment import Segment
from service.stream.sources.mcap_scan import read_block, scan
from service.stream.sources.mcap_write import JsonTopic, RecordingWriter
from service.stream.wire.codec import decode, encode
from service.stream.wire.topics import Channel, parse_topic
from twin.windows import Fault, SlowValue

SUFFIX = ".mcap"
ABOUT = JsonTopic(name="segment", schema_name="gear-twin.segment", schema={"type": "object"})
CHUNK_BYTES = 2**23  # most windows are one chunk: more at a time would be held twice, and no chunk has too many records


def write_segment(path: Path, segment: Segment) -> int:
    """Writes a segment, whole also where the machine loses its power; the file's size in bytes.

    A file that cannot be written is deleted again; the folder's own list of names is made durable by `sync_folder`.
    """
    writer = RecordingWriter(path, chunk_bytes=CHUNK_BYTES, compressed=False)
    try:
        frames, parts = _frames(segment)
        for piece in frames:
            writer.write(piece.frame.channel, piece.frame.end_time_ns, encode(piece.frame))
        writer.write_json(ABOUT, segment.span.end_ns, _about(segment, parts, len(frames)))
        writer.close(sync=True)
    except BaseException:
        writer.abandon()
        path.unlink(missing_ok=True)
        raise
    return writer.size


def sync_folder(folder: Path) -> None:
    """Makes the names of a folder's files durable, which those of the files' contents are not by themselves."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def read_segment(path: Path) -> Segment:
    """The segment of a file; OSError or ValueError where it cannot be read."""
    try:
        return _read(path)
    except (OSError, ValueError, MemoryError):
        raise
    except Exception as error:  # the library raises a dozen kinds for what is damaged
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _frames(segment: Segment) -> tuple[list[Piece], list[tuple[int, int, int, int]]]:
    """The pieces in order of time, and of those that are part of a frame or follow a loss: place, begin, end, loss."""
    pieces = [piece for of_channel in segment.pieces.values() for piece in of_channel]
    pieces.sort(key=lambda piece: piece.frame.start_time_ns)
    parts = [
        (place, piece.begin, piece.end, piece.lost)
        for place, piece in enumerate(pieces)
        if (piece.begin, piece.end, piece.lost) != (0, size_of(piece.frame), 0)
    ]
    return pieces, parts


def _about(segment: Segment, parts: list[tuple[int, int, int, int]], frames: int) -> Mapping[str, Any]:
    return {
        "span_ns": segment.span,
        "frames": frames,
        "parts": parts,
        "known": segment.known,
        "slow": {label: asdict(value) for label, value in segment.slow.items()},
        "faults": [asdict(fault) for fault in segment.faults],
        "most": segment.most,
        "left_out": segment.left_out,
    }


def _read(path: Path) -> Segment:
    channels: dict[int, Channel | None] = {}
    frames: list[Frame] = []
    about = None
    for record in _records(path):
        if isinstance(record, ChannelRecord):
            channels[record.id] = parse_topic(record.topic)
        elif isinstance(record, Message):
            channel = channels[record.channel_id]
            if channel is None:
                about = json.loads(record.data)
                break
            frames.append(decode(channel, record.data))
    if about is None or about["frames"] != len(frames):
        raise ValueError("it does not hold all frames of its window")
    parts = {place: (begin, end, lost) for place, begin, end, lost in about["parts"]}
    pieces: dict[str, list[Piece]] = {}
    for place, frame in enumerate(frames):
        begin, end, lost = parts.get(place, (0, size_of(frame), 0))
        pieces.setdefault(frame.channel.label, []).append(Piece(frame, begin, end, lost))
    return Segment(
        span=Span(*about["span_ns"]),
        pieces=pieces,
        known=tuple(about["known"]),
        slow={label: SlowValue(**values) for label, values in about["slow"].items()},
        faults=tuple(Fault(**fault) for fault in about["faults"]),
        most=about["most"],
        left_out=about["left_out"],
    )


def _records(path: Path) -> Iterator[McapRecord]:
    """The records of a file's chunks; ValueError where anything of it disagrees with its checksum."""
    with path.open("rb") as file:
        contents = scan(file, path.name)
        for block in contents.blocks:
            records = read_block(file, block, contents)
            if isinstance(records, str) or contents.faults:
                raise ValueError(records if isinstance(records, str) else contents.faults[0])
            yield from records
