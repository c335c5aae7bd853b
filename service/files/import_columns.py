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
from service.files.readers.table import split_unit
from service.stream.channels import CHANNEL_KINDS, Layout

LEAST_PRESENT = 0.5  # share of a column that must be there


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measured:
    """The values of one channel, in the contract's unit; edge times in s, levels and pulses as they are."""

    values: np.ndarray  # (n,), of a quadrature encoder its two levels (2, n)
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
        label: replace(m, start=m.start - origin) if m.rate > 0 else replace(m, values=m.values - edges_from)
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
        values=values[0] if len(values) == 1 else np.stack(values),
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


def _checked_values(mapping: ImportMapping, channel: ChannelMapping, column: Column, file: str) -> np.ndarray:
    key = f"{mapping.where}: {channel.key}.{_key(channel)} = {column.name!r}"
    kind = CHANNEL_KINDS[channel.kind]
    array = np.asarray(column.values).astype(float) * channel.factor + channel.offset
    good = np.isfinite(array)
    if array.size < 2 or good.mean() < LEAST_PRESENT:
        raise InputError(f"{key} has {int(good.sum())} finite values of {array.size} in {file}; the right column?")
    if channel.unit == QUADRATURE:
        _check_levels(key, array, good, file)
    elif channel.unit == COUNTS:
        if not good.all() or np.any(array != np.rint(array)):
            raise InputError(f"{key} must hold whole numbers at every sample in {file}: counts of an encoder?")
        return unwrapped(array)
    elif kind.layout is Layout.EDGES and channel.unit not in SAMPLED:
        if not good.all() or np.any(np.diff(array) <= 0):
            raise InputError(
                f"{key} must hold rising edge times [s]; levels (unit {QUADRATURE!r}), a counter (unit {COUNTS!r}), "
                f"or the voltage of a tachometer (kind 'tachometer')?"
            )
    elif np.ptp(array[good]) == 0 and not kind.slow:
        raise InputError(f"{key} is {array[good][0]:g} throughout {file}; the right column?")
    elif kind.vibration and np.all(np.diff(array[good]) > 0):
        raise InputError(f"{key} only rises throughout {file}: a time or a counter, not a vibration")
    return array


def _check_levels(key: str, array: np.ndarray, good: np.ndarray, file: str) -> None:
    if not good.all() or not np.isin(array, (0.0, 1.0)).all():
        raise InputError(
            f"{key} must hold levels 0 and 1, and goes from {array[good].min():g} to {array[good].max():g} in "
            f"{file}; volts that have not been cut at a threshold, or counts?"
        )
