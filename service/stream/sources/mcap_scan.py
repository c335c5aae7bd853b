"""What an MCAP file holds, found by walking its records, so that damage costs only what it hit.

Neither the summary nor the order of things is relied on: chunks are found one after the other by their
record headers, and behind a damaged header by the next compression mark. A chunk's own CRC says
whether it may be used.

Chunks are unpacked within bounds, so that a small file cannot take the memory or the processor: a chunk only as far as
it says itself, and it may say no more than LARGEST_CHUNK; all chunks of a file together no more than TOTAL and
EXPANSION times the file. A chunk holds at most MOST_RECORDS records.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema

from service.errors import InputError

MAGIC = b"\x89MCAP0\r\n"
_HEADER = struct.Struct("<BQ")  # opcode and length of a record
_CHUNK_HEAD = struct.Struct("<QQQII")  # first and last time, uncompressed size, CRC, length of the compression's name
_FOOTER = struct.Struct("<QQI")  # start of the summary, start of its offsets, CRC
_CRC_SIZE = 4  # [bytes]
_MARKS = (b"\x04\x00\x00\x00zstd", b"\x03\x00\x00\x00lz4")
_MARK_OFFSET = _HEADER.size + _CHUNK_HEAD.size - 4  # of the mark from the start of a chunk record
LARGEST_CHUNK = 2**28  # unpacked [bytes]
MOST_RECORDS = 200_000  # of a chunk
TOTAL = 2**29  # unpacked, of any file [bytes]
EXPANSION = 200  # and so many times the file's size
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence number, times of logging and of publishing of a message
_INVALID = 0  # an opcode that no record has: the usual filling of a bomb
_IMMENSE = (MemoryError, OverflowError)  # lengths that a flipped bit made so
_UNREADABLE = (McapError, zstandard.ZstdError, struct.error, ValueError, RuntimeError, OSError, *_IMMENSE)


@dataclass(frozen=True, slots=True)
class Block:
    """A chunk, or a message that stands outside of any."""

    offset: int
    start_ns: int
    end_ns: int


@dataclass(slots=True)
class Contents:
    """What was found in a file."""

    size: int
    blocks: list[Block] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    unpacked: dict[int, int] = field(default_factory=dict)  # size of each chunk that was unpacked, by its offset

    def allows(self, offset: int, size: int) -> bool:
        """Whether a chunk may be unpacked, and counts it: all together are bounded by the file's size."""
        if offset not in self.unpacked and sum(self.unpacked.values()) + size > allowance(self.size):
            return False
        self.unpacked[offset] = size
        return True

    def learn(self, records: list[McapRecord]) -> None:
        """Takes the definitions among a chunk's records over."""
        for record in records:
            if isinstance(record, Schema):
                self.schemas[record.id] = record
            elif isinstance(record, Channel):
                self.channels[record.id] = record


def scan(file: BinaryIO, name: str) -> Contents:
    """Walks the records of an open file; raises InputError where it is no MCAP file at all."""
    file.seek(0, 2)
    contents = Contents(size=file.tell())
    file.seek(0)
    if contents.size == 0:
        raise InputError(f"{name}: the file is empty; an MCAP recording was expected")
    if file.read(len(MAGIC)) != MAGIC:
        raise InputError(f"{name}: not an MCAP recording: it does not begin with the MCAP magic bytes")
    at, complete = len(MAGIC), False
    defined = contents.schemas, contents.channels  # before the summary, which repeats them
    while at + _HEADER.size <= contents.size:
        file.seek(at)
        opcode, length = _HEADER.unpack(file.read(_HEADER.size))
        behind = at + _HEADER.size + length
        if not 0 < opcode < 0x80 or behind > contents.size:
            found = _next_chunk(file, at + 1)
            if found is None:
                break
            contents.faults.append(f"damaged record at byte {at}, reading on at byte {found}")
            at = found
            continue
        try:
            _take(file, opcode, at, length, contents)
        except _UNREADABLE:
            contents.faults.append(f"damaged record at byte {at} left out")
        at = behind
        if opcode == Opcode.DATA_END:
            defined = dict(contents.schemas), dict(contents.channels)
        if opcode == Opcode.FOOTER:
            if not _summary_is_whole(file, behind):
                contents.faults.append("summary damaged (CRC) and left out")
                contents.schemas, contents.channels = defined
            file.seek(behind)
            complete = file.read(len(MAGIC)) == MAGIC
            break
    if not complete:
        contents.faults.append(f"truncated: nothing whole after byte {at} of {contents.size}")
    return contents


def _summary_is_whole(file: BinaryIO, end: int) -> bool:
    """Whether the summary agrees with the CRC of the footer that ends at `end`; a CRC of 0 is none (MCAP, `Footer`)."""
    file.seek(end - _FOOTER.size)
    begin, _, crc = _FOOTER.unpack(file.read(_FOOTER.size))
    if crc == 0:
        return True
    covered = end - _CRC_SIZE - begin  # from the summary's start to the CRC itself
    if begin == 0 or covered < 0:
        return False
    file.seek(begin)
    return zlib.crc32(file.read(covered)) == crc


