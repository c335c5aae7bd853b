"""What a reader finds in a file, part by part: one that cannot be used is left out with its reason, the rest is read.

What a file states about its values is used, or named in a note:

    value = stored·scale_factor + add_offset        NaN where `_FillValue`, `missing_value` or the valid range says so

Source   NetCDF Users Guide, Appendix A (attribute conventions); CF Conventions 1.11, sections 2.5 and 8.1
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import partial
from operator import getitem
from typing import Any

import numpy as np

from service.files.dates import stated_in
from service.files.readers.stored import Row, StoredRow, changed, pieces, stored
from service.files.readers.table import Column, Table, columns_of_array, group_of
from service.printable import printable

UNITS = ("unit", "units", "unitstring", "niunitdescription", "unitlabel")
RATES = (
    "sampleratehz", "samplerate", "samplingrate", "samplingratehz", "samplingfrequency", "samplefrequency",
    "samplefreq", "samplingfreq", "fs", "fshz", "sr", "rate", "abtastrate", "samplespersecond",
)  # fmt: skip
STEPS = ("dt", "timestep", "sampleinterval", "samplinginterval", "sampleperiod", "samplingperiod", "wfincrement",
    "increment", "deltat")  # fmt: skip
TIMES = ("t", "time", "x", "zeit")  # names beside a signal that are no signal
SAID = 200  # of what a library says of a broken file [characters]
LIKE_A_SCALE = re.compile(r"scal|offset|gain|sensitiv|calib|slope|conver|factor|fill|missing|valid|range", re.I)
USED = {"scalefactor", "addoffset", "fillvalue", "missingvalue", "validmin", "validmax", "validrange"}


def plain(name: str) -> str:
    """The name of a property without what notations differ in."""
    return re.sub(r"[^a-z0-9]", "", str(name).lower())


def numbers_of(value: Any) -> np.ndarray:
    """A property's numbers, also of one as text or as an array of one; empty where it has none."""
    if isinstance(value, bytes):
        value = value.decode(errors="replace")
    if isinstance(value, str):
        value = [part for part in re.split(r"[\s,;\[\]]+", value) if part]
    try:
        return np.ravel(np.asarray(value)).astype(float)
    except (TypeError, ValueError):
        return np.empty(0)


def number_in(stated: Mapping[str, Any], names: Sequence[str]) -> float | None:
    """The one positive number that a property of one of these names states."""
    own = {plain(name): value for name, value in stated.items()}
    for name in names:
        found = numbers_of(own[name]) if name in own else np.empty(0)
        if found.size == 1 and np.isfinite(found[0]) and found[0] > 0:
            return float(found[0])
    return None


def rate_in(stated: Mapping[str, Any]) -> float | None:
    """The sample rate that properties state, or the inverse of their step [Hz]."""
    rate, step = number_in(stated, RATES), number_in(stated, STEPS)
    return rate or (1 / step if step else None)


def unit_in(stated: Mapping[str, Any]) -> str:
    """The unit that properties state; empty where they state none."""
    own = {plain(name): value for name, value in stated.items()}
    for name in UNITS:
        for value in np.ravel(own.get(name, ())):
            return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
    return ""


def as_stated(name: str, values: Row, stated: Mapping[str, Any]) -> tuple[Row, list[str]]:
    """Values as the file means them; notes on what it states of them and is not used."""
    own = {plain(key): numbers_of(value) for key, value in stated.items()}
    odd = [k for k in stated if LIKE_A_SCALE.search(k) and (plain(k) not in USED or not own[plain(k)].size)]
    notes = [f"{name!r} states {k} = {_short(stated[k])}, which is not applied" for k in odd]
    given = {key: own[key] for key in USED if key in own and own[key].size}
    if not given or values.dtype.kind not in "fiu":
        return values, notes
    unsigned = str(stated.get("_Unsigned", "")).lower() == "true" and values.dtype.kind == "i"
    out = changed(values, lambda part: _unpacked(part, unsigned, given))
    if set(given) - {"scalefactor", "addoffset"}:
        lost = sum(int(np.count_nonzero(np.isnan(part))) for part in pieces(out))
        notes += [f"{name!r}: {lost} of {out.size} values are missing, as the file states"] if lost else []
    return out, notes


def _unpacked(values: np.ndarray, unsigned: bool, given: Mapping[str, np.ndarray]) -> np.ndarray:
    """Stored values with their scale and offset, NaN where the file says that there is none."""

    def first(key: str, default: float) -> float:
        return float(given[key][0]) if key in given else default

    if unsigned:
        values = values.view(values.dtype.str.replace("i", "u"))
    out = np.array(values, dtype=float)
    ends = given.get("validrange", np.empty(0))
    limits = ends if ends.size == 2 else (-np.inf, np.inf)
    missing = (out < first("validmin", limits[0])) | (out > first("validmax", limits[1]))
    for key in ("fillvalue", "missingvalue"):
        missing |= np.isin(out, given.get(key, ()))
    out = out * first("scalefactor", 1.0) + first("addoffset", 0.0)
    out[missing] = np.nan
    return out


def _short(value: Any, most: int = 40) -> str:
    text = value.decode(errors="replace") if isinstance(value, bytes) else str(value)
    return text if len(text) <= most else f"{text[: most - 3]}…"


