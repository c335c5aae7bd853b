"""Rows of numbers that are too long for memory: they stay in a file and are read in pieces.

    row = StoredRow()                  append pieces, then
    row[a:b], row[0], row.size         read what is needed; np.asarray(row) reads the whole of it
    changed(row, lambda piece: 2 * piece)

Short rows are arrays; `pieces` goes through both alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from tempfile import TemporaryFile
from typing import Any

import numpy as np

PIECE = 2**18  # values that are read at once
SHORT = 2**18  # values of a row that stay in memory
LOOKED_AT = 2**21  # values that say what a row is


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredRow:
    """A row of numbers that `read` has from a place up to another."""

    size: int
    dtype: np.dtype[Any]
    read: Callable[[int, int], np.ndarray]
    ndim = 1

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.size,)

    def __getitem__(self, place: Any) -> Any:
        if not isinstance(place, slice):
            at = place + self.size if place < 0 else place
            return self.read(at, at + 1)[0]
        begin, end, step = place.indices(self.size)
        return self.read(begin, max(begin, end))[::step]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.read(0, self.size), dtype=dtype)


Row = np.ndarray | StoredRow


def pieces(row: Row, length: int = PIECE) -> Iterator[np.ndarray]:
    """The row in pieces, one after the other."""
    row = row if isinstance(row, StoredRow) else np.ravel(row)
    for begin in range(0, row.size, length):
        yield row[begin : begin + length]


def changed(row: Row, change: Callable[[np.ndarray], np.ndarray]) -> Row:
    """The row of which each value is changed alone; of a stored one, when it is read."""
    if not isinstance(row, StoredRow):
        return change(row)
    dtype = change(row.read(0, min(row.size, 1))).dtype
    return StoredRow(size=row.size, dtype=dtype, read=lambda a, b: change(row.read(a, b)))


def beginning(row: Row) -> np.ndarray:
    """The row, or as much of its beginning as says what it is."""
    return np.asarray(row[:LOOKED_AT])


class GrowingRow:
    """A row whose pieces come one after the other: in memory while it is short, then in a temporary file."""

    def __init__(self) -> None:
        self._held: list[np.ndarray] = []
        self._file: Any = None
        self._size = 0
        self._dtype = np.dtype(float)

    def append(self, part: np.ndarray) -> None:
        """The next values, of the first ones' type."""
        self._dtype = self._dtype if self._size else part.dtype
        self._held.append(part.astype(self._dtype, copy=False))
        self._size += part.size
        if self._size > SHORT:
            self._file = self._file or TemporaryFile(buffering=0)  # noqa: SIM115  read as long as the row is
            for each in self._held:
                np.ascontiguousarray(each).tofile(self._file)
            self._held = []

    def row(self) -> Row:
        """The values so far."""
        if self._file is None:
            return np.concatenate(self._held) if self._held else np.empty(0)
        return StoredRow(size=self._size, dtype=self._dtype, read=self._read)

    def __del__(self) -> None:
        if self._file is not None:
            self._file.close()

    def _read(self, begin: int, end: int) -> np.ndarray:
        self._file.seek(begin * self._dtype.itemsize)
        return np.fromfile(self._file, dtype=self._dtype, count=end - begin)


def row_of(parts: Iterable[np.ndarray]) -> Row:
    """The row that follows from its pieces."""
    growing = GrowingRow()
    for part in parts:
        growing.append(part)
    return growing.row()


def stored(row: Row) -> Row:
    """A row that takes no more memory than a short one."""
    return row if isinstance(row, StoredRow) or row.size <= SHORT else row_of(pieces(row))


def read_in_pieces(source: Any, size: int) -> Row:
    """A row of what can be sliced and is read only then, such as a data set of a library."""
    return row_of(source[a : a + PIECE] for a in range(0, size, PIECE)) if size > SHORT else source[:]