def _take(file: BinaryIO, opcode: int, at: int, length: int, contents: Contents) -> None:
    """Notes one record."""
    if opcode == Opcode.CHUNK:
        head = file.read(_CHUNK_HEAD.size)
        start, end, *_ = _CHUNK_HEAD.unpack(head)
        contents.blocks.append(Block(at, start, end))
        return
    if opcode not in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.ATTACHMENT, Opcode.METADATA):
        return
    body = file.read(length)
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.MESSAGE:
        time = Message.read(stream, length).log_time
        contents.blocks.append(Block(at, time, time))
    elif opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        contents.schemas.setdefault(schema.id, schema)
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(stream)
        contents.channels.setdefault(channel.id, channel)
    elif opcode == Opcode.METADATA:
        metadata = Metadata.read(stream)
        contents.metadata[metadata.name] = dict(metadata.metadata)
    else:
        crc = int.from_bytes(body[-4:], "little")
        if crc and zlib.crc32(body[:-4]) != crc:
            contents.faults.append(f"attachment at byte {at} damaged (CRC) and left out")
            return
        attachment = Attachment.read(stream)
        contents.attachments[attachment.name] = attachment.data


def _next_chunk(file: BinaryIO, start: int) -> int | None:
    """Offset of the next thing after `start` that looks like a chunk, by its compression's name."""
    file.seek(start)
    base, tail = start, b""
    while block := file.read(1 << 20):
        data = tail + block
        places = [i for mark in _MARKS for i in _find_all(data, mark)]
        for place in sorted(places):
            at = base - len(tail) + place - _MARK_OFFSET
            if at >= start and _looks_like_chunk(file, at):
                return at
        base += len(block)
        file.seek(base)
        tail = data[-8:]
    return None


def _find_all(data: bytes, mark: bytes) -> Iterator[int]:
    place = data.find(mark)
    while place >= 0:
        yield place
        place = data.find(mark, place + 1)


def _looks_like_chunk(file: BinaryIO, at: int) -> bool:
    file.seek(at)
    head = file.read(_HEADER.size + _CHUNK_HEAD.size)
    if len(head) < _HEADER.size + _CHUNK_HEAD.size or head[0] != Opcode.CHUNK:
        return False
    start, end, size, _, _ = _CHUNK_HEAD.unpack(head[_HEADER.size :])
    return start <= end and size <= LARGEST_CHUNK


def read_block(file: BinaryIO, block: Block, contents: Contents) -> list[McapRecord] | str:
    """The records of a block, or why it cannot be used."""
    file.seek(block.offset)
    try:
        opcode, length = _HEADER.unpack(file.read(_HEADER.size))
        stream = ReadDataStream(BytesIO(file.read(length)))
        if opcode == Opcode.MESSAGE:
            return [Message.read(stream, length)]
        chunk = Chunk.read(stream)
        if not contents.allows(block.offset, chunk.uncompressed_size):
            return f"all chunks together would be over {allowance(contents.size)} bytes"
        return records_of(chunk)
    except Unusable as reason:
        return str(reason)
    except _UNREADABLE as error:
        return f"cannot be unpacked ({type(error).__name__})"


class Unusable(ValueError):
    """A chunk that is not unpacked, with the reason."""


def allowance(size: int) -> int:
    """How much all chunks of a file of some size may be together [bytes]."""
    return TOTAL + EXPANSION * size


def records_of(chunk: Chunk) -> list[McapRecord]:
    """The records of a chunk; Unusable, or an error of the unpacker, where it cannot be used."""
    data = _unpacked(chunk)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise Unusable("CRC does not match")
    records: list[McapRecord] = []
    at = count = 0
    while at < len(data):
        count += 1
        if count > MOST_RECORDS:
            raise Unusable(f"holds more than {MOST_RECORDS} records")
        opcode, length = _HEADER.unpack_from(data, at)
        begin, at = at + _HEADER.size, at + _HEADER.size + length
        if opcode == _INVALID or at > len(data):
            raise Unusable(f"holds no record at byte {begin - _HEADER.size}")
        if opcode == Opcode.MESSAGE:
            if length < _MESSAGE.size:
                raise Unusable(f"holds no whole message at byte {begin - _HEADER.size}")
            channel, sequence, logged, published = _MESSAGE.unpack_from(data, begin)
            records.append(Message(channel, logged, data[begin + _MESSAGE.size : at], published, sequence))
        elif opcode == Opcode.SCHEMA:
            records.append(Schema.read(ReadDataStream(BytesIO(data[begin:at]))))
        elif opcode == Opcode.CHANNEL:
            records.append(Channel.read(ReadDataStream(BytesIO(data[begin:at]))))
    return records


def _unpacked(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK:
        raise Unusable(f"claims {size} bytes; at most {LARGEST_CHUNK} are unpacked")
    if chunk.compression == "zstd":
        claimed = zstandard.frame_content_size(chunk.data)
        if claimed not in (-1, size):
            raise Unusable(f"claims {size} bytes and holds {claimed}")
        data = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=size) if size else b""
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise Unusable(f"compression {chunk.compression[:20]!r} is not known")
    if len(data) != size:
        raise Unusable(f"claims {size} bytes and holds {'more' if len(data) > size else len(data)}")
    return data
