"""MATLAB files: up to version 7 by scipy, version 7.3 by mat73. Fields of structures are named `structure.field`."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from service.files.readers.contents import Contents
from service.files.readers.table import Table


def is_level_4(head: bytes) -> bool:
    """Whether a file begins as one of level 4, which has no mark: the header of a matrix and its name."""
    for order in "<>":
        if len(head) < 21:
            return False
        kind, rows, columns, imaginary, length = struct.unpack(f"{order}5i", head[:20])
        name = head[20 : 20 + length] if 1 < length <= 64 else b""
        plain = (
            kind % 1000 // 10 in range(6) and kind % 10 in (0, 1, 2) and kind // 1000 in (0, 1) and kind % 1000 < 100
        )
        if plain and rows >= 0 and columns >= 0 and imaginary in (0, 1) and name[-1:] == b"\0":
            return name[:-1].decode("ascii", "replace").isidentifier()
    return False


def read_mat(path: Path) -> Table:
    """A MAT file of version 4 to 7."""
    from scipy.io import loadmat

    return _table("MAT", loadmat(path, simplify_cells=True))


def read_mat73(path: Path) -> Table:
    """A MAT file of version 7.3, which is an HDF5 file."""
    import mat73

    return _table("MAT 7.3", mat73.loadmat(str(path)))


def _table(name: str, content: Mapping[str, Any]) -> Table:
    found = Contents(format=name)
    for label, value in _leaves(content):
        found.add(label, partial(np.asarray, value))
    return found.table()


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
