"""Formats of named arrays, each read by a library: NPZ and NPY, HDF5 and NetCDF, Parquet, TDMS, MDF."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from functools import partial
from operator import getitem
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np

from service.files.readers.contents import Contents, rate_in
from service.files.readers.stored import PIECE, SHORT, GrowingRow, Row, read_in_pieces, row_of
from service.files.readers.table import Table, split_unit, unique_names

WORKBOOKS = ("xl/", "content.xml")  # what an Excel or an OpenDocument workbook holds
RECORDS = 2**20  # of an MDF file that are read at once: the library goes through all before them each time


def read_npz(path: Path) -> Table:
    """The arrays of a NumPy archive by name; a single number is a number."""
    with ZipFile(path) as archive:
        held = archive.namelist()
    if any(name.startswith(WORKBOOKS) for name in held):
        raise ValueError("it is a workbook of a spreadsheet program: save the sheet as CSV")
    if not any(name.endswith(".npy") for name in held):
        raise ValueError(f"it is a ZIP archive without arrays: unpack {held[0] if held else 'it'} first")
    found = Contents(format="NPZ")
    with np.load(path, allow_pickle=False) as arrays:
        for name in arrays.files:
            found.add(name, partial(getitem, arrays, name))
    return found.table()


def read_npy(path: Path) -> Table:
    """One NumPy array, under the file's name; a structured one by its fields."""
    array = np.load(path, allow_pickle=False)
    found = Contents(format="NPY")
    for name in array.dtype.names or ():
        found.add(name, partial(getitem, array, name))
    if not array.dtype.names:
        found.add(path.stem, lambda: array)
    return found.table()


def read_hdf5(path: Path) -> Table:
    """The datasets by their path, by h5py, as their attributes and their groups state; one value is a number."""
    import h5py

    found = Contents(format="HDF5")
    with h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset):
                found.entries += item.attrs.items()
            else:
                found.add(name, lambda: _dataset(item), dict(item.attrs), rate=_rate_of_dataset(item))

        found.entries += file.attrs.items()
        file.visititems(visit)
        return found.table()


def _dataset(item: Any) -> Any:
    return read_in_pieces(item, item.size) if item.ndim == 1 and item.dtype.names is None else item[()]


def _rate_of_dataset(item: Any) -> float | None:
    """The rate that the dataset's attributes state, or those of the groups that hold it [Hz]."""
    holder = item
    while True:
        rate = rate_in(dict(holder.attrs))
        if rate is not None or holder.name == "/":
            return rate
        holder = holder.parent


def read_parquet(path: Path) -> Table:
    """The columns, by pyarrow; moments and durations become seconds, other units are metadata or in the name."""
    import pyarrow
    import pyarrow.parquet as parquet

    found = Contents(format="Parquet")
    with parquet.ParquetFile(path, pre_buffer=False) as file:
        schema = file.schema_arrow
        found.entries += [(key.decode(errors="replace"), value) for key, value in (schema.metadata or {}).items()]
        for field in schema:
            stated = {
                k.decode(errors="replace"): v
                for k, v in (field.metadata or {}).items()
                if not k.startswith(b"PARQUET:")
            }
            unit = None if "unit" in stated else split_unit(field.name)[1] or None
            found.add(field.name, partial(_parquet_row, pyarrow.types, file, field), stated, unit=unit)
    return found.table()


def _parquet_row(types: Any, file: Any, field: Any) -> Any:
    """A column, empty cells NaN."""
    is_long = file.metadata.num_rows > SHORT
    plain = types.is_floating(field.type) or types.is_decimal(field.type)
    numbers = plain or types.is_integer(field.type) or types.is_boolean(field.type)
    if not is_long or not (numbers or types.is_temporal(field.type)):
        data = file.read(columns=[field.name]).column(0)
        return _parquet_values(types, field.type, data, numbers and data.null_count > 0)
    batches = file.iter_batches(PIECE, columns=[field.name])
    return row_of(_parquet_values(types, field.type, batch.column(0), numbers) for batch in batches)


def _parquet_values(types: Any, kind: Any, data: Any, as_float: bool) -> Any:
    if types.is_decimal(kind):
        data = data.cast("float64")
    values = data.to_numpy(zero_copy_only=False) if hasattr(data, "buffers") else data.to_numpy()
    return values.astype(float) if as_float else values


def read_tdms(path: Path) -> Table:
    """The channels of all groups, by nptdms, with the rate, start and unit that their waveform properties state."""
    from nptdms import TdmsFile

    with TdmsFile.open(path) as file:
        channels = [(group.name, channel) for group in file.groups() for channel in group.channels()]
        names = unique_names([(group, channel.name) for group, channel in channels])
        found = Contents(format="TDMS", entries=_with_utc(file))
        for name, (_, channel) in zip(names, channels, strict=True):
            stated = {k: v for k, v in channel.properties.items() if not k.startswith("NI_Scale")}  # nptdms applies it
            offset = float(stated.pop("wf_start_offset", 0.0))
            moment = _waveform_start(stated.get("wf_start_time"))
            started = None if moment is None else moment + timedelta(seconds=offset)
            start = offset if started is None else 0.0
            found.add(name, partial(read_in_pieces, channel, len(channel)), stated, start=start, started=started)
        return found.table()


def _with_utc(file: Any) -> list[tuple[str, Any]]:
    """The properties of groups and file; their times are UTC, as all times of TDMS."""
    properties = [item for holder in (*file.groups(), file) for item in holder.properties.items()]
    return [(k, f"{v}Z" if isinstance(v, np.datetime64) else v) for k, v in properties]


def _waveform_start(value: Any) -> datetime | None:
    """The start of a waveform; None where it is not stated, or the zero of LabVIEW's clock."""
    if value is None:
        return None
    moment = datetime.fromtimestamp(np.datetime64(value, "us").astype(int) / 1e6, UTC)
    return moment if moment.timestamp() > 0 else None


def read_mdf(path: Path) -> Table:
    """The channels of all groups, by asammdf, with their masters' times; NaN where a sample is marked invalid."""
    from asammdf import MDF

    found = Contents(format="MDF")
    rows: list[tuple[str, str, str, Row, Row]] = []
    times: dict[int, Row] = {}
    with path.open("rb") as raw, MDF(raw) as file:  # by its path it would be mapped into memory whole
        for group, channel in _mdf_channels(file):
            values, own = GrowingRow(), GrowingRow()
            for signal in _mdf_signals(file, group, channel):
                if group not in times:
                    own.append(np.asarray(signal.timestamps, dtype=float))
                values.append(_mdf_valid(signal))
            times.setdefault(group, own.row())
            rows.append((f"group {group}", signal.name, signal.unit or "", values.row(), times[group]))
        started = file.header.start_time
    names = unique_names([row[:2] for row in rows])
    for name, (_, _, unit, row, master) in zip(names, rows, strict=True):
        found.add(name, partial(_given, row), unit=unit, times=master)
    return found.table(started)


def _mdf_channels(file: Any) -> Iterator[tuple[int, int]]:
    """Group and index of each channel that is no master."""
    for virtual in file.virtual_groups:
        for group, channels in file.included_channels(virtual)[virtual].items():
            yield from ((group, channel) for channel in channels)


def _mdf_signals(file: Any, group: int, channel: int) -> Iterator[Any]:
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


def _mdf_valid(signal: Any) -> np.ndarray:
    values, invalid = np.asarray(signal.samples), signal.invalidation_bits
    if invalid is None or values.dtype.kind not in "fiub" or not np.any(invalid):
        return values
    return np.where(np.asarray(invalid, dtype=bool), np.nan, values)
