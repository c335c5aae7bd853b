"""HDF5 files, by h5py: every dataset of numbers, with the unit and rate of its own or its groups' attributes."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from service.files.dates import stated_in
from service.files.readers.table import Column, Table, array_columns

UNITS = ("unit", "units", "Unit", "Units")
RATES = ("sample_rate_hz", "sample_rate", "sampling_rate", "sampling_frequency", "fs", "Fs", "rate")
STEPS = ("dt", "time_step", "sample_interval", "wf_increment", "increment")


def read_hdf5(path: Path) -> Table:
    """The datasets by their path; one value is a number."""
    import h5py

    columns: list[Column] = []
    numbers: dict[str, float] = {}
    others: list[str] = []
    with h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset):
                return
            if item.dtype.names:
                for field in item.dtype.names:
                    columns.extend(array_columns(f"{name}.{field}", item[field], rate=_rate(item)))
            elif item.dtype.kind in "fiub" and item.size == 1:
                numbers[name] = float(np.asarray(item[()]).item())
            elif item.dtype.kind in "fiub":
                columns.extend(array_columns(name, item[()], _text(item, UNITS), _rate(item)))
            else:
                others.append(name)

        stated: list[tuple[str, Any]] = list(file.attrs.items())
        file.visititems(visit)
        file.visititems(lambda name, item: stated.extend(item.attrs.items()))
        stated += [(name, file[name][()]) for name in others if file[name].shape == ()]
    started = stated_in(stated)
    return Table(format="HDF5", columns=tuple(columns), numbers=numbers, other_names=tuple(others), started=started)


def _text(item: Any, names: Collection[str]) -> str:
    for name in names:
        value = item.attrs.get(name)
        if value is not None:
            return value.decode() if isinstance(value, bytes) else str(value)
    return ""


def _rate(item: Any) -> float | None:
    """The rate that the dataset's attributes state, or those of the groups that hold it [Hz]."""
    holder = item
    while True:
        for names, turned in ((RATES, False), (STEPS, True)):
            for name in names:
                value = holder.attrs.get(name)
                if value is not None and np.ndim(value) == 0 and np.asarray(value).dtype.kind in "fiu" and value > 0:
                    return 1 / float(value) if turned else float(value)
        if holder.name == "/":
            return None
        holder = holder.parent
