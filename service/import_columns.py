"""The columns that a mapping names, read from a CSV, CSV.gz or NPZ file and checked."""

from __future__ import annotations

import gzip
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import InputError
from service.import_mapping import ChannelMapping, ImportMapping

LEAST_PRESENT = 0.5  # share of a column that must be there


def read_columns(mapping: ImportMapping, path: Path) -> dict[str, np.ndarray]:
    """The mapped columns of a CSV, CSV.gz or NPZ file by channel label, each (n,) float64."""
    if not path.is_file():
        raise InputError(f"{mapping.where}: file.path = {path} does not exist; it is relative to the mapping file")
    read = _read_npz if path.suffix == ".npz" else _read_csv
    found = read(mapping, path)
    out = {}
    for channel in mapping.channels:
        key = f"channels.{channel.name}.column"
        if channel.column not in found:
            raise InputError(
                f"{mapping.where}: {key} = {channel.column!r} is not in {path.name}, which has "
                f"{', '.join(found) or 'no named column'}"
            )
        out[channel.label] = _checked_column(mapping, channel, found[channel.column], path.name)
    return out


def _checked_column(mapping: ImportMapping, channel: ChannelMapping, values: Any, file: str) -> np.ndarray:
    key = f"{mapping.where}: channels.{channel.name}.column = {channel.column!r}"
    array = np.asarray(values)
    if array.dtype.kind not in "fiu" or array.ndim != 1:
        raise InputError(f"{key} holds {array.dtype} of shape {array.shape} in {file}, must be a row of numbers")
    array = array.astype(float) * channel.factor
    good = np.isfinite(array)
    if array.size < 2 or good.mean() < LEAST_PRESENT:
        raise InputError(f"{key} has {int(good.sum())} finite values of {array.size} in {file}; the right column?")
    if channel.kind == "encoder":
        if not good.all() or np.any(np.diff(array) <= 0):
            raise InputError(f"{key} must hold rising edge times [s]; levels, or counts?")
    elif np.ptp(array[good]) == 0:
        raise InputError(f"{key} is {array[good][0]:g} throughout {file}; the right column?")
    elif channel.kind == "accel" and np.all(np.diff(array[good]) > 0):
        raise InputError(f"{key} only rises throughout {file}: a time or a counter, not a vibration")
    return array


def _read_npz(mapping: ImportMapping, path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            wanted = {c.column for c in mapping.channels}
            return {name: archive[name] if name in wanted else np.empty(0) for name in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(f"{mapping.where}: file.path = {path} is no readable NPZ file: {error}") from None


def _read_csv(mapping: ImportMapping, path: Path) -> dict[str, np.ndarray]:
    try:
        raw = path.read_bytes()
        text = (gzip.decompress(raw) if path.suffix == ".gz" else raw).decode("utf-8-sig")
        first, *lines = [line for line in text.splitlines() if line.strip()]
        header = [name.strip().strip('"') for name in first.split(mapping.delimiter)]
        wanted = {c.column for c in mapping.channels}
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
