"""MDF files of vehicle measurement (versions 3 and 4), by asammdf."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from service.files.readers.contents import Contents
from service.files.readers.stored import SHORT, GrowingRow, Row
from service.files.readers.table import Table, unique_names

RECORDS = 2**20  # that are read at once: the library goes through all before them each time


def read_mdf(path: Path) -> Table:
    """The channels of all groups, with the times of their own master channel; NaN where a sample is marked invalid."""
    from asammdf import MDF

    found = Contents(format="MDF")
    rows: list[tuple[str, str, str, Row, Row]] = []
    times: dict[int, Row] = {}
    with path.open("rb") as raw, MDF(raw) as file:  # by its path it would be mapped into memory whole
        for group, channel in _channels(file):
            values, own = GrowingRow(), GrowingRow()
            for signal in _signals(file, group, channel):
                if group not in times:
                    own.append(np.asarray(signal.timestamps, dtype=float))
                values.append(_valid(signal))
            times.setdefault(group, own.row())
            rows.append((f"group {group}", signal.name, signal.unit or "", values.row(), times[group]))
        started = file.header.start_time
    names = unique_names([row[:2] for row in rows])
    for name, (_, _, unit, row, master) in zip(names, rows, strict=True):
        found.add(name, partial(_given, row), unit=unit, times=master)
    return found.table(started)


def _channels(file: Any) -> Iterator[tuple[int, int]]:
    """Group and index of each channel that is no master."""
    for virtual in file.virtual_groups:
        for group, channels in file.included_channels(virtual)[virtual].items():
            yield from ((group, channel) for channel in channels)


def _signals(file: Any, group: int, channel: int) -> Iterator[Any]:
    """A channel in pieces, each with its own times."""
    count = file.groups[group].channel_group.cycles_nr
    if count <= SHORT:
        yield file.get(group=group, index=channel, ignore_invalidation_bits=True)
        return
    for begin in range(0, count, RECORDS):
        part = {"record_offset": begin, "record_count": min(RECORDS, count - begin)}
        yield file.get(group=group, index=channel, ignore_invalidation_bits=True, **part)


def _given(row: Row) -> Row:
    return row


def _valid(signal: Any) -> np.ndarray:
    values, invalid = np.asarray(signal.samples), signal.invalidation_bits
    if invalid is None or values.dtype.kind not in "fiub" or not np.any(invalid):
        return values
    return np.where(np.asarray(invalid, dtype=bool), np.nan, values)
