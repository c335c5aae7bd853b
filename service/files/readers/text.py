"""CSV, TSV and other text files of numbers, plain or gzipped; how they are laid out is found in them (text_form.py)."""

from __future__ import annotations

import codecs
import gzip
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import BinaryIO, TextIO, cast

import numpy as np

from service.files.dates import seconds_of, stated_in
from service.files.readers.stored import GrowingRow
from service.files.readers.table import Column, Table
from service.files.readers.text_form import MISSING, MOMENT, NUMBER, Layout, TextForm, layout_of, stated_rate

BYTE_ORDER_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}

HEAD = 2**20  # of a file, by which its encoding is known [bytes]
LINES = 50_000  # that are read at once
LONGEST = 2**20  # line that a table may have [characters]


class NoNumbers(ValueError):
    """The file is no text, or has no rows of numbers: it may be of another format."""


def read_text(path: Path, form: TextForm | None = None) -> Table:
    """The columns of numbers; columns of dates or times of day become seconds after the first row."""
    with _opened(path) as file:
        parts = _parts(file)
        whole = next(parts, [])
        lines = [line for line in whole if line.strip()]
        if not lines:
            raise ValueError("it is empty")
        form = form or TextForm()
        if form.header_row:  # without the blank lines above it
            above = whole[: form.header_row]
            form = replace(form, header_row=sum(bool(line.strip()) for line in above))
        layout = layout_of(lines, form)
        if layout is None:
            raise NoNumbers("there are no rows of numbers in it")
        first = lines[layout.first :]
        if len(first) < 2:
            raise NoNumbers("it has one row of numbers")
        filled = [i for i in range(len(layout.names)) if not _is_blank(layout, first, i)]
        chosen = [i for i in filled if layout.kinds[i]]
        found = _Columns(layout, chosen)
        rows = first
        while rows:
            later = [line for line in next(parts, []) if line.strip()]
            if not later and len(layout.signs.cells(rows[-1])) != len(layout.names):
                rows, found.notes = rows[:-1], ("the last row is cut off and left out",)
            found.take(rows)
            rows = later
    left_out = {layout.names[i]: _no_number(first, layout, i) for i in filled if i not in chosen}
    rate = stated_rate(lines[: layout.first])
    cells = layout.signs.cells(first[0])
    texts = [(layout.names[i], cells[i]) for i in filled if not layout.kinds[i]]
    started = found.started or stated_in([*texts, *map(_entry, lines[: layout.first])])
    return Table(
        format="CSV", columns=found.columns(), rate=rate, notes=found.notes, left_out=left_out, started=started
    )  # fmt: skip


class _Columns:
    """The columns of a text file, whose rows are taken in parts."""

    def __init__(self, layout: Layout, chosen: Sequence[int]) -> None:
        self.layout, self.chosen = layout, chosen
        self.started: datetime | None = None
        self.notes: tuple[str, ...] = ()
        self._rows = 0
        self._numeric = [i for i in chosen if layout.kinds[i] == NUMBER]
        self._growing = {i: GrowingRow() for i in chosen}
        self._last: dict[int, tuple[str, float]] = {}  # of columns of times: cell and seconds of the row before

    def take(self, rows: Sequence[str]) -> None:
        """The next rows of the file."""
        values = _numbers(rows, self.layout, self._numeric, self._rows)
        for i in set(self.chosen) - values.keys():
            values[i] = self._seconds(i, [self.layout.signs.cells(row)[i] for row in rows])
        for i, row in self._growing.items():
            row.append(values[i])
        self._rows += len(rows)

    def _seconds(self, i: int, cells: list[str]) -> np.ndarray:
        """Seconds after the first row of the file, also of times of day past midnight."""
        if i in self._last:
            before, begin = self._last[i]
            seconds = begin + seconds_of([before, *cells])[0][1:]
        else:
            seconds, first = seconds_of(cells)
            self.started = self.started or first
        self._last[i] = cells[-1], float(seconds[-1])
        return seconds

    def columns(self) -> tuple[Column, ...]:
        """The columns in the order of the file."""
        out = []
        for i in self.chosen:
            is_time = self.layout.kinds[i] == MOMENT
            unit = "s" if is_time else self.layout.units[i]
            out.append(Column(name=self.layout.names[i], values=self._growing[i].row(), unit=unit, is_time=is_time))
        return tuple(out)


