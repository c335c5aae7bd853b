"""Recordings written by the contract, section 2: chunked, indexed, with CRCs; zstd, or as they are."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

from mcap.writer import CompressionType, Writer

from service.stream.channels import CHANNEL_KINDS
from service.stream.sources.mcap import RIG_ATTACHMENT
from service.stream.wire.codec import schema_data
from service.stream.wire.topics import PREFIX, Channel, topic_of


@dataclass(frozen=True, slots=True, kw_only=True)
class JsonTopic:
    """A topic whose messages are JSON objects."""

    name: str
    schema_name: str
    schema: Mapping[str, Any]  # JSON schema of a message
    about: Mapping[str, str] = field(default_factory=dict)  # the channel's metadata


class RecordingWriter:
    """Writes one MCAP file; what has been flushed survives a crash, as whole chunks."""

    def __init__(
        self,
        path: str | Path,
        *,
        rig_text: bytes | None = None,
        metadata: Mapping[str, str] | None = None,
        imported: Mapping[str, str] | None = None,
        prefix: str = PREFIX,
        chunk_bytes: int = 2**20,
        compressed: bool = True,
    ):
        self.path = Path(path)
        self._file = self.path.open("wb")
        self._size = 0  # once it is closed
        self._prefix, self._channels, self._json = prefix, dict[Channel, int](), dict[str, int]()
        compression = CompressionType.ZSTD if compressed else CompressionType.NONE
        self._writer = Writer(self._file, chunk_size=chunk_bytes, compression=compression, enable_crcs=True)
        self._writer.start(profile="", library="gear-twin")
        if rig_text is not None:
            self.attach_rig(rig_text)
        if metadata:
            self._writer.add_metadata("recording", dict(metadata))
        if imported:  # what a reader must know of the measurement file that it comes from
            self._writer.add_metadata("import", dict(imported))
        data = schema_data()
        schemas = sorted({kind.schema for kind in CHANNEL_KINDS.values()})
        self._schemas = {name: self._writer.register_schema(name, "protobuf", data) for name in schemas}

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def attach_rig(self, text: bytes) -> None:
        """Attaches the rig file, once; frames may have been written before."""
        self._writer.add_attachment(0, 0, RIG_ATTACHMENT, "application/toml", text)

    def write(self, channel: Channel, end_time_ns: int, payload: bytes) -> None:
        """Adds one frame, its time being the frame's end."""
        ident = self._channels.get(channel)
        if ident is None:
            kind = CHANNEL_KINDS[channel.kind]
            about = {"quantity": kind.quantity, "unit": kind.unit}
            ident = self._writer.register_channel(
                topic_of(channel, self._prefix), "protobuf", self._schemas[kind.schema], metadata=about
            )
            self._channels[channel] = ident
        self._writer.add_message(ident, log_time=end_time_ns, publish_time=end_time_ns, data=payload)

    def write_json(self, topic: JsonTopic, time_ns: int, message: Mapping[str, Any]) -> None:
        """Adds one message of a topic that holds JSON."""
        ident = self._json.get(topic.name)
        if ident is None:
            schema = self._writer.register_schema(topic.schema_name, "jsonschema", json.dumps(topic.schema).encode())
            ident = self._writer.register_channel(topic.name, "json", schema, metadata=dict(topic.about))
            self._json[topic.name] = ident
        data = json.dumps(message, allow_nan=False, ensure_ascii=False).encode()
        self._writer.add_message(ident, log_time=time_ns, publish_time=time_ns, data=data)

    def flush(self) -> None:
        """Ends the chunk in progress and hands it to the operating system."""
        self._writer.flush()
        self._file.flush()

    @property
    def size(self) -> int:
        """Bytes in the file so far; what waits in the chunk in progress is not among them."""
        return self._size if self._file.closed else self._file.tell()

    def close(self, *, sync: bool = False) -> None:
        """Writes the index; the file is complete, with `sync` also where the machine loses its power."""
        if not self._file.closed:
            try:
                self._writer.finish()
                self._file.flush()
                if sync:
                    os.fsync(self._file.fileno())
                self._size = self._file.tell()
            finally:
                self._file.close()

    def abandon(self) -> None:
        """Closes the file as it is, without its index."""
        with suppress(OSError):
            self._file.close()
