"""HDF5 files, also of NetCDF, by h5py: every dataset of numbers, as its attributes and those of its groups state it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from service.files.readers.contents import Contents, rate_in
from service.files.readers.stored import read_in_pieces
from service.files.readers.table import Table


def read_hdf5(path: Path) -> Table:
    """The datasets by their path; one value is a number."""
    import h5py

    found = Contents(format="HDF5")
    with h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset):
                found.entries += item.attrs.items()
            else:
                found.add(name, lambda: _values(item), dict(item.attrs), rate=_rate(item))

        found.entries += file.attrs.items()
        file.visititems(visit)
        return found.table()


def _values(item: Any) -> Any:
    return read_in_pieces(item, item.size) if item.ndim == 1 and item.dtype.names is None else item[()]


def _rate(item: Any) -> float | None:
    """The rate that the dataset's attributes state, or those of the groups that hold it [Hz]."""
    holder = item
    while True:
        rate = rate_in(dict(holder.attrs))
        if rate is not None or holder.name == "/":
            return rate
        holder = holder.parent