def said_by(error: Exception) -> str:
    """What a library says of a file that it cannot read, as a part of a sentence."""
    line = next((line for line in str(error).splitlines() if line.strip()), type(error).__name__)
    return _short(printable(line).strip(" ."), SAID)


@dataclass(slots=True, kw_only=True)
class Contents:
    """The parts of a file that have been read so far."""

    format: str
    columns: list[Column] = field(default_factory=list)
    numbers: dict[str, float] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    entries: list[tuple[str, Any]] = field(default_factory=list)  # by name, in which the file may state its date

    def add(self, name: str, read: Callable[[], Any], stated: Mapping[str, Any] | None = None, **known: Any) -> None:
        """One part: its values are had by `read`, whose failure leaves this part out; `stated` are its properties.

        known  fields of its `Column` that its properties do not state; None of those that nothing is known of
        """
        stated = stated or {}
        self.entries += stated.items()
        try:
            found = read()
            array = found if isinstance(found, StoredRow) else np.asarray(found)
        except Exception as error:  # of a library that met an odd part: each raises its own
            said = said_by(error)
            self.left_out[name] = "unequal parts" if "inhomogeneous" in said else f"cannot be read: {said}"
            return
        if isinstance(array, np.ndarray) and array.dtype.names:
            for part in array.dtype.names:
                self.add(f"{name}.{part}", partial(getitem, array, part), stated, **known)
            return
        is_time = array.dtype.kind in "mM"
        about: dict[str, Any] = {"unit": unit_in(stated), "rate": rate_in(stated), "is_time": is_time}
        about |= {key: value for key, value in known.items() if value is not None}
        if array.size and (array.size == 1 or is_time):
            self.entries.append(("date" if is_time else name, np.ravel(array[:1] if array.ndim else array)[0]))
        if is_time and array.size > 1:
            array, about["unit"] = _seconds(array if array.ndim == 1 else np.ravel(array)), "s"
        if array.size == 1 and array.dtype.kind in "fiub":
            self.numbers[name] = float(np.asarray(array).item())
            return
        if array.ndim == 1:
            array = stored(array)
        array, notes = as_stated(name, array, stated)
        self.notes += notes
        columns = columns_of_array(Column(name=name, values=array, **about))
        if not columns:
            self.left_out[name] = why_no_column(np.asarray(array))
        self.columns += columns

    def table(self, started: datetime | None = None) -> Table:
        """The file; each column that has a start of its own begins there, the file with the first of them."""
        first = min((c.started for c in self.columns if c.started), default=started) or stated_in(self.entries)
        columns = []
        for column in self.columns:
            later = (column.started - first).total_seconds() if column.started and first else 0.0
            rate = column.rate or self._rate_beside(column)
            unit = column.unit or self._unit_beside(column)
            columns.append(replace(column, start=column.start + later, rate=rate, unit=unit))
        scales = [n for n in self.numbers if LIKE_A_SCALE.search(group_of(n)[1])]
        self.notes += [f"the number {n!r} = {self.numbers[n]:g} is not applied" for n in scales]
        return Table(
            format=self.format, columns=tuple(columns), numbers=self.numbers, started=first, notes=tuple(self.notes),
            left_out=self.left_out,
        )  # fmt: skip

    def _unit_beside(self, column: Column) -> str:
        """The unit that a text beside the one signal of a group states, as in a structure of data, rate and unit."""
        group = group_of(column.name)[0]
        signals = [c for c in self.columns if group_of(c.name)[0] == group and plain(group_of(c.name)[1]) not in TIMES]
        beside = {n: v for n, v in self.entries if group_of(n)[0] == group and plain(group_of(n)[1]) in UNITS}
        if not group or signals != [column] or not beside:
            return ""
        for name in beside:
            self.left_out.pop(name, None)
        return unit_in({group_of(n)[1]: v for n, v in beside.items()})

    def _rate_beside(self, column: Column) -> float | None:
        """The rate that a single number of the column's group, or of one around it, states [Hz]."""
        group = column.name
        while group and column.times is None:
            group = group_of(group)[0]
            beside = {group_of(n)[1]: v for n, v in self.numbers.items() if group_of(n)[0] == group}
            if (rate := rate_in(beside)) is not None:
                return rate
        return None


def why_no_column(array: np.ndarray) -> str:
    """Why an array is no column of numbers."""
    if array.size == 0:
        return "empty"
    if array.dtype.kind == "O" and all(np.ndim(v) == 1 for v in array.flat):
        return f"lists of {np.size(array.flat[0])} values, one list a row"
    if array.dtype.kind not in "fiub":
        kinds = {"c": "complex numbers", "U": "text", "S": "text", "M": "one date", "m": "one duration"}
        return f"{kinds.get(array.dtype.kind, 'of mixed kinds')}, not real numbers"
    return f"an array of {' × '.join(str(n) for n in array.shape)} values, no row of at most 256 channels"


def _seconds(moments: Row) -> Row:
    """Moments or durations as seconds after the first; NaN of one that is missing."""
    first = next((m for part in pieces(moments) for m in part[~np.isnat(part)][:1]), moments[0])

    def after(part: np.ndarray) -> np.ndarray:
        return np.asarray((part - first) / np.timedelta64(1, "ns"), dtype=float) * 1e-9

    return changed(moments, after)