def _no_number(rows: Sequence[str], layout: Layout, i: int) -> str:
    """Why a column is none of numbers: its first cell that is no number."""
    cells = ((n, layout.signs.cells(row)[i:]) for n, row in enumerate(rows, start=1))
    odd = next(((n, c[0]) for n, c in cells if c and not layout.signs.is_number(c[0])), None)
    return (
        "holds no numbers" if odd is None else f"row {odd[0]} is {odd[1][:40]!r}, which is no number and no known time"
    )


def _entry(line: str) -> tuple[str, str]:
    """A line of the preamble as name and value; one that is nothing but a date, as a date."""
    name, _, value = re.sub("[:=;,\t]", "\0", line, count=1).partition("\0")
    return (name, value) if any(c.isalpha() for c in name) else ("date", line)


@contextmanager
def _opened(path: Path) -> Iterator[TextIO]:
    """The text of a file, plain or gzipped, in the encoding that its beginning has."""
    with path.open("rb") as plain:
        packed = plain.read(2) == b"\x1f\x8b"
    with gzip.open(path) if packed else path.open("rb") as file:
        head = file.read(HEAD)
        file.seek(0)
        encoding = next((e for mark, e in BYTE_ORDER_MARKS.items() if head.startswith(mark)), "utf-8")
        if encoding == "utf-8" and b"\x00" in head[:4096]:
            raise NoNumbers("it is no text, and of no format that is known here")
        try:
            codecs.getincrementaldecoder(encoding)().decode(head, final=len(head) < HEAD)
        except UnicodeDecodeError:
            encoding = "cp1252"
        with io.TextIOWrapper(cast(BinaryIO, file), encoding, errors="replace") as text:
            yield text


def _parts(file: TextIO) -> Iterator[list[str]]:
    """The lines of a text, so many at a time; ValueError of one that has no end."""
    while True:
        lines: list[str] = []
        for _ in range(LINES):
            line = file.readline(LONGEST)
            if len(line) == LONGEST:
                raise NoNumbers(f"a line of it is longer than {LONGEST:,} characters")
            if not line:
                break
            lines.append(line.rstrip("\n"))
        if not lines:
            return
        yield lines


def _is_blank(layout: Layout, rows: Sequence[str], i: int) -> bool:
    """Whether a column without a name is empty: rows that end with a separator have one."""
    named = layout.names[i] != f"column {i + 1}"
    return not named and all(layout.signs.cells(row)[i] == "" for row in rows[:100])


def _numbers(rows: Sequence[str], layout: Layout, used: Sequence[int], before: int) -> dict[int, np.ndarray]:
    """The columns of numbers by their place, of rows behind so many others."""
    if not used:
        return {}
    separator = None if layout.signs.separator == " " else layout.signs.separator
    filled = (_filled(row, layout) for row in rows)
    try:
        table = np.loadtxt(filled, delimiter=separator, usecols=used, ndmin=2, comments=None, quotechar='"')
    except ValueError as error:
        raise ValueError(_where(rows, layout, used, before) or str(error).splitlines()[0]) from None
    return {i: table[:, j] for j, i in enumerate(used)}


def _filled(row: str, layout: Layout) -> str:
    """A row with decimal points, and `nan` where a cell is empty or says that there is no value."""
    if layout.signs.decimal == ",":
        row = row.replace(",", ".")
    s = layout.signs.separator
    if s == " ":
        return row
    if s * 2 in row or row.startswith(s) or row.endswith(s) or any(c.isalpha() and c not in "eE" for c in row) or (
        f"{s} {s}" in row
    ):  # fmt: skip
        return s.join("nan" if cell.strip().strip('"').lower() in MISSING else cell for cell in row.split(s))
    return row


def _where(rows: Sequence[str], layout: Layout, used: Sequence[int], before: int) -> str:
    """The first cell that is no number, with its row and column."""
    for number, row in enumerate(rows, start=before + 1):
        cells = layout.signs.cells(row)
        if len(cells) != len(layout.names):
            return f"row {number} has {len(cells)} cells, not {len(layout.names)}"
        odd = next((i for i in used if not layout.signs.is_number(cells[i])), None)
        if odd is not None:
            return f"row {number} of column {layout.names[odd]!r} is {cells[odd]!r}, not a number"
    return ""
