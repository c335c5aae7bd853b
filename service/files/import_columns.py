"""The columns that a mapping names, read from a data file and checked; edges of a shaft from sampled ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from service.errors import InputError
from service.files.import_mapping import (
    COUNTS,
    PULSES,
    QUADRATURE,
    SAMPLED,
    ChannelMapping,
    ImportMapping,
    checked_edges,
    unwrapped,
)
from service.files.import_rate import TimeAxis, time_axes, timing_of
from service.files.readers import Column, Table, read_table
from service.files.readers.stored import Row, changed, pieces
from service.files.readers.table import split_unit
from service.stream.channels import CHANNEL_KINDS, Layout
from twin.encoder_pair.motion import forward_edges, quadrature
from twin.errors import WindowError
from twin.features.pulses import pulses_of

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
    channels = tuple(_with_edges(c, table, file) for c in mapping.channels)
    measured = {c.label: _measured(mapping.sample_rate, c, table, file, axes) for c in channels}
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


def _measured(rate: float | None, channel: ChannelMapping, table: Table, file: str, axes: list[TimeAxis]) -> Measured:
    columns = [_column(channel, name, table, file) for name in channel.columns]
    if len({c.values.size for c in columns}) > 1:
        sizes = " and ".join(str(c.values.size) for c in columns)
        raise InputError(
            f"{channel.place}.columns have {sizes} samples in {file}: levels of one encoder are sampled together"
        )
    values = [_checked_values(channel, c, file) for c in columns]
    kind = CHANNEL_KINDS[channel.kind]
    if kind.layout is Layout.EDGES and channel.unit not in SAMPLED:
        return Measured(values=values[0], rate=0.0, start=0.0)
    rate, start, axis = timing_of(channel.place, rate, columns[0], table, axes, kind.slow)
    if axis is not None:
        values = [axis.laid_out(v) for v in values]
    return Measured(
        values=values[0] if len(values) == 1 else np.stack([np.asarray(v) for v in values]),
        rate=rate,
        start=start,
        missing=axis.missing if axis else 0,
    )


def _place(channel: ChannelMapping, name: str) -> str:
    """Where the mapping names a column, with its name."""
    return f"{channel.place}.{'columns' if len(channel.columns) > 1 else 'column'} = {name!r}"


def _column(channel: ChannelMapping, name: str, table: Table, file: str) -> Column:
    column, place = table.column(name), _place(channel, name)
    if column is not None:
        return column
    if name in table.numbers:
        raise InputError(f"{place} of {file} is a single number and must be a row of numbers")
    left_out = table.left_out.get(name)
    why = f"is no row of numbers ({left_out})" if left_out else "is not"
    raise InputError(f"{place} {why} in {file}, which has {', '.join(table.names) or 'no named column'}")


def _with_edges(channel: ChannelMapping, table: Table, file: str) -> ChannelMapping:
    """The channel with the edges a turn that the data file states, where the mapping names that number."""
    name = channel.edges_per_rev_from
    if not name:
        return channel
    place, number = f"{channel.place}.edges_per_rev = {name!r}", table.numbers.get(name)
    if number is None:
        raise InputError(f"{place} is no single number of {file}, which has {', '.join(table.names)}")
    return replace(channel, edges_per_rev=checked_edges(f"{place} of {file}", number))


def _checked_values(channel: ChannelMapping, column: Column, file: str) -> Row:
    """The values of a column in the contract's unit; in memory, but those that are sampled evenly."""
    key = _place(channel, column.name)
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counted:
    """What a quadrature encoder's levels, or a tachometer's pulses, came to."""

    times: np.ndarray  # of the edges passed forward (m,) [s]; NaN of one that was missed and not interpolated
    length: float  # of the record [s]
    figures: dict[str, float]
    first_index: int = 0  # number of the first edge within its turn, where a gap of the wheel marks the turn


def counted_edges(data: DataFile) -> dict[str, Counted]:
    """The edges of quadrature encoders and tachometers by channel label; InputError where one does not turn on."""
    out = {}
    for channel in data.mapping.channels:
        measured = data.channels[channel.label]
        try:
            if channel.unit == QUADRATURE:
                levels = quadrature(*np.asarray(measured.values))
                out[channel.label] = _of_counts(
                    levels.counts, measured.rate, levels.illegal, levels.filled, levels.reversals
                )
            elif channel.unit == COUNTS:
                out[channel.label] = _of_counts(np.asarray(measured.values).astype(np.int64), measured.rate)
            elif channel.unit == PULSES:
                out[channel.label] = _of_pulses(measured, channel)
        except WindowError as error:
            raise InputError(f"{channel.place}: {error}") from None
    return out


def _of_counts(
    counts: np.ndarray, rate: float, illegal: int = 0, filled: int = 0, reversals: int | None = None
) -> Counted:
    """The edges of counts at every sample; `illegal` and `filled` transitions are those of the levels behind them."""
    forward = forward_edges(counts, rate)
    turned = np.sign(np.diff(counts)[np.diff(counts) != 0])
    figures: dict[str, float] = {
        "edges": forward.times.size,
        "sense": forward.sense,
        "reversals": int(np.count_nonzero(np.diff(turned))) if reversals is None else reversals,
        "counts_taken_back": forward.reversed_counts,
        "illegal_transitions": illegal,
        "illegal_counted_as_two": filled,
    }
    return Counted(times=forward.times, length=counts.size / rate, figures=figures)


def _of_pulses(measured: Measured, channel: ChannelMapping) -> Counted:
    assert channel.pulses is not None
    found = pulses_of(np.asarray(measured.values), measured.rate, channel.pulses)
    figures = {
        "edges": found.times.size,
        "missed": found.missed,
        "interpolated": found.filled,
        "doubled": found.doubled,
        "threshold": found.threshold,
        "hysteresis": found.hysteresis,
        "speed_hz": found.speed,
    }
    length = measured.values.size / measured.rate
    return Counted(times=found.times, length=length, figures=figures, first_index=found.first_index)
