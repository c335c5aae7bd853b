"""MATLAB files: up to version 7 by scipy, version 7.3 by mat73. Fields of structures are named `structure.field`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from service.files.dates import stated_in
from service.files.readers.table import Column, Table, array_columns


def read_mat(path: Path) -> Table:
    """A MAT file up to version 7."""
    from scipy.io import loadmat

    return _table("MAT", loadmat(path, simplify_cells=True))


def read_mat73(path: Path) -> Table:
    """A MAT file of version 7.3, which is an HDF5 file."""
    import mat73

    return _table("MAT 7.3", mat73.loadmat(str(path)))


def _table(name: str, content: Mapping[str, Any]) -> Table:
    columns: list[Column] = []
    numbers: dict[str, float] = {}
    others = []
    for label, value in _leaves(content):
        array = np.asarray(value)
        if array.dtype.kind in "fiub" and array.size == 1:
            numbers[label] = float(array.item())
            continue
        found = array_columns(label, array)
        columns += found
        if not found:
            others.append(label)
    started = stated_in(_leaves(content))
    return Table(format=name, columns=tuple(columns), numbers=numbers, other_names=tuple(others), started=started)


def _leaves(content: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """What is in the structures, by its path; MATLAB's own entries are left out."""
    for name, value in content.items():
        if name.startswith("__"):
            continue
        label = f"{path}.{name}" if path else name
        if isinstance(value, Mapping):
            yield from _leaves(value, label)
        elif isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
            for i, part in enumerate(value, start=1):
                yield from _leaves(part, f"{label}[{i}]")
        else:
            yield label, value
