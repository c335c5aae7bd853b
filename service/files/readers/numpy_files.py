"""NPZ archives and NPY arrays, by numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from service.files.readers.table import Column, Table, array_columns


def read_npz(path: Path) -> Table:
    """The arrays of an archive by name; a single number is a number."""
    columns: list[Column] = []
    numbers: dict[str, float] = {}
    others = []
    with np.load(path, allow_pickle=False) as archive:
        for name in archive.files:
            array = archive[name]
            if array.size == 1 and array.dtype.kind in "fiu":
                numbers[name] = array.item()
                continue
            found = array_columns(name, array)
            columns += found
            if not found:
                others.append(name)
    return Table(format="NPZ", columns=tuple(columns), numbers=numbers, other_names=tuple(others))


def read_npy(path: Path) -> Table:
    """One array, under the file's name; a structured one by its fields."""
    array = np.load(path, allow_pickle=False)
    if array.dtype.names:
        parts = [c for name in array.dtype.names for c in array_columns(name, array[name])]
    else:
        parts = array_columns(path.stem, array)
    return Table(format="NPY", columns=tuple(parts))
