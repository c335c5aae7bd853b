"""Universal files (UFF), data set 58: functions at points of a structure, by pyuff. Time histories are read."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from service.files.readers.stored import GrowingRow
from service.files.readers.table import Column, Table, rounded_rate, unique_names

PRINTED = 6e-6  # relative uncertainty of a step that is printed with six digits
LONG = 2**24  # data set as text that is read in parts [bytes]
HEAD = 13  # lines above the values
TIME = 17  # abscissa_spec_data_type
DIRECTIONS = {0: "", 1: "+X", 2: "+Y", 3: "+Z", -1: "-X", -2: "-Y", -3: "-Z"}
MOMENTS = ("%d-%b-%y %H:%M:%S", "%d-%b-%Y %H:%M:%S")


def read_uff(path: Path) -> Table:
    """The time histories of the file, named by their point and direction where that is unique, else by their number."""
    import pyuff

    file = pyuff.UFF(str(path))
    kinds = [int(kind) for kind in file.get_set_types()]
    with TemporaryDirectory() as folder:
        part = Path(folder) / "part.uff"
        sets = [_kept(_parts(file, path, i, part)) for i, kind in enumerate(kinds) if kind == 58]
    histories = [s for s in sets if _is_history(s)]
    if not histories:
        held = ", ".join(str(kind) for kind in sorted(set(kinds)))
        raise ValueError(
            f"it holds no time history (data set 58 of function type 1), only data sets {held or 'of none'}"
        )
    others = len(sets) - len(histories)
    names = unique_names([("", _name(s)) for s in histories])
    columns = tuple(_column(name, s) for name, s in zip(names, histories, strict=True))
    notes: tuple[str, ...] = (
        (f"{others} data sets of other functions (spectra, responses) are left out",) if others else ()
    )
    moments = sorted({m for s in histories if (m := _moment(str(s.get("id3", "")))) is not None})
    if len(moments) > 1:
        last = moments[-1] - moments[0]
        notes += (f"the dates of the histories lie up to {last.total_seconds():g} s apart, which is not applied",)
    return Table(format="UFF-58", columns=columns, notes=notes, started=moments[0] if moments else None)


def _parts(file: Any, path: Path, number: int, part: Path) -> Iterator[dict[str, Any]]:
    """A data set of `path`; a long one as text in parts, each as a file of its own with the head of the whole."""
    import pyuff

    begin, end = (int(place) for place in file._block_ind[number])
    with path.open("rb") as whole:
        whole.seek(begin)
        lines = [whole.readline() for _ in range(HEAD)]
        if end - begin < LONG or lines[1][6:7].lower() == b"b":  # binary
            yield file.read_sets(number)
            return
        head = b"".join(lines)
        while (left := end - whole.tell()) > 0:
            part.write_bytes(head + b"".join(whole.readlines(min(LONG, left)))[:left] + b"\n    -1\n")
            yield pyuff.UFF(str(part)).read_sets(0)


def _kept(parts: Iterator[dict[str, Any]]) -> dict[str, Any]:
    """A data set from its parts, of whose rows only so much is in memory at a time."""
    head = next(parts)
    first = {"x": (), **head, "data": np.asarray(head.get("data", ()))}
    if not _is_history(first):
        return first
    rows = {"data": GrowingRow(), "x": GrowingRow()}
    for each in chain([first], parts):
        for key, row in rows.items():
            row.append(np.asarray(each[key]).astype(float))
    return first | {key: row.row() for key, row in rows.items()}


def _is_history(data: dict[str, Any]) -> bool:
    values = data["data"]
    kinds = (int(data.get("func_type", 1)), int(data.get("abscissa_spec_data_type", TIME)))
    return values.size > 1 and values.dtype.kind != "c" and kinds[0] in (0, 1) and kinds[1] in (0, TIME)


def _name(data: dict[str, Any]) -> str:
    """The point and direction, such as `housing:3+Z`; the first identification line where there is none."""
    entity = str(data.get("rsp_ent_name", "") or "").strip()
    entity = "" if entity == "NONE" else entity
    node, direction = int(data.get("rsp_node", 0) or 0), int(data.get("rsp_dir", 0) or 0)
    point = f"{node or ''}{DIRECTIONS.get(direction, '')}"
    named = ":".join(part for part in (entity, point) if part)
    return named or str(data.get("id1", "") or "").strip() or "history"


def _column(name: str, data: dict[str, Any]) -> Column:
    values, unit = data["data"], str(data.get("ordinate_axis_units_lab", "") or "").strip()
    step, even = float(data.get("abscissa_inc", 0.0) or 0.0), int(data.get("abscissa_spacing", 1) or 0) == 1
    unit = "" if unit == "NONE" else unit
    if even and step > 0:
        start = float(data.get("abscissa_min", 0.0) or 0.0)
        return Column(name=name, values=values, unit=unit, rate=rounded_rate(1 / step, PRINTED), start=start)
    return Column(name=name, values=values, unit=unit, times=data["x"])


def _moment(text: str) -> datetime | None:
    for form in MOMENTS:
        try:
            return datetime.strptime(text.strip().title(), form)  # by a local clock
        except ValueError:
            continue
    return None
