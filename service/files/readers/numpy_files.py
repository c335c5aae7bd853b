"""NPZ archives and NPY arrays, by numpy."""

from __future__ import annotations

from functools import partial
from operator import getitem
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from service.files.readers.contents import Contents
from service.files.readers.table import Table

WORKBOOKS = ("xl/", "content.xml")  # what an Excel or an OpenDocument workbook holds


def read_npz(path: Path) -> Table:
    """The arrays of an archive by name; a single number is a number."""
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
    """One array, under the file's name; a structured one by its fields."""
    array = np.load(path, allow_pickle=False)
    found = Contents(format="NPY")
    for name in array.dtype.names or ():
        found.add(name, partial(getitem, array, name))
    if not array.dtype.names:
        found.add(path.stem, lambda: array)
    return found.table()
