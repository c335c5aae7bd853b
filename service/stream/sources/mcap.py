"""Recordings: MCAP files as a source of frames.

    with Recording(path) as recording:
        for frame in recording.frames(on_error):
            ...

Frames come as they were recorded. A file whose messages are out of time order by more than a frame
can be long (one channel after the other, say) is put in order of log time first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from heapq import heappop, heappush
from pathlib import Path
from typing import Any, NamedTuple

from mcap.records import McapRecord, Message

from service.errors import FrameError, InputError
from service.file_faults import reading
from service.files.documents import parsed_document
from service.stream.assembly import DEFAULT, AssemblySettings
from service.stream.channels import CHANNEL_KINDS
from service.stream.frames import LENGTH_LIMITS, NS, Frame
from service.stream.sources.mcap_scan import Block, Contents, read_block, scan
from service.stream.windows import Windows
from service.stream.wire.codec import decode, schema_fault
from service.stream.wire.topics import PREFIX, Channel, parse_topic
from twin.windows import Window

RIG_ATTACHMENT = "rig.toml"
_DISORDER_NS = LENGTH_LIMITS[1] * NS


class RawFrame(NamedTuple):
    """One message of a recording, not yet decoded."""

    channel: Channel
    log_time_ns: int
    payload: bytes


class Recording:
    """One MCAP file, open for reading."""

    def __init__(self, path: str | Path, prefix: str = PREFIX):
        self.path = Path(path)
        with reading(path):
            self._file = self.path.open("rb")
        try:
            self._contents = scan(self._file, str(path))
            self._blocks = list(self._contents.blocks)
            self._peek()
            self.channels = self._measurement_channels(prefix)
        except BaseException:
            self._file.close()
            raise
        self.bytes_read = 0

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @property
    def size(self) -> int:
        """Length of the file [bytes]."""
        return self._contents.size

    @property
    def faults(self) -> list[str]:
        """What is damaged in the file; complete once all frames are read."""
        return self._contents.faults

    @property
    def fault_line(self) -> str | None:
        """What is damaged, in one line."""
        return f"{self.path}: {'; '.join(self.faults)}" if self.faults else None

    @property
    def metadata(self) -> dict[str, str]:
        """The metadata record `recording`."""
        return self._contents.metadata.get("recording", {})

    @property
    def assets(self) -> list[str]:
        return sorted({channel.asset for channel in self.channels.values()})

    def labels(self, asset: str) -> tuple[str, ...]:
        """The channels of an asset: their first frames may come long after those of others."""
        return tuple(sorted(channel.label for channel in self.channels.values() if channel.asset == asset))

    @property
    def rig_text(self) -> bytes | None:
        """The attached rig file as it is."""
        return self._contents.attachments.get(RIG_ATTACHMENT)

    def rig(self) -> dict[str, Any] | None:
        """The attached rig file as a mapping; InputError where it is not TOML."""
        if self.rig_text is None:
            return None
        return parsed_document(self.rig_text, f"{self.path}: attachment {RIG_ATTACHMENT}")

    def messages(self) -> Iterator[RawFrame]:
        """Whole messages of the measurement channels; damaged chunks are left out and noted in `faults`."""
        damaged: list[str] = []
        used = undefined = 0
        for records in self._ordered(damaged):
            for record in records:
                channel = self.channels.get(record.channel_id)
                undefined += record.channel_id not in self._contents.channels
                if channel is not None:
                    used += 1
                    yield RawFrame(channel, record.log_time, record.data)
        if damaged:
            self.faults.append(f"{len(damaged)} of {len(self._blocks)} chunks damaged and left out: {damaged[0]}")
        if undefined:
            self.faults.append(f"{undefined} messages left out: the definition of their channel is lost")
        if not used:
            why = f" ({'; '.join(self.faults)})" if self.faults else ""
            raise InputError(f"{self.path}: not one whole frame of {', '.join(CHANNEL_KINDS)} data{why}")

    def frames(self, on_error: Callable[[Channel, FrameError], None]) -> Iterator[Frame]:
        """The frames; what breaks the contract is handed to `on_error` instead."""
        for channel, _, payload in self.messages():
            try:
                frame = decode(channel, payload)
            except FrameError as error:
                on_error(channel, error)
            else:
                yield frame

    def _peek(self) -> None:
        """Learns the channels from the file's summary and the first chunk that can be read, whose CRC vouches for them.

        Without a summary, or where something is damaged, from every chunk: a channel is defined where it is first used.
        """
        summarised = bool(self._contents.channels) and not self._contents.faults
        for block in self._blocks:
            records = read_block(self._file, block, self._contents)
            if not isinstance(records, str):
                self._contents.learn(records)
                if summarised:
                    return

    def _measurement_channels(self, prefix: str) -> dict[int, Channel]:
        """Channels by MCAP id; InputError where a topic's encoding or schema is not the contract's."""
        contents, out = self._contents, {}
        for ident, record in contents.channels.items():
            try:
                channel = parse_topic(record.topic, prefix)
            except FrameError as error:
                contents.faults.append(f"{error}; channel left out")
                continue
            if channel is None:
                continue
            if record.message_encoding != "protobuf":
                raise InputError(
                    f"{self.path}: channel {record.topic} has message encoding {record.message_encoding!r}, "
                    "must be 'protobuf'"
                )
            schema = contents.schemas.get(record.schema_id)
            expected = CHANNEL_KINDS[channel.kind].schema
            fault = (
                schema_fault(schema.name, schema.encoding, schema.data, expected)
                if schema
                else f"no schema, must be {expected!r}"
            )
            if fault:
                raise InputError(f"{self.path}: channel {record.topic} has {fault}")
            out[ident] = channel
        if not out:
            raise InputError(f"{self.path}: {self._why_no_channels(contents, prefix)}")
        return out

    def _why_no_channels(self, contents: Contents, prefix: str) -> str:
        topics = sorted(record.topic for record in contents.channels.values())
        wanted = f"{prefix}/{{asset}}/{{{'|'.join(CHANNEL_KINDS)}}}/{{name}}"
        for topic in topics:
            parts = topic.split("/")
            if len(parts) >= 4 and parts[-2] in CHANNEL_KINDS:
                return f"its topics begin with {'/'.join(parts[:-3])!r}, not {prefix!r}: set the prefix"
        if topics:
            return f"no channel {wanted}; it has {', '.join(topics[:5])}"
        why = f" ({'; '.join(contents.faults)})" if contents.faults else ""
        return f"no channel {wanted} can be read{why}"

    def _ordered(self, damaged: list[str]) -> Iterator[list[Message]]:
        """Messages block by block, or in order of log time where the file itself is not."""
        behind, sort = 0, False
        for block in self._blocks:
            sort = sort or behind - block.start_ns > _DISORDER_NS
            behind = max(behind, block.end_ns)
        blocks = sorted(self._blocks, key=lambda b: (b.start_ns, b.offset)) if sort else self._blocks
        heap: list[tuple[int, int, Message]] = []
        number = 0
        for i, block in enumerate(blocks):
            messages = self._read(block, damaged)
            if not sort:
                yield _locally_ordered(messages)
                continue
            for message in messages:
                heappush(heap, (message.log_time, number, message))
                number += 1
            limit = blocks[i + 1].start_ns if i + 1 < len(blocks) else float("inf")
            while heap and heap[0][0] < limit:
                yield [heappop(heap)[2]]

    def _read(self, block: Block, damaged: list[str]) -> list[Message]:
        records = read_block(self._file, block, self._contents)
        self.bytes_read = max(self.bytes_read, self._file.tell())
        if isinstance(records, str):
            damaged.append(f"at byte {block.offset}, {records}")
            return []
        return _messages(records)


def _messages(records: list[McapRecord]) -> list[Message]:
    return [record for record in records if isinstance(record, Message)]


def _locally_ordered(messages: list[Message]) -> list[Message]:
    """A chunk's messages as written, unless one comes later than a frame can be long."""
    newest = 0
    for message in messages:
        if newest - message.log_time > _DISORDER_NS:
            return sorted(messages, key=lambda m: m.log_time)
        newest = max(newest, message.log_time)
    return messages


def read_windows(
    path: str | Path, settings: AssemblySettings = DEFAULT, prefix: str = PREFIX
) -> tuple[Mapping[str, Any] | None, dict[str, str], list[Window]]:
    """All windows of a recording of one asset: (rig mapping or None, metadata, windows)."""
    with Recording(path, prefix) as recording:
        return recording.rig(), recording.metadata, list(windows_of(recording, settings))


def windows_of(
    recording: Recording, settings: AssemblySettings = DEFAULT, asset: str | None = None
) -> Iterator[Window]:
    """The windows of an asset, or of the only one, one after the other."""
    if asset is None and len(recording.assets) > 1:
        raise InputError(
            f"{recording.path}: holds {len(recording.assets)} assets: {', '.join(recording.assets)}; give one"
        )
    asset = asset or recording.assets[0]
    windows = Windows(settings)
    windows.expect(recording.labels(asset))
    for frame in recording.frames(lambda channel, _: windows.count(channel.label, "invalid")):
        if frame.channel.asset == asset:
            yield from windows.add(frame)
    yield from windows.flush()
