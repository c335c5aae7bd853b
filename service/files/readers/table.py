"""What a measurement file holds: named columns of numbers, each with unit, rate and times if the file states them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np

from service.files.readers.stored import Row, StoredRow, stored
from service.files.units import UNIT_NAMES
from service.printable import printable

MOST_COLUMNS = 256  # of one two-dimensional array: a larger one is no row of channels
_IN_BRACKETS = re.compile(r"[\[(](?P<unit>[^\[\]()]*)[\])]")
_AT_THE_END = re.compile(
    r"^(?P<name>.*[\w.)])(?:\s+in\s+|\s*/\s+|,\s*|_)"
    r"(?P<unit>m?V|m?g|[kc]?Nm|m?m/s[2²]?|m?m/s\^2|ms-2|rpm|1/min|min-1|Hz|k?Pa|deg[CF]|°[CF]|counts?|m?s|[uµμn]s)$"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Column:
    """One column; `rate` or `times` where the file states when its values were taken."""

    name: str
    values: Row  # (n,), as the file has them
    unit: str = ""  # as the file states it; empty where it does not
    rate: float | None = None  # [Hz]
    start: float = 0.0  # time of the first value after the file's start [s]
    times: Row | None = None  # of each value, after the file's start (n,) [s]
    is_time: bool = False  # the file's type says that the values are times
    started: datetime | None = None  # of a column that has a start of its own


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Table:
    """A measurement file that has been read."""

    format: str  # as a reader calls it: CSV, WAV, …
    columns: tuple[Column, ...]
    numbers: Mapping[str, float] = field(default_factory=dict)  # single numbers by name
    started: datetime | None = None
    rate: float | None = None  # stated for the whole file, as in the preamble of a CSV file [Hz]
    notes: tuple[str, ...] = ()  # what a reader of the recording should know
    left_out: Mapping[str, str] = field(
        default_factory=dict
    )  # what else the file holds by name, and why it is no column

    @property
    def names(self) -> tuple[str, ...]:
        """The names of everything in the file."""
        return (*(c.name for c in self.columns), *self.numbers, *self.left_out)

    def column(self, name: str) -> Column | None:
        """The column of this name; None where there is none."""
        return next((c for c in self.columns if c.name == printable(name)), None)


def split_unit(label: str) -> tuple[str, str]:
    """`Acc1 (g)`, `torque [Nm] - T 10Nm` or `acc_V` → name and unit; the unit is empty where the label has none.

    A unit in brackets may stand anywhere; of several brackets it is the last that holds a known unit. One without
    brackets stands behind `_`, `/`, a comma or `in`, in the letters of the standards: `_V` is volts, `_v` is not.
    """
    label = label.strip()
    found = [m for m in _IN_BRACKETS.finditer(label) if not m["unit"].strip().isdigit()]  # `[2]`: column of an array
    known = [m for m in found if m["unit"].strip().lower() in UNIT_NAMES]
    at_the_end = [m for m in found if m.end() == len(label) and m.start() > 0]
    if not known and not at_the_end:
        plain = _AT_THE_END.match(label)
        return (plain["name"], plain["unit"]) if plain else (label, "")
    chosen = (known or at_the_end)[-1]
    name = f"{label[: chosen.start()].strip()} {label[chosen.end() :].strip()}".strip(" -:;,")
    return (name or label), chosen["unit"].strip()


def group_of(name: str) -> tuple[str, str]:
    """The part of a file in which a name stands, and the name in it: `run1/time` and `rec.X.Data` are in groups."""
    at = max(name.rfind("/"), name.rfind("."))
    return name[: max(at, 0)], name[at + 1 :]


def rounded_rate(rate: float, uncertainty: float) -> float:
    """The number of fewest digits within the relative uncertainty of a rate that was printed with few digits."""
    for digits in range(1, 12):
        short = float(f"{rate:.{digits}g}")
        if abs(short - rate) <= uncertainty * rate:
            return short
    return rate


def columns_of_array(column: Column) -> list[Column]:
    """The columns of an array: itself; of one with two dimensions `name[1]`, `name[2]`, … along the longer of them."""
    array = column.values if isinstance(column.values, StoredRow) else np.squeeze(np.asarray(column.values))
    if array.dtype.kind not in "fiub" or array.size < 2 or (isinstance(array, np.ndarray) and array.ndim > 2):
        return []
    if isinstance(array, StoredRow) or array.ndim == 1:
        return [replace(column, values=array)]
    rows = array if array.shape[0] <= array.shape[1] else array.T
    if rows.shape[0] > MOST_COLUMNS:
        return []
    return [replace(column, name=f"{column.name}[{i}]", values=stored(row)) for i, row in enumerate(rows, start=1)]


def unique_names(names: list[tuple[str, str]]) -> list[str]:
    """For pairs of group and name: the name alone where no two are the same, else group/name, numbered where needed."""
    if len({name for _, name in names}) == len(names):
        return [name for _, name in names]
    whole = [f"{group}/{name}" if group else name for group, name in names]
    out: list[str] = []
    for name in whole:
        out.append(name if name not in out else f"{name} #{whole[: len(out)].count(name) + 1}")
    return out
