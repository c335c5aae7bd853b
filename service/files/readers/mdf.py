"""MDF files of vehicle measurement (versions 3 and 4), by asammdf."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from service.files.readers.contents import Contents
from service.files.readers.stored import Row, stored
from service.files.readers.table import Table, unique_names


def read_mdf(path: Path) -> Table:
    """The channels of all groups, with the times of their own master channel; NaN where a sample is marked invalid."""
    from asammdf import MDF

    found = Contents(format="MDF")
    rows: list[tuple[str, str, str, Row, Row]] = []
    times: dict[int, Row] = {}
    with MDF(path) as file:
        for signal in file.iter_channels(skip_master=True):
            group = signal.group_index
            if group not in times:
                times[group] = stored(np.asarray(signal.timestamps, dtype=float))
            values = _valid(signal)
            row: Row = stored(values) if values.ndim == 1 and values.dtype.kind in "fiub" else values
            rows.append((f"group {group}", signal.name, signal.unit or "", row, times[group]))
        started = file.header.start_time
    names = unique_names([row[:2] for row in rows])
    for name, (_, _, unit, row, own) in zip(names, rows, strict=True):
        found.add(name, partial(_given, row), unit=unit, times=own)
    return found.table(started)


def _given(row: Row) -> Row:
    return row


def _valid(signal: Any) -> np.ndarray:
    values, invalid = np.asarray(signal.samples), signal.invalidation_bits
    if invalid is None or values.dtype.kind not in "fiub" or not np.any(invalid):
        return values
    return np.where(np.asarray(invalid, dtype=bool), np.nan, values)
