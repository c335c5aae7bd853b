"""WAV files: integers of 8 to 64 bits as shares of full scale, floating-point numbers as they are.

A recorder that was interrupted leaves sizes of 0 or of the largest number in the header, or half a frame at the end:
the whole frames that are there are read.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np

from service.files.dates import stated_in
from service.files.readers.stored import StoredRow
from service.files.readers.table import Column, Table

PCM, FLOAT, EXTENSIBLE = 1, 3, 0xFFFE
UNKNOWN_SIZE = 2**32 - 1
DATA, LOOKED_INTO = b"data", (b"fmt ", b"ds64", b"bext", b"LIST")
MOST = 2**16  # of a chunk that is looked into [bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Samples:
    """Where the samples of a file lie, and how they are coded."""

    path: Path
    order: str  # of the bytes, < or >
    at: int  # first byte
    count: int  # of each channel
    channels: int
    rate: int  # [Hz]
    coding: int
    width: int  # bytes of a sample

    def track(self, channel: int, begin: int, end: int) -> np.ndarray:
        """The values of a channel from one place up to another."""
        frame = self.channels * self.width
        with self.path.open("rb") as file:
            file.seek(self.at + begin * frame)
            raw = np.frombuffer(file.read((end - begin) * frame), dtype=np.uint8)
        own = np.ascontiguousarray(raw.reshape(-1, self.channels, self.width)[:, channel])
        if self.coding == FLOAT:
            return own.view(f"{self.order}f{self.width}")[:, 0].astype(f"f{self.width}")
        if self.width == 1:
            return (own[:, 0].astype(float) - 128) / 128
        whole = np.zeros((own.shape[0], 8 if self.width > 4 else 4), dtype=np.uint8)  # the value in its highest bytes
        place = slice(0, self.width) if self.order == ">" else slice(-self.width, None)
        whole[:, place] = own
        numbers = whole.view(f"{self.order}i{whole.shape[1]}")[:, 0]
        return numbers / float(2 ** (8 * whole.shape[1] - 1))


def read_wav(path: Path) -> Table:
    """The tracks of the file as `channel 1`, `channel 2`, …"""
    samples, notes, started = _samples(path)
    if samples.coding == PCM:
        notes = (*notes, "values are shares of full scale, −1 to 1: the file states no unit")
    columns = []
    for i in range(samples.channels):
        read = partial(samples.track, i)
        row = StoredRow(size=samples.count, dtype=read(0, 1).dtype, read=read)
        columns.append(Column(name=f"channel {i + 1}", values=row, rate=float(samples.rate)))
    return Table(format="WAV", columns=tuple(columns), rate=float(samples.rate), started=started, notes=notes)


def _started(chunks: Mapping[bytes, tuple[int, int, bytes]]) -> datetime | None:
    """When the recording began, by the chunk of broadcast wave files (`bext`) or the entry `ICRD`."""
    info, broadcast = (chunks[mark][2] if mark in chunks else b"" for mark in (b"LIST", b"bext"))
    at = info.find(b"ICRD")
    date = b"" if at < 0 else info[at + 8 : at + 8 + int.from_bytes(info[at + 4 : at + 8], "little")]
    day, hour = broadcast[320:330], broadcast[330:338]
    return stated_in([("date", day + b" " + hour), ("date", date.rstrip(b"\0"))])


def _chunks(path: Path) -> tuple[str, dict[bytes, tuple[int, int, bytes]]]:
    """The order of the bytes, and of the chunks that are used place, size and beginning."""
    chunks: dict[bytes, tuple[int, int, bytes]] = {}
    with path.open("rb") as file:
        order = ">" if file.read(12)[:4] == b"RIFX" else "<"
        while len(head := file.read(8)) == 8:
            at, size = file.tell(), struct.unpack(f"{order}I", head[4:])[0]
            if head[:4] in LOOKED_INTO or (head[:4] == DATA and DATA not in chunks):
                chunks[head[:4]] = at, size, b"" if head[:4] == DATA else file.read(min(size, MOST))
            file.seek(at + size + size % 2)
    return order, chunks


def _samples(path: Path) -> tuple[_Samples, tuple[str, ...], datetime | None]:
    """Where the samples lie, a note where the header states another size than the file has, and when they begin."""
    order, chunks = _chunks(path)
    if DATA not in chunks:
        raise ValueError("its header ends before any samples")
    at, size, _ = chunks[DATA]
    form, long_size = (chunks[mark][2] if mark in chunks else b"" for mark in (b"fmt ", b"ds64"))
    if len(form) < 16:
        raise ValueError("its header does not say how its samples are stored")
    coding, channels, rate, _, frame, _ = struct.unpack(f"{order}HHIIHH", form[:16])
    if coding == EXTENSIBLE and len(form) >= 26:
        coding = struct.unpack(f"{order}H", form[24:26])[0]
    width = frame // channels if channels else 0
    if coding not in (PCM, FLOAT) or width not in ((4, 8) if coding == FLOAT else (1, 2, 3, 4, 8)) or rate == 0:
        raise ValueError(f"its samples are coded in a way (number {coding}, {width} bytes) that is not known here")
    if len(long_size) >= 16 and size == UNKNOWN_SIZE:
        size = struct.unpack("<Q", long_size[8:16])[0]
    there = path.stat().st_size - at
    count = (size if 0 < size <= there else there) // frame
    if count < 2:
        raise ValueError(f"it holds {count} samples")
    notes: tuple[str, ...] = ()
    if not 0 < size <= there or size % frame:
        notes = (
            f"the header states {size} bytes of samples where {there} are there, as an interrupted recorder leaves it: "
            f"the {count} whole samples of each channel are read",
        )
    samples = _Samples(
        path=path, order=order, at=at, count=count, channels=channels, rate=rate, coding=coding, width=width
    )
    return samples, notes, _started(chunks)
