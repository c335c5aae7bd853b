"""Measurement files: one reader for each format, one line of `FORMATS` each.

    table = read_table(Path("run.tdms"))
    table.columns[0].name, table.columns[0].unit, table.columns[0].rate

A format is recognised by how its files begin, whatever they are called; what begins like none of them is read as text.
The libraries of the extra `formats` are imported by the readers that need them.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from service.errors import InputError
from service.files.readers.arrays import read_hdf5, read_mdf, read_npy, read_npz, read_parquet, read_tdms
from service.files.readers.contents import said_by
from service.files.readers.mat import is_level_4, read_mat, read_mat73
from service.files.readers.table import Column, Table, unique_names
from service.files.readers.text import NoNumbers, read_text
from service.files.readers.text_form import TextForm
from service.files.readers.uff import read_uff
from service.files.readers.wav import read_wav
from service.printable import printable

__all__ = ["FORMATS", "Column", "Table", "TextForm", "format_of", "read_table"]

EXTRA = "make install-formats, or pip install 'gear-twin[formats]'"
Reader = Callable[[Path], Table]


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """One kind of file."""

    name: str
    begins: tuple[bytes, ...]  # how its files begin, at one of `at`
    read: Reader
    at: tuple[int, ...] = (0,)
    library: str = ""  # of the extra `formats`; empty where it is always there
    fits: Callable[[bytes], bool] | None = None  # whether a beginning is one of this format that has no mark of its own


HDF5 = b"\x89HDF\r\n\x1a\n"
FORMATS = (
    Format(name="NPZ", begins=(b"PK\x03\x04",), read=read_npz),
    Format(name="NPY", begins=(b"\x93NUMPY",), read=read_npy),
    Format(name="WAV", begins=(b"RIFF", b"RF64", b"RIFX"), read=read_wav),
    Format(name="MAT", begins=(b"MATLAB 5.0 MAT-file",), read=read_mat, fits=is_level_4),
    Format(name="MAT 7.3", begins=(b"MATLAB 7.3 MAT-file", b"MATLAB 7.0 MAT-file"), read=read_mat73, library="mat73"),
    Format(name="TDMS", begins=(b"TDSm",), read=read_tdms, library="nptdms"),
    Format(name="UFF-58", begins=(b"    -1",), read=read_uff),
    Format(name="MDF", begins=(b"MDF     ", b"UnFinMF "), read=read_mdf, library="asammdf"),
    Format(name="HDF5", begins=(HDF5,), at=(0, 512, 1024, 2048), read=read_hdf5, library="h5py"),
    Format(name="Parquet", begins=(b"PAR1",), read=read_parquet, library="pyarrow"),
)
"""By the beginning of the file, the first that fits."""
NAMES = ", ".join(f.name for f in FORMATS)


def format_of(path: Path) -> Format | None:
    """The format that a file begins like; None of a text, and of what is not known."""
    with path.open("rb") as file:
        head = file.read(2048 + len(HDF5))
    for form in FORMATS:
        if any(head[at:].startswith(begin) for at in form.at for begin in form.begins):
            return form
    return next((form for form in FORMATS if form.fits and form.fits(head)), None)


@contextmanager
def _quiet() -> Iterator[None]:
    """Nothing that a library logs or warns of is printed: what is wrong with a file is said in one sentence."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def _with_printable_names(table: Table) -> Table:
    """The table; two columns whose names are then alike are numbered."""
    names = unique_names([("", printable(c.name)) for c in table.columns])
    return replace(
        table,
        columns=tuple(
            replace(c, name=name, unit=printable(c.unit)) for name, c in zip(names, table.columns, strict=True)
        ),
        numbers={printable(name): number for name, number in table.numbers.items()},
        notes=tuple(printable(note) for note in table.notes),
        left_out={printable(name): printable(why) for name, why in table.left_out.items()},
    )


def read_table(path: Path, text: TextForm | None = None) -> Table:
    """The columns of a measurement file; InputError where it cannot be read.

    text  layout of a text file, where it is known
    """
    try:
        form = format_of(path)
        with _quiet():
            table = read_text(path, text) if form is None else form.read(path)
        if not table.columns:
            why = [f"{name}: {reason}" for name, reason in table.left_out.items()]
            only = f", only {'; '.join((*table.numbers, *why))}" if table.names else ""
            raise ValueError(f"it holds no column of numbers{only}")
        return _with_printable_names(table)
    except ModuleNotFoundError as error:
        library = error.name or (form.library if form else "")
        what = form.name if form else "text"
        raise InputError(f"{path} is a {what} file, and {library} is not installed, which reads it: {EXTRA}") from None
    except MemoryError:
        raise InputError(f"{path} is larger than the memory of this machine") from None
    except Exception as error:  # of a library that met a broken file: each raises its own
        if isinstance(error, OSError) and error.strerror:
            raise InputError(f"{path} cannot be read: {error.strerror.lower()}") from None
        said = said_by(error)
        kind = form.name if form else "CSV"
        others = f"; other formats that can be read: {NAMES}" if isinstance(error, NoNumbers) else ""
        raise InputError(f"{path} is no readable {kind} file: {said}{others}") from None
