"""HDF5 files, also of NetCDF, by h5py: every dataset of numbers, as its attributes and those of its groups state it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from service.files.readers.contents import Contents, rate_in
from service.files.readers.table import Table


def read_hdf5(path: Path) -> Table:
    """The datasets by their path; one value is a number."""
    import h5py

    found = Contents(format="HDF5")
    with h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                found.add(name, lambda: item[()], dict(item.attrs), rate=_rate(item))

        file.visititems(visit)
        return found.table()


def _rate(item: Any) -> float | None:
    """The rate that the dataset's attributes state, or those of the groups that hold it [Hz]."""
    holder = item
    while True:
        rate = rate_in(dict(holder.attrs))
        if rate is not None or holder.name == "/":
            return rate
        holder = holder.parent
