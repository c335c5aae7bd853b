"""Between the bytes of `gearbox.v1` messages and frames."""

from __future__ import annotations

import struct
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
_START, _RATE = struct.Struct("<BQ"), struct.Struct("<Bd")  # fields 1 and 2 with their tags
_MOST_DIGITS = 9  # of a number that is read here: 63 bits


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


class _Unusual(Exception):
    """A message that is left to protobuf."""


class _Fields:
    """The fields of a message one after the other, as every writer that is known puts them: each once, in order."""

    __slots__ = ("at", "payload")

    def __init__(self, payload: bytes) -> None:
        self.payload, self.at = payload, 0

    def fixed(self, tag: int, kind: struct.Struct) -> Any:
        """A number of eight bytes; 0 is not written."""
        if self.payload[self.at] != tag:
            return 0
        _, value = kind.unpack_from(self.payload, self.at)
        self.at += kind.size
        return value

    def number(self, tag: int) -> int:
        """A number of as many bytes as it needs; 0 is not written."""
        return self._varint() if self.payload[self.at] == tag else 0

    def _varint(self) -> int:
        value, payload, at = 0, self.payload, self.at
        for place in range(_MOST_DIGITS):
            at += 1
            digit = payload[at]
            value |= (digit & 0x7F) << 7 * place
            if digit < 0x80:
                self.at = at + 1
                return value
        raise _Unusual

    def last(self, tag: int, kind: Any) -> np.ndarray:
        """All values, to the message's end; (n,)."""
        if self.payload[self.at] != tag:
            raise _Unusual
        length = self._varint()
        if self.at + length != len(self.payload) or length % kind.itemsize:
            raise _Unusual
        return np.frombuffer(self.payload, kind, offset=self.at).astype(kind.newbyteorder("="), copy=False)


_FLOAT, _DOUBLE = np.dtype("<f4"), np.dtype("<f8")


def _quickly(kind: Any, channel: Channel, payload: bytes) -> Frame:
    """The frame in a payload that is laid out as usual; _Unusual, or an error of reading beyond it, where it is not."""
    fields = _Fields(payload)
    start = fields.fixed(0x09, _START)
    if kind.layout is Layout.EDGES:
        edges_per_rev = fields.number(0x10)
        if edges_per_rev >= 2**32:
            raise _Unusual
        return EncoderFrame(
            channel=channel,
            start_time_ns=start,
            edges_per_rev=edges_per_rev,
            sequence=fields.number(0x18),
            first_edge_index=fields.number(0x20),
            edge_offsets_ns=fields.last(0x2A, _DOUBLE),
        )
    return SampleFrame(
        channel=channel,
        start_time_ns=start,
        sample_rate=fields.fixed(0x11, _RATE),
        sequence=fields.number(0x18),
        values=fields.last(0x22, _FLOAT),
    )


def decode(channel: Channel, payload: bytes) -> Frame:
    """The frame in a payload; raises FrameError where the contract is broken.

    Most messages hold each field once, in order and to the end: their values are left where they lie, and the frame
    keeps the payload.
    """
    kind = CHANNEL_KINDS[channel.kind]
    try:
        frame = _quickly(kind, channel, payload)
    except (_Unusual, IndexError, struct.error, FrameError):
        return _decoded(kind, channel, payload)
    object.__setattr__(frame, "payload", payload)
    return frame


def _decoded(kind: Any, channel: Channel, payload: bytes) -> Frame:
    """The same of any message, by protobuf."""
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
    """The payload of a frame, as it came where that is known."""
    if frame.payload is not None:
        return frame.payload
    if isinstance(frame, EncoderFrame):
        message = pb.EncoderFrame(
            start_time_ns=frame.start_time_ns,
            edges_per_rev=frame.edges_per_rev,
            sequence=frame.sequence,
            first_edge_index=frame.first_edge_index,
        )
        return message.SerializeToString() + _packed(0x2A, frame.edge_offsets_ns.astype(_DOUBLE).tobytes())
    message = pb.SampleFrame(
        start_time_ns=frame.start_time_ns, sample_rate_hz=frame.sample_rate, sequence=frame.sequence
    )
    return message.SerializeToString() + _packed(0x22, frame.values.astype(_FLOAT).tobytes())


def _packed(tag: int, values: bytes) -> bytes:
    """All values, the last field of a message; none are not written."""
    length, size = bytearray([tag]), len(values)
    while size >= 0x80:
        length.append(size & 0x7F | 0x80)
        size >>= 7
    return bytes([*length, size]) + values if values else b""


def schema_data() -> bytes:
    """The FileDescriptorSet that an MCAP schema record holds."""
    file = descriptor_pb2.FileDescriptorProto.FromString(pb.DESCRIPTOR.serialized_pb)
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()


def schema_fault(name: str, encoding: str, data: bytes, expected: str) -> str | None:
    """What is wrong with a schema record that should describe `expected`; None if nothing is."""
    if name != expected or encoding != "protobuf":
        shown = encoding if encoding and encoding.isprintable() else repr(encoding)
        return f"schema {name!r} ({shown}), must be {expected!r} (protobuf)"
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
