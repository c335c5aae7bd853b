"""How a text file of numbers is laid out: separator, decimal sign, where its rows begin, what its columns are called.

The rows in the middle of the file decide: of all separators and decimal signs, those under which most cells of a row
are numbers, and then most numbers are in a row. Above the first row of numbers there may be a row of names, a row of
units below it, and lines of any kind, in which a sample rate may be stated.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from service.files.dates import is_printed_time
from service.files.readers.table import split_unit
from service.files.units import UNIT_NAMES

SEPARATORS = (";", "\t", ",", "|", " ")
PROBED = 40  # rows from the middle that decide
FOLLOWING, MOST = 8, 0.75  # lines after the first row of numbers, and which share of them must be such rows
NUMBER, MOMENT = "number", "moment"  # kinds of columns; a moment is a date or a time of day
MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-"}
RATE = re.compile(
    r"(?:sampl(?:e|ing)[ _-]*(?:rate|freq\w*)|sample_rate_hz|abtastrate|abtastfrequenz"
    r"|fr[eé]quence d.[eé]chantillonnage|\bfs\b)"
    r"\W*?(?:\(|\[)?\s*(?P<before>[kM]?Hz|S/s|kS/s)?\s*(?:\)|\])?[\s:=;,\t\"]*"
    r"(?P<number>\d[\d.,]*(?:[eE][+-]?\d+)?)\s*(?P<after>[kM]?Hz|k?S/s)?",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TextForm:
    """The layout of a text file; what is None is found in the file."""

    separator: str | None = None
    decimal: str | None = None
    header_row: int | None = None  # number of the line with the names, from 1; 0 where there is none


@dataclass(frozen=True, slots=True)
class Signs:
    """The separator of cells and the decimal sign of a text."""

    separator: str
    decimal: str

    def cells(self, line: str) -> list[str]:
        """The cells of a line; quotes around a cell are left out."""
        parts = line.split() if self.separator == " " else line.split(self.separator)
        return [part.strip().strip('"').strip() for part in parts]

    def is_number(self, cell: str) -> bool:
        """Whether a cell is a number or empty; an underscore, which Python would take, is neither."""
        if cell.lower() in MISSING:
            return True
        if self.decimal == ",":
            if "." in cell:
                return False
            cell = cell.replace(",", ".")
        try:
            float(cell)
        except ValueError:
            return False
        return "_" not in cell

    def fits(self, cell: str, kind: str) -> bool:
        """Whether a cell may stand in a column of a kind."""
        return not kind or (self.is_number(cell) if kind == NUMBER else is_printed_time(cell))


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """The layout that was found."""

    signs: Signs
    first: int  # index of the first row of numbers
    names: tuple[str, ...]
    units: tuple[str, ...]
    kinds: tuple[str, ...]  # of each column: NUMBER, MOMENT, or empty where it is neither


def layout_of(lines: Sequence[str], form: TextForm) -> Layout | None:
    """The layout of a file's non-blank lines; None where there are no rows of numbers."""
    probe = _probe(lines)
    best: tuple[tuple[float, float], Signs] | None = None
    for separator in (form.separator,) if form.separator else SEPARATORS:
        for decimal in (form.decimal,) if form.decimal else (".", ","):
            if separator == decimal or _is_decimal_comma(lines[0], probe, separator):
                continue
            signs = Signs(separator, decimal)
            if (score := _score(probe, signs)) and (not best or score > best[0]):
                best = (score, signs)
    if best is None:
        return None
    signs = best[1]
    columns = zip(*map(signs.cells, probe), strict=True)
    kinds = tuple(
        next((k for k in (NUMBER, MOMENT) if all(signs.fits(c, k) for c in column)), "") for column in columns
    )
    first = _first_row(lines, signs, kinds)
    if first is None:
        return None
    names, units = _names(lines[:first], signs, len(kinds), form.header_row)
    return Layout(signs=signs, first=first, names=names, units=units, kinds=kinds)


def _is_decimal_comma(head: str, probe: Sequence[str], separator: str) -> bool:
    """Whether the comma of a single column is its decimal sign: the name above it has none."""
    named = not Signs(separator, ".").is_number(head.strip()) and "," not in head
    return separator == "," and named and all(line.count(",") == 1 for line in probe)


def _probe(lines: Sequence[str]) -> Sequence[str]:
    """Rows from the middle of the file, without the last one, which may be cut off."""
    if len(lines) <= 3:
        return lines[-1:]
    begin = min(len(lines) // 2, len(lines) - 2)
    return lines[begin : min(begin + PROBED, len(lines) - 1)]


def _score(probe: Sequence[str], signs: Signs) -> tuple[float, float] | None:
    """Share of the cells that are numbers, and how many a row has; None where the rows differ in length."""
    rows = [signs.cells(line) for line in probe]
    if len({len(row) for row in rows}) != 1:
        return None
    good = sum(signs.is_number(cell) or is_printed_time(cell) for row in rows for cell in row)
    filled = sum(cell.lower() not in MISSING for row in rows for cell in row)
    if not good or not filled:
        return None
    share = good / (len(rows) * len(rows[0]))
    return (share, good / len(rows)) if good > len(rows) / 2 else None


def _first_row(lines: Sequence[str], signs: Signs, kinds: Sequence[str]) -> int | None:
    """The first line that has numbers where the columns have them, as most of the next lines do."""

    def fits(line: str) -> bool:
        row = signs.cells(line)
        if len(row) != len(kinds) or not all(map(signs.fits, row, kinds)):
            return False
        return any(cell.lower() not in MISSING for cell, kind in zip(row, kinds, strict=True) if kind)

    for i, line in enumerate(lines):
        following = lines[i + 1 : min(i + 1 + FOLLOWING, len(lines) - 1)]
        if fits(line) and sum(fits(later) for later in following) >= MOST * len(following):
            return i
    return None


def _names(
    above: Sequence[str], signs: Signs, width: int, header_row: int | None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names and units of the columns, from the lines above the numbers."""
    numbered = tuple(f"column {i + 1}" for i in range(width))
    none = ("",) * width
    if header_row == 0:
        return numbered, none
    rows = [signs.cells(line.lstrip("#%")) for line in above[-2 if header_row is None else header_row - 1 :]]
    if header_row is not None and (not rows or len(rows[0]) != width):
        return numbered, none
    fitting = [row for row in rows if len(row) == width and not all(map(signs.is_number, row))]
    if not fitting:
        return numbered, none
    unit_row = fitting[-1] if len(fitting) > 1 and _are_units(fitting[-1]) else None
    header = fitting[-2] if unit_row else fitting[0 if header_row is not None else -1]
    names = tuple(cell or numbered[i] for i, cell in enumerate(header))
    if unit_row:
        return names, tuple(cell.strip("[]()") for cell in unit_row)
    return names, tuple(split_unit(name)[1] for name in names)


def _are_units(row: Sequence[str]) -> bool:
    return any(row) and all(cell.strip("[]()").lower() in UNIT_NAMES for cell in row)


def stated_rate(lines: Sequence[str]) -> float | None:
    """The sample rate that the lines above the numbers state [Hz]."""
    for line in lines:
        found = RATE.search(line)
        if not found:
            continue
        text = found["number"].rstrip(".,")
        text = text.replace(",", ".") if "." not in text else text.replace(",", "")
        unit = (found["after"] or found["before"] or "Hz").lower()
        try:
            value = float(text) * {"k": 1e3, "m": 1e6}.get(unit[0], 1.0)
        except ValueError:
            continue
        if value > 0:
            return value
    return None
