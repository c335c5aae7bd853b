"""CSV, TSV and other text files of numbers, plain or gzipped; how they are laid out is found in them (text_form.py)."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from service.files.readers.printed_times import seconds_of
from service.files.readers.table import Column, Table
from service.files.readers.text_form import MISSING, Layout, TextForm, cells_of, is_number, layout_of, stated_rate

BYTE_ORDER_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}


class NoNumbers(ValueError):
    """The file is no text, or has no rows of numbers: it may be of another format."""


def read_text(path: Path, form: TextForm | None = None) -> Table:
    """The columns of numbers; columns of dates or times of day become seconds after the first row."""
    whole = _lines(path)
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
    rows = lines[layout.first :]
    notes: tuple[str, ...] = ()
    if len(rows) < 2:
        raise NoNumbers("it has one row of numbers")
    if len(rows) > 1 and len(cells_of(rows[-1], layout.separator)) != len(layout.names):
        rows, notes = rows[:-1], ("the last row is cut off and left out",)
    filled = [i for i in range(len(layout.names)) if not _is_blank(layout, rows, i)]
    chosen = [i for i in filled if layout.numeric[i] or layout.moments[i]]
    values = _numbers(rows, layout, [i for i in chosen if layout.numeric[i]])
    columns, started = [], None
    for i in chosen:
        name, is_time = layout.names[i], layout.moments[i] and not layout.numeric[i]
        if is_time:
            values[i], first = seconds_of([cells_of(row, layout.separator)[i] for row in rows])
            started = started or (first if first is not None and first.tzinfo else None)
        columns.append(Column(name=name, values=values[i], unit="s" if is_time else layout.units[i], is_time=is_time))
    left_out = {layout.names[i]: _no_number(rows, layout, i) for i in filled if i not in chosen}
    rate = stated_rate(lines[: layout.first])
    return Table(format="CSV", columns=tuple(columns), rate=rate, notes=notes, left_out=left_out, started=started)


def _no_number(rows: Sequence[str], layout: Layout, i: int) -> str:
    """Why a column is none of numbers: its first cell that is no number."""
    cells = ((n, cells_of(row, layout.separator)[i:]) for n, row in enumerate(rows, start=1))
    odd = next(((n, c[0]) for n, c in cells if c and not is_number(c[0], layout.decimal)), None)
    return (
        "holds no numbers" if odd is None else f"row {odd[0]} is {odd[1][:40]!r}, which is no number and no known time"
    )


def _lines(path: Path) -> list[str]:
    raw = path.read_bytes()
    if raw[:2] == b"\x1f\x8b":
        raw = gzip.decompress(raw)
    encoding = next((e for mark, e in BYTE_ORDER_MARKS.items() if raw.startswith(mark)), "utf-8")
    if encoding == "utf-8" and b"\x00" in raw[:4096]:
        raise NoNumbers("it is no text, and of no format that is known here")
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError:
        text = raw.decode("cp1252", errors="replace")
    return text.splitlines()


def _is_blank(layout: Layout, rows: Sequence[str], i: int) -> bool:
    """Whether a column without a name is empty: rows that end with a separator have one."""
    named = layout.names[i] != f"column {i + 1}"
    return not named and all(cells_of(row, layout.separator)[i] == "" for row in rows[:100])


def _numbers(rows: Sequence[str], layout: Layout, used: Sequence[int]) -> dict[int, np.ndarray]:
    """The columns of numbers by their place."""
    if not used:
        return {}
    separator = None if layout.separator == " " else layout.separator
    filled = (_filled(row, layout) for row in rows)
    try:
        table = np.loadtxt(filled, delimiter=separator, usecols=used, ndmin=2, comments=None, quotechar='"')
    except ValueError as error:
        raise ValueError(_where(rows, layout, used) or str(error).splitlines()[0]) from None
    return {i: table[:, j] for j, i in enumerate(used)}


def _filled(row: str, layout: Layout) -> str:
    """A row with decimal points, and `nan` where a cell is empty or says that there is no value."""
    if layout.decimal == ",":
        row = row.replace(",", ".")
    s = layout.separator
    if s == " ":
        return row
    if s * 2 in row or row.startswith(s) or row.endswith(s) or any(c.isalpha() and c not in "eE" for c in row) or (
        f"{s} {s}" in row
    ):  # fmt: skip
        return s.join("nan" if cell.strip().strip('"').lower() in MISSING else cell for cell in row.split(s))
    return row


def _where(rows: Sequence[str], layout: Layout, used: Sequence[int]) -> str:
    """The first cell that is no number, with its row and column."""
    for number, row in enumerate(rows, start=1):
        cells = cells_of(row, layout.separator)
        if len(cells) != len(layout.names):
            return f"row {number} has {len(cells)} cells, not {len(layout.names)}"
        for i in used:
            text = cells[i].replace(",", ".") if layout.decimal == "," else cells[i]
            try:
                float("nan" if text.lower() in MISSING else text)
            except ValueError:
                return f"row {number} of column {layout.names[i]!r} is {cells[i]!r}, not a number"
    return ""
