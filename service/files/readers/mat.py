"""MATLAB files: up to version 7 by scipy, version 7.3 by mat73.

Fields of structures are named `structure.field`, rows of numbers in a cell array `cell[1]`, `cell[2]`, … Objects, such
as those of the class `datetime`, are no part of the published format: each is left out, and a note says so.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from service.files.readers.contents import Contents
from service.files.readers.table import MOST_COLUMNS, Table

MOST_PARTS = 10_000_000  # of a cell array, a structure array or a text: more take over 1 GB, or are a spoiled number
INSTEAD = {
    "datetime": "posixtime({x})", "duration": "seconds({x})", "string": "char({x})", "categorical": "double({x})",
    "table": "its columns as variables", "timetable": "its columns as variables, and the times by posixtime or seconds",
}  # fmt: skip
"""What MATLAB can save in place of an object of a class."""


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
    from scipy.io.matlab import MatlabOpaque

    content = _content(path)
    objects: dict[str, str] = {}
    if isinstance(content.get("None"), MatlabOpaque):  # under this name scipy keeps the last one
        del content["None"]
        objects = dict(_objects(path))

    def class_of(label: str, value: Any) -> str:
        return str(value[0]["s2"].decode()) if isinstance(value, MatlabOpaque) else objects.get(label, "")

    return _table("MAT", {**content, **dict.fromkeys(objects)}, class_of)


def _content(path: Path) -> dict[str, Any]:
    """What scipy reads; ValueError of an array of more than MOST_PARTS before scipy makes room for them."""
    from scipy.io.matlab._mio import mat_reader_factory
    from scipy.io.matlab._mio5 import MatFile5Reader
    from scipy.io.matlab._mio5_utils import VarReader5

    class Bounded(VarReader5):
        def read_cells(self, header: Any) -> Any:
            return super().read_cells(_of_few_parts(header))

        def read_struct(self, header: Any) -> Any:
            return super().read_struct(_of_few_parts(header))

        def read_char(self, header: Any) -> Any:
            return super().read_char(_of_few_parts(header))

    class Reader(MatFile5Reader):
        def initialize_read(self) -> None:
            super().initialize_read()
            self._matrix_reader = Bounded(self)

    with path.open("rb") as file:
        reader, _ = mat_reader_factory(file, simplify_cells=True)
        if isinstance(reader, MatFile5Reader):
            reader = Reader(file, simplify_cells=True)
        return dict(reader.get_variables())


def _of_few_parts(header: Any) -> Any:
    parts = math.prod(header.dims)
    if parts > MOST_PARTS:
        raise ValueError(f"it states an array of {parts} parts, of which at most {MOST_PARTS} are read")
    return header


def _objects(path: Path) -> Iterator[tuple[str, str]]:
    """Name and class of each variable of a file of version 5 to 7 that is an object."""
    from scipy.io.matlab._mio5 import MatFile5Reader
    from scipy.io.matlab._mio5_params import mxOPAQUE_CLASS

    with path.open("rb") as file:
        reader = MatFile5Reader(file)
        reader.initialize_read()
        reader.read_file_header()
        while not reader.end_of_stream():
            head, after = reader.read_var_header()
            if head.mclass == mxOPAQUE_CLASS:
                name, _, kind, _ = reader.read_var_array(head, process=False)[0]
                yield name.decode(), kind.decode()
            file.seek(after)


def read_mat73(path: Path) -> Table:
    """A MAT file of version 7.3, which is an HDF5 file."""
    import h5py
    import mat73

    content = mat73.loadmat(str(path))
    with h5py.File(path, "r") as file:

        def class_of(label: str, value: Any) -> str:
            """Of what mat73 does not read: nothing of an object, which HDF5 holds as references."""
            held = None if value is not None else file.get(label.replace(".", "/"))
            return "" if held is None or "MATLAB_object_decode" not in held.attrs else _text(held.attrs["MATLAB_class"])

        return _table("MAT 7.3", content, class_of)


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _table(name: str, content: Mapping[str, Any], class_of: Callable[[str, Any], str]) -> Table:
    found = Contents(format=name)
    for label, value in _leaves(content):
        if kind := class_of(label, value):
            how = INSTEAD.get(kind, "its numbers as variables").format(x=label)
            found.left_out[label] = f"an object of MATLAB's class {kind}, which cannot be read: save {how} in its place"
            found.notes.append(f"{label!r} is {found.left_out[label]}")
        else:
            found.add(label, partial(np.asarray, value))
    return found.table()


def _leaves(content: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """What is in the structures and cells, by its path; MATLAB's own entries are left out."""
    for name, value in content.items():
        if name.startswith("__"):
            continue
        label = f"{path}.{name}" if path else name
        if isinstance(value, Mapping):
            yield from _leaves(value, label)
        elif _is_of_parts(value):
            for i, part in enumerate(np.ravel(value) if isinstance(value, np.ndarray) else value, start=1):
                if isinstance(part, Mapping):
                    yield from _leaves(part, f"{label}[{i}]")
                else:
                    yield f"{label}[{i}]", part
        else:
            yield label, value


def _is_of_parts(value: Any) -> bool:
    """Whether a value is an array of structures, or a cell array of rows of numbers and nothing else."""
    is_cell = isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype.kind == "O")
    if not is_cell or not 0 < len(value) <= MOST_COLUMNS:
        return False
    parts = list(np.ravel(value)) if isinstance(value, np.ndarray) else value
    return all(isinstance(p, Mapping) for p in parts) or all(_is_row(p) for p in parts)


def _is_row(part: Any) -> bool:
    return isinstance(part, np.ndarray) and part.size > 1 and part.dtype.kind in "fiub"
