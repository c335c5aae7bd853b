"""Recordings as MCAP files: chunked, indexed, zstd, with the rig attached; see the interface contract."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import CompressionType, Writer

from service.stream.wire import gearbox_pb2

WIRE: Any = gearbox_pb2  # generated: its messages are made when it is imported

Frame = tuple[int, Any]  # log time [ns], protobuf message


def write_mcap(path: Path, channels: Mapping[str, str], messages: Iterable[tuple[str, Frame]], metadata, rig_toml):
    """Writes (topic, frame) pairs in the order given.

    channels   topic → message name, SampleFrame or EncoderFrame
    metadata   of the recording, text by name
    rig_toml   the rig file's text, attached as rig.toml; None attaches nothing
    """
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="", library="gear-twin recordings")
        ids, numbers = _register(writer, channels), dict.fromkeys(channels, 0)
        first = None
        for topic, (log_time, message) in messages:
            first = log_time if first is None else first
            writer.add_message(
                channel_id=ids[topic],
                log_time=log_time,
                publish_time=log_time,
                sequence=numbers[topic],
                data=message.SerializeToString(deterministic=True),
            )
            numbers[topic] += 1
        if rig_toml is not None:
            writer.add_attachment(first or 0, first or 0, "rig.toml", "application/toml", rig_toml.encode())
        writer.add_metadata("recording", dict(metadata))
        writer.finish()


def _register(writer: Writer, channels: Mapping[str, str]) -> dict[str, int]:
    files = FileDescriptorSet()
    gearbox_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    schemas = {
        name: writer.register_schema(f"gearbox.v1.{name}", "protobuf", files.SerializeToString(deterministic=True))
        for name in dict.fromkeys(channels.values())
    }
    return {topic: writer.register_channel(topic, "protobuf", schemas[name]) for topic, name in channels.items()}


def sample_frames(values, rate: float, start_ns: int, frame_seconds: float, sequence: int) -> list[Frame]:
    """Evenly sampled values cut into frames, the first with the given sequence number."""
    size = max(1, round(frame_seconds * rate))
    frames: list[Frame] = []
    for k, i in enumerate(range(0, len(values), size)):
        cut = values[i : i + size]
        message = WIRE.SampleFrame(
            start_time_ns=start_ns + round(i / rate * 1e9), sample_rate_hz=rate, sequence=sequence + k
        )
        message.values.extend(cut.tolist())
        frames.append((start_ns + round((i + len(cut)) / rate * 1e9), message))
    return frames


def encoder_frames(
    first: int, times, per_rev: int, start_ns: int, seconds: float, frame_seconds: float, sequence: int
) -> list[Frame]:
    """Edge times [s from start_ns] cut into frames of equal length."""
    frames: list[Frame] = []
    for k in range(max(1, round(seconds / frame_seconds))):
        low, high = k * frame_seconds, min(seconds, (k + 1) * frame_seconds)
        inside = (times >= low) & (times < high)
        begin = start_ns + round(low * 1e9)
        message = WIRE.EncoderFrame(
            start_time_ns=begin,
            edges_per_rev=per_rev,
            sequence=sequence + k,
            first_edge_index=first + int((times < low).sum()),
        )
        message.edge_offset_ns.extend(_tidy((times[inside] - low) * 1e9))
        frames.append((start_ns + round(high * 1e9), message))
    return frames


def _tidy(nanoseconds) -> list[float]:
    """To a tenth of a nanosecond: what subtraction leaves below it is noise that only takes room."""
    return nanoseconds.round(1).tolist()
