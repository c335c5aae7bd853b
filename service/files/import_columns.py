"""The columns that a mapping names, read from a CSV, CSV.gz or NPZ file and checked."""

from __future__ import annotations

import gzip
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import InputError
from service.files.import_mapping import QUADRATURE, ChannelMapping, ImportMapping, checked_edges
from service.stream.channels import CHANNEL_KINDS, Layout

LEAST_PRESENT = 0.5  # share of a column that must be there


def read_columns(mapping: ImportMapping, path: Path) -> tuple[ImportMapping, dict[str, np.ndarray]]:
    """The mapped columns of a CSV, CSV.gz or NPZ file by channel label, each (n,) float64, of a quadrature encoder its
    two levels (2, n); with the mapping, in which the edges a turn are those of the file where it is to hold them.
    """
    if not path.is_file():
        raise InputError(f"{mapping.where}: file.path = {path} does not exist; it is relative to the mapping file")
    read = _read_npz if path.suffix == ".npz" else _read_csv
    found = read(mapping, path)
    out, channels = {}, []
    for channel in mapping.channels:
        values = []
        for column in channel.columns:
            if column not in found:
                raise InputError(
                    f"{mapping.where}: channels.{channel.name}.{_key(channel)} = {column!r} is not in {path.name}, "
                    f"which has {', '.join(found) or 'no named column'}"
                )
            values.append(_checked_column(mapping, channel, column, found[column], path.name))
        if len({v.size for v in values}) > 1:
            raise InputError(
                f"{mapping.where}: channels.{channel.name}.columns have {' and '.join(str(v.size) for v in values)} "
                f"samples in {path.name}: levels of one encoder are sampled together"
            )
        out[channel.label] = values[0] if len(values) == 1 else np.stack(values)
        channels.append(_with_edges(mapping, channel, found, path.name))
    return replace(mapping, channels=tuple(channels)), out


def _key(channel: ChannelMapping) -> str:
    return "columns" if len(channel.columns) > 1 else "column"


def _with_edges(
    mapping: ImportMapping, channel: ChannelMapping, found: dict[str, np.ndarray], file: str
) -> ChannelMapping:
    """The channel with the edges a turn that the data file states, where the mapping names that number."""
    name = channel.edges_per_rev_from
    if not name:
        return channel
    key = f"channels.{channel.name}.edges_per_rev"
    number = found.get(name)
    if number is None or number.size != 1 or number.dtype.kind not in "fiu":
        raise InputError(
            f"{mapping.where}: {key} = {name!r} is no single number of {file}, which has {', '.join(found)}"
        )
    edges = checked_edges(mapping.where, f"{key} = {name!r} of {file}", number.item())
    return replace(channel, edges_per_rev=edges)


def _checked_column(mapping: ImportMapping, channel: ChannelMapping, column: str, values: Any, file: str) -> np.ndarray:
    key = f"{mapping.where}: channels.{channel.name}.{_key(channel)} = {column!r}"
    kind = CHANNEL_KINDS[channel.kind]
    array = np.asarray(values)
    if array.dtype.kind not in "fiub" or array.ndim != 1:
        raise InputError(f"{key} holds {array.dtype} of shape {array.shape} in {file}, must be a row of numbers")
    array = array.astype(float) * channel.factor + channel.offset
    good = np.isfinite(array)
    if array.size < 2 or good.mean() < LEAST_PRESENT:
        raise InputError(f"{key} has {int(good.sum())} finite values of {array.size} in {file}; the right column?")
    if channel.unit == QUADRATURE:
        if not good.all() or not np.isin(array, (0.0, 1.0)).all():
            raise InputError(
                f"{key} must hold levels 0 and 1, and goes from {array[good].min():g} to {array[good].max():g} in "
                f"{file}; volts that have not been cut at a threshold, or counts?"
            )
    elif kind.layout is Layout.EDGES:
        if not good.all() or np.any(np.diff(array) <= 0):
            raise InputError(f"{key} must hold rising edge times [s]; levels (unit {QUADRATURE!r}), or counts?")
    elif np.ptp(array[good]) == 0 and not kind.slow:
        raise InputError(f"{key} is {array[good][0]:g} throughout {file}; the right column?")
    elif kind.vibration and np.all(np.diff(array[good]) > 0):
        raise InputError(f"{key} only rises throughout {file}: a time or a counter, not a vibration")
    return array


def _read_npz(mapping: ImportMapping, path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            wanted = {name for c in mapping.channels for name in (*c.columns, c.edges_per_rev_from)}
            return {name: archive[name] if name in wanted else np.empty(0) for name in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(f"{mapping.where}: file.path = {path} is no readable NPZ file: {error}") from None


def _read_csv(mapping: ImportMapping, path: Path) -> dict[str, np.ndarray]:
    try:
        raw = path.read_bytes()
        text = (gzip.decompress(raw) if path.suffix == ".gz" else raw).decode("utf-8-sig")
        first, *lines = [line for line in text.splitlines() if line.strip()]
        header = [name.strip().strip('"') for name in first.split(mapping.delimiter)]
        wanted = {name for c in mapping.channels for name in c.columns}
        used = [i for i, name in enumerate(header) if name in wanted]
        columns: dict[str, np.ndarray] = {name: np.empty(0) for name in header}
        if used:
            filled = (_blanks_as_nan(line, mapping.delimiter) for line in lines)
            rows = np.loadtxt(filled, delimiter=mapping.delimiter, usecols=used, ndmin=2)
            columns |= {header[i]: rows[:, j] for j, i in enumerate(used)}
    except (OSError, EOFError, UnicodeDecodeError, ValueError, zlib.error) as error:
        line = str(error).splitlines()[0]
        raise InputError(f"{mapping.where}: file.path = {path} is no readable CSV file: {line}") from None
    return columns


def _blanks_as_nan(line: str, delimiter: str) -> str:
    """A CSV line with its empty cells filled by `nan`."""
    if delimiter * 2 in line or line.startswith(delimiter) or line.endswith(delimiter):
        return delimiter.join(cell if cell.strip() else "nan" for cell in line.split(delimiter))
    return line
