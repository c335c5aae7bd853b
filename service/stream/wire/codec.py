"""Between the bytes of `gearbox.v1` messages and frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2
from google.protobuf.message import DecodeError

from service.errors import FrameError
from service.stream.channels import CHANNEL_KINDS, Layout
from service.stream.frames import LATEST_START, EncoderFrame, Frame, SampleFrame
from service.stream.wire import gearbox_pb2
from service.stream.wire.topics import Channel, topic_of

pb: Any = gearbox_pb2  # its classes are made at import
_START_TAG = b"\x09"  # of field 1, fixed64
_SEQUENCE_TAG = b"\x18"  # of field 3, a varint


def encoding_of(channel: Channel) -> str:
    """The encoding that a Zenoh sample of this channel carries."""
    return f"application/protobuf;{CHANNEL_KINDS[channel.kind].schema}"


def start_time_of(channel: Channel, payload: bytes) -> int | None:
    """When a payload's frame starts, Unix time [ns]; None where it is no frame, or starts at a time that none can."""
    if payload[:1] == _START_TAG and len(payload) >= 9:  # the first field, where most writers put it
        start = int.from_bytes(payload[1:9], "little")
        return start if 0 < start < LATEST_START else None
    try:
        return decode(channel, payload).start_time_ns
    except FrameError:
        return None


def quick_head_of(channel: Channel, payload: bytes) -> tuple[int, int] | None:
    """Sequence number and start [ns] of a payload's frame, which is not decoded where it begins as most writers begin.

    None where it is no frame, or starts at a time that none can.
    """
    second = 18 if payload[9:10] == b"\x11" else _after_varint(payload, 10) if payload[9:10] == b"\x10" else None
    if payload[:1] == _START_TAG and second is not None and payload[second : second + 1] == _SEQUENCE_TAG:
        end = _after_varint(payload, second + 1)
        start = int.from_bytes(payload[1:9], "little")
        if end is not None and 0 < start < LATEST_START:
            digits = payload[second + 1 : end]
            return sum((digit & 0x7F) << 7 * place for place, digit in enumerate(digits)), start
    try:
        return head_of(channel, payload)
    except FrameError:
        return None


def _after_varint(payload: bytes, at: int) -> int | None:
    """Where a number ends that begins at a place; None where it does not end within ten bytes."""
    return next((i + 1 for i in range(at, min(at + 10, len(payload))) if payload[i] < 0x80), None)


def head_of(channel: Channel, payload: bytes) -> tuple[int, int]:
    """Sequence number and start [ns] of a payload's frame; raises FrameError where the contract is broken."""
    frame = decode(channel, payload)
    return frame.sequence, frame.start_time_ns


def decode(channel: Channel, payload: bytes) -> Frame:
    """The frame in a payload; raises FrameError where the contract is broken."""
    kind = CHANNEL_KINDS[channel.kind]
    message = pb.EncoderFrame() if kind.layout is Layout.EDGES else pb.SampleFrame()
    try:
        message.ParseFromString(payload)
    except DecodeError:
        raise FrameError(f"{topic_of(channel)}: payload of {len(payload)} bytes is no {kind.schema} message") from None
    if kind.layout is Layout.EDGES:
        return EncoderFrame(
            channel=channel,
            start_time_ns=message.start_time_ns,
            sequence=message.sequence,
            edges_per_rev=message.edges_per_rev,
            first_edge_index=message.first_edge_index,
            edge_offsets_ns=np.array(message.edge_offset_ns, dtype=np.float64),
        )
    return SampleFrame(
        channel=channel,
        start_time_ns=message.start_time_ns,
        sequence=message.sequence,
        sample_rate=message.sample_rate_hz,
        values=np.array(message.values, dtype=np.float32),
    )


def encode(frame: Frame) -> bytes:
    """The payload of a frame."""
    if isinstance(frame, EncoderFrame):
        message = pb.EncoderFrame(
            start_time_ns=frame.start_time_ns,
            edges_per_rev=frame.edges_per_rev,
            sequence=frame.sequence,
            first_edge_index=frame.first_edge_index,
        )
        message.edge_offset_ns.extend(frame.edge_offsets_ns.tolist())
    else:
        message = pb.SampleFrame(
            start_time_ns=frame.start_time_ns, sample_rate_hz=frame.sample_rate, sequence=frame.sequence
        )
        message.values.extend(frame.values.tolist())
    return message.SerializeToString()


def schema_data() -> bytes:
    """The FileDescriptorSet that an MCAP schema record holds."""
    file = descriptor_pb2.FileDescriptorProto.FromString(pb.DESCRIPTOR.serialized_pb)
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()


def schema_fault(name: str, encoding: str, data: bytes, expected: str) -> str | None:
    """What is wrong with a schema record that should describe `expected`; None if nothing is."""
    if name != expected or encoding != "protobuf":
        return f"schema {name!r} ({encoding or 'no encoding'}), must be {expected!r} (protobuf)"
    try:
        files = descriptor_pb2.FileDescriptorSet.FromString(data).file
    except DecodeError:
        return f"schema {name!r} holds no FileDescriptorSet"
    found = {f"{file.package}.{m.name}": m for file in files for m in file.message_type}.get(expected)
    if found is None:
        return f"schema {name!r} does not describe {expected}"
    fields = {f.name: f for f in found.field}
    for field in pb.DESCRIPTOR.message_types_by_name[expected.rsplit(".", 1)[1]].fields:
        other = fields.get(field.name)
        if other is None or (other.number, other.type) != (field.number, field.type):
            return f"schema {name!r}: field {field.name} must have number {field.number} and the contract's type"
    return None
