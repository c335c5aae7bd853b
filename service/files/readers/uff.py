"""Universal files (UFF), data set 58: functions at points of a structure, as text or binary. Time histories are read.

A data set lies between two lines of `    -1`: thirteen lines, of which that is the first, say what it is, and its
values follow. The columns are those of https://www.ceas3.uc.edu/sdrluff; times are stored where steps are uneven.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from itertools import accumulate, chain, pairwise
from pathlib import Path

import numpy as np

from service.files.readers.stored import GrowingRow, Row, StoredRow
from service.files.readers.table import Column, Table, rounded_rate, unique_names

PRINTED = 6e-6  # relative uncertainty of a step that is printed with six digits
MARK = b"    -1"
MARK_LINE = 82  # with its blanks and its end, at most [bytes]
HEAD = 13  # lines above the values
LINE = 2**10  # at most [bytes]
BLOCK = 2**20  # looked through for marks at once [bytes]
PART = 2**22  # of text made into numbers at once [bytes]
TIME = 17  # abscissa_spec_data_type
SINGLE, DOUBLE, COMPLEX = 2, 4, (5, 6)  # ord_data_type
CELLS = {  # of a line of text: columns of each, by ord_data_type and whether the steps are even
    (SINGLE, True): (13,) * 6, (DOUBLE, True): (20,) * 4, (SINGLE, False): (13,) * 6, (DOUBLE, False): (13, 20) * 2,
}  # fmt: skip
FOREIGN = {"1": "DEC VMS", "3": "IBM 5/370"}  # numbers of a binary set that are not of IEEE
DIRECTIONS = {"1": "+X", "2": "+Y", "3": "+Z", "-1": "-X", "-2": "-Y", "-3": "-Z"}
MOMENTS = ("%d-%b-%y %H:%M:%S", "%d-%b-%Y %H:%M:%S")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Set:
    """A data set: its head, and where its values lie."""

    head: Sequence[str]
    begin: int
    end: int

    @property
    def kind(self) -> str:
        return self.head[1][:6].strip()

    @property
    def is_binary(self) -> bool:
        return self.head[1][6:7].lower() == "b"

    @property
    def numbers(self) -> int:
        """How its values are coded (`ord_data_type`)."""
        return int(_number(self.head[8][:10]))

    @property
    def is_even(self) -> bool:
        return _number(self.head[8][20:30]) == 1

    @property
    def is_history(self) -> bool:
        of, over = _number(self.head[7][:5]), _number(self.head[9][:10])
        return self.kind == "58" and of in (0, 1) and over in (0, TIME) and self.numbers not in COMPLEX

    @property
    def name(self) -> str:
        """The point and direction, such as `housing:3+Z`; the first identification line where there is none."""
        entity, node, direction = (self.head[7][a:b].strip() for a, b in ((30, 41), (41, 51), (51, 55)))
        point = f"{node if node != '0' else ''}{DIRECTIONS.get(direction, '')}"
        named = ":".join(part for part in (entity if entity != "NONE" else "", point) if part)
        return named or self.head[2].strip() or "history"

    @property
    def moment(self) -> datetime | None:
        """When it was recorded, by a local clock."""
        for form in MOMENTS:
            try:
                return datetime.strptime(self.head[4].strip().title(), form)
            except ValueError:
                continue
        return None


def read_uff(path: Path) -> Table:
    """The time histories of the file, named by their point and direction where that is unique, else by their number."""
    sets = list(_sets(path))
    histories = [s for s in sets if s.kind == "58" and s.is_history]
    if not histories:
        held = ", ".join(sorted({s.kind for s in sets}))
        raise ValueError(
            f"it holds no time history (data set 58 of function type 1), only data sets {held or 'of none'}"
        )
    columns, notes, left_out = [], [], {}
    for name, each in zip(unique_names([("", s.name) for s in histories]), histories, strict=True):
        values, times = _read_binary(path, each) if each.is_binary else _read_text(path, each)
        stated = int(_number(each.head[8][10:20]))
        if values.size != stated:
            notes.append(f"{name!r} states {stated} values and holds {values.size}, which are read")
        if values.size > 1:
            columns.append(_column(name, each, values, times))
        else:
            left_out[name] = f"holds {values.size} values"
    others = sum(s.kind == "58" for s in sets) - len(histories)
    if others:
        notes.append(f"{others} data sets of other functions (spectra, responses) are left out")
    moments = sorted({s.moment for s in histories if s.moment is not None})
    if len(moments) > 1:
        last = moments[-1] - moments[0]
        notes.append(f"the dates of the histories lie up to {last.total_seconds():g} s apart, which is not applied")
    return Table(
        format="UFF-58", columns=tuple(columns), notes=tuple(notes), started=moments[0] if moments else None,
        left_out=left_out,
    )  # fmt: skip


def _sets(path: Path) -> Iterator[_Set]:
    """The data sets of a file; one that was interrupted ends in the last of them."""
    size, found = path.stat().st_size, None
    with path.open("rb") as file:
        for place, is_line in chain(_marks(path), [(size, True)]):
            if found is not None and (is_line or (found.is_binary and place >= found.begin)):
                yield _Set(head=found.head, begin=found.begin, end=place)
                found = None
            elif found is None and is_line and place < size:
                file.seek(place)
                head = [file.readline(LINE).decode(errors="replace").rstrip("\r\n") for _ in range(HEAD)]
                found = _Set(head=head, begin=min(file.tell(), size), end=size)


def _marks(path: Path) -> Iterator[tuple[int, bool]]:
    """Where each `    -1` lies that ends its line, and whether it begins it, as it does except behind binary values."""
    with path.open("rb") as file:
        place, block, more = -1, b"\n", file.read(BLOCK)  # of the block, which begins before what is looked at
        while more:
            block, more = block + more, file.read(BLOCK)
            until = len(block) - (MARK_LINE if more else 0)
            at = 0
            while (at := block.find(MARK, at + 1, until + len(MARK) - 1)) > 0:
                if not block[at + len(MARK) : at + MARK_LINE].partition(b"\n")[0].strip():
                    yield place + at, block[at - 1 : at] == b"\n"
            place, block = place + until - 1, block[until - 1 :]


def _read_text(path: Path, of: _Set) -> tuple[Row, Row | None]:
    """Values of a data set as text, and their times where it stores them."""
    if (widths := CELLS.get((of.numbers, of.is_even))) is None:
        raise ValueError(f"its numbers are of type {of.numbers}, which is not known")
    cells = list(pairwise(accumulate(widths, initial=0)))
    rows = [GrowingRow()] if of.is_even else [GrowingRow(), GrowingRow()]
    with path.open("rb") as file:
        file.seek(of.begin)
        while (left := of.end - file.tell()) > 0:
            part = file.read(min(PART, left))
            part += file.readline(min(LINE, of.end - file.tell()))
            lines = [line.rstrip() for line in part.decode("ascii", errors="replace").split("\n")]
            if max(map(len, lines)) > cells[-1][1]:
                raise ValueError(f"a line of its values is longer than {cells[-1][1]} columns")
            lines.pop()  # nothing, or what was cut off
            try:
                values = np.array([float(line[a:b]) for line in lines for a, b in cells if a < len(line)])
            except ValueError as error:
                raise ValueError(f"it holds {str(error).partition(': ')[2]} for a number") from None
            if values.size % len(rows):
                raise ValueError("it holds a time without a value")
            for i, row in enumerate(rows):
                row.append(values[i :: len(rows)])
    return rows[-1].row(), None if of.is_even else rows[0].row()


def _read_binary(path: Path, of: _Set) -> tuple[Row, Row | None]:
    """Values of a binary data set, and their times where it stores them; they stay in the file."""
    order, coded = of.head[1][7:13].strip(), of.head[1][13:19].strip()
    if of.numbers not in (SINGLE, DOUBLE) or coded in FOREIGN:
        raise ValueError(f"its numbers are of type {FOREIGN.get(coded, of.numbers)}, which is not known")
    number = f"{'<' if order == '1' else '>'}f{2 * of.numbers}"
    dtype = np.dtype([("y", number)] if of.is_even else [("x", number), ("y", number)])

    def row(key: str) -> Row:
        read = partial(_numbers, path, of.begin, dtype, key)
        size = max(of.end - of.begin, 0) // dtype.itemsize
        return StoredRow(size=size, dtype=np.dtype(float), read=read)

    return row("y"), None if of.is_even else row("x")


def _numbers(path: Path, at: int, dtype: np.dtype[np.void], key: str, begin: int, end: int) -> np.ndarray:
    with path.open("rb") as file:
        found = np.fromfile(file, dtype, count=end - begin, offset=at + begin * dtype.itemsize)
    return found[key].astype(float)


def _column(name: str, of: _Set, values: Row, times: Row | None) -> Column:
    unit, start, step = of.head[10][46:67].strip(), _number(of.head[8][30:43]), _number(of.head[8][43:56])
    unit = "" if unit == "NONE" else unit
    if times is not None or step <= 0:
        return Column(name=name, values=values, unit=unit, times=times)
    return Column(name=name, values=values, unit=unit, rate=rounded_rate(1 / step, PRINTED), start=start)


def _number(text: str) -> float:
    """A number of a head; 0 where there is none."""
    try:
        value = float(text) if text.strip() else 0.0
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"it states {text.strip()!r} for a number")
    return value
