"""The columns that a mapping names, read from a data file and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from service.errors import InputError
from service.files.import_channel import COUNTS, QUADRATURE, SAMPLED, ChannelMapping, checked_edges, unwrapped
from service.files.import_mapping import ImportMapping
from service.files.import_rate import TimeAxis, time_axes, timing_of
from service.files.readers import Column, Table, read_table
from service.files.readers.stored import Row, changed, pieces
from service.files.readers.table import split_unit
from service.stream.channels import CHANNEL_KINDS, Layout

LEAST_PRESENT = 0.5  # share of a column that must be there


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measured:
    """The values of one channel, in the contract's unit; edge times in s, levels and pulses as they are."""

    values: Row  # (n,), of a quadrature encoder its two levels (2, n)
    rate: float  # [Hz]; 0 of edge times
    start: float  # of the first value after the recording's start [s]; of edge times 0
    missing: int = 0  # samples that its times show to be missing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DataFile:
    """What a mapping's data file holds of its channels."""

    mapping: ImportMapping  # with the edges a turn that the file states
    channels: Mapping[str, Measured]  # by label
    units: Mapping[str, str]  # by label, as the file states them; empty where it does not
    started: datetime | None  # as the file states it
    notes: tuple[str, ...]


def read_columns(mapping: ImportMapping, path: Path) -> DataFile:
    """The mapped columns of a data file."""
    if not path.is_file():
        raise InputError(f"{mapping.where}: file.path = {path} does not exist; it is relative to the mapping file")
    try:
        table = read_table(path, mapping.text)
    except InputError as error:
        raise InputError(f"{mapping.where}: file.path: {error}") from None
    return columns_of(mapping, table, path.name)


@np.errstate(all="ignore")  # of values that are none: what is wrong with them is said
def columns_of(mapping: ImportMapping, table: Table, file: str) -> DataFile:
    """The mapped columns of a data file that has been read; InputError where mapping and file contradict."""
    used = {column for channel in mapping.channels for column in channel.columns}
    axes = time_axes(mapping.where, table, file, mapping.time_column, used)
    channels = tuple(_with_edges(mapping, c, table, file) for c in mapping.channels)
    measured = {c.label: _measured(mapping, c, table, file, axes) for c in channels}
    return DataFile(
        mapping=replace(mapping, channels=channels),
        channels=_from_one_origin(measured, bool(axes)),
        units={c.label: _stated_unit(table, c) for c in channels},
        started=table.started or next((a.began for a in axes if a.began), None),
        notes=table.notes,
    )


def _stated_unit(table: Table, channel: ChannelMapping) -> str:
    column = table.column(channel.columns[0])
    return "" if column is None else column.unit or split_unit(column.name)[1]


def _from_one_origin(measured: Mapping[str, Measured], timed: bool) -> dict[str, Measured]:
    """The channels on a clock that starts with the first of them; edge times are on the clock of the time column."""
    starts = [m.start for m in measured.values() if m.rate > 0]
    origin = min(starts, default=0.0)
    edges_from = origin if timed else min(origin, 0.0)
    return {
        label: replace(m, start=m.start - origin)
        if m.rate > 0
        else replace(m, values=np.asarray(m.values) - edges_from)
        for label, m in measured.items()
    }


def _measured(
    mapping: ImportMapping, channel: ChannelMapping, table: Table, file: str, axes: list[TimeAxis]
) -> Measured:
    columns = [_column(mapping, channel, name, table, file) for name in channel.columns]
    if len({c.values.size for c in columns}) > 1:
        raise InputError(
            f"{mapping.where}: {channel.key}.columns have {' and '.join(str(c.values.size) for c in columns)} "
            f"samples in {file}: levels of one encoder are sampled together"
        )
    values = [_checked_values(mapping, channel, c, file) for c in columns]
    kind = CHANNEL_KINDS[channel.kind]
    if kind.layout is Layout.EDGES and channel.unit not in SAMPLED:
        return Measured(values=values[0], rate=0.0, start=0.0)
    timing = timing_of(mapping, channel.key, columns[0], table, axes, kind.slow)
    if timing.axis is not None:
        values = [timing.axis.laid_out(v) for v in values]
    return Measured(
        values=values[0] if len(values) == 1 else np.stack([np.asarray(v) for v in values]),
        rate=timing.rate,
        start=timing.start,
        missing=timing.axis.missing if timing.axis else 0,
    )


