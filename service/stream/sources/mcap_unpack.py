"""Chunks of a recording unpacked within bounds, so that a small file cannot take the memory or the processor.

A chunk is unpacked only as far as it says itself, and it may say no more than LARGEST_CHUNK; all chunks of a file
together no more than TOTAL and EXPANSION times the file. A chunk holds at most MOST_RECORDS records.
"""

from __future__ import annotations

import struct
import zlib
from io import BytesIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema

LARGEST_CHUNK = 2**28  # unpacked [bytes]
MOST_RECORDS = 200_000  # of a chunk
TOTAL = 2**29  # unpacked, of any file [bytes]
EXPANSION = 200  # and so many times the file's size
_HEADER = struct.Struct("<BQ")  # opcode and length of a record
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence number, times of logging and of publishing of a message
_INVALID = 0  # an opcode that no record has: the usual filling of a bomb


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