def _key(channel: ChannelMapping) -> str:
    return "columns" if len(channel.columns) > 1 else "column"


def _column(mapping: ImportMapping, channel: ChannelMapping, name: str, table: Table, file: str) -> Column:
    column = table.column(name)
    if column is None:
        if name in table.numbers:
            raise InputError(
                f"{mapping.where}: {channel.key}.{_key(channel)} = {name!r} of {file} is a single number and must be "
                "a row of numbers"
            )
        left_out = table.left_out.get(name)
        why = f"is no row of numbers ({left_out})" if left_out else "is not"
        has = ", ".join(table.names) or "no named column"
        raise InputError(f"{mapping.where}: {channel.key}.{_key(channel)} = {name!r} {why} in {file}, which has {has}")
    return column


def _with_edges(mapping: ImportMapping, channel: ChannelMapping, table: Table, file: str) -> ChannelMapping:
    """The channel with the edges a turn that the data file states, where the mapping names that number."""
    name = channel.edges_per_rev_from
    if not name:
        return channel
    key = f"{channel.key}.edges_per_rev"
    number = table.numbers.get(name)
    if number is None:
        raise InputError(
            f"{mapping.where}: {key} = {name!r} is no single number of {file}, which has {', '.join(table.names)}"
        )
    return replace(channel, edges_per_rev=checked_edges(mapping.where, f"{key} = {name!r} of {file}", number))


def _checked_values(mapping: ImportMapping, channel: ChannelMapping, column: Column, file: str) -> Row:
    """The values of a column in the contract's unit; in memory, but those that are sampled evenly."""
    key = f"{mapping.where}: {channel.key}.{_key(channel)} = {column.name!r}"
    kind = CHANNEL_KINDS[channel.kind]
    row = changed(column.values, lambda part: part.astype(float) * channel.factor + channel.offset)
    seen = _seen(row)
    if row.size < 2 or seen.finite < LEAST_PRESENT * row.size:
        raise InputError(f"{key} has {seen.finite} finite values of {row.size} in {file}; the right column?")
    if kind.layout is Layout.EDGES and channel.unit not in SAMPLED:
        array = np.asarray(row)
        if seen.finite < array.size or np.any(np.diff(array) <= 0):
            raise InputError(
                f"{key} must hold rising edge times [s]; levels (unit {QUADRATURE!r}), a counter (unit {COUNTS!r}), "
                f"or the voltage of a tachometer (kind 'tachometer')?"
            )
        return array
    if channel.unit == QUADRATURE:
        _check_levels(key, np.asarray(row), seen, file)
    elif channel.unit == COUNTS:
        array = np.asarray(row)
        if seen.finite < array.size or np.any(array != np.rint(array)):
            raise InputError(f"{key} must hold whole numbers at every sample in {file}: counts of an encoder?")
        return unwrapped(array, channel.edges_per_rev)
    elif seen.low == seen.high and not kind.slow:
        raise InputError(f"{key} is {seen.low:g} throughout {file}; the right column?")
    elif kind.vibration and seen.rises:
        raise InputError(f"{key} only rises throughout {file}: a time or a counter, not a vibration")
    return row


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """What a whole row of numbers is like."""

    finite: int
    low: float
    high: float
    rises: bool


def _seen(row: Row) -> _Seen:
    finite, low, high, rises, before = 0, np.inf, -np.inf, True, np.empty(0)
    for part in pieces(row):
        good = part[np.isfinite(part)]
        finite += good.size
        low, high = min(low, good.min(initial=np.inf)), max(high, good.max(initial=-np.inf))
        rises = rises and bool(np.all(np.diff(np.concatenate((before, good))) > 0))
        before = good[-1:] if good.size else before
    return _Seen(finite=finite, low=low, high=high, rises=rises)


def _check_levels(key: str, array: np.ndarray, seen: _Seen, file: str) -> None:
    if seen.finite < array.size or not np.isin(array, (0.0, 1.0)).all():
        raise InputError(
            f"{key} must hold levels 0 and 1, and goes from {seen.low:g} to {seen.high:g} in {file}; volts that have "
            f"not been cut at a threshold, or counts?"
        )
