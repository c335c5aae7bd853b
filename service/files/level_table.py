"""Wear depths of a table of levels, one row a record, by a relation of level and depth.

The table is CSV with the columns that the relation's series had, in the same units. A cell may be empty: the depth is
then by the other columns alone. All other columns go into the answer as they are.
"""

from __future__ import annotations

import csv
from io import StringIO
from math import isfinite
from pathlib import Path
from typing import Any

from service.errors import InputError
from service.files.csv_table import read_table
from service.files.series import LEVEL_UNITS
from twin.levels.relation import Quantity, Relation
from twin.levels.wear_by_level import bounds_reason

FOUND = ("median_um", "p05_um", "p95_um", "reason")
ONE_UNIT = "m/s2"  # of the levels of a relation that states none


def depths_of(relation: Relation, table: Path, delimiter: str = ",") -> list[dict[str, Any]]:
    """Every row with the depth of both flanks together [µm]; InputError with what is wrong."""
    columns = {k: relation.quantities.get(k, Quantity(column=k, unit=ONE_UNIT)) for k in relation.curves}
    wrong = [q.unit for q in columns.values() if q.unit not in LEVEL_UNITS]
    if wrong:
        raise InputError(f"the relation's unit {wrong[0]!r} must be one of {', '.join(LEVEL_UNITS)}")
    header, rows = read_table(table, delimiter)
    if not rows:
        raise InputError(f"{table}: has no rows")
    there = {k: q for k, q in columns.items() if q.column in header}
    if not there:
        wanted = ", ".join(repr(q.column) for q in columns.values())
        raise InputError(f"{table}: none of the relation's columns is there: {wanted}")
    out = []
    for number, row in enumerate(rows, start=2):
        levels = {
            k: value * LEVEL_UNITS[q.unit]
            for k, q in there.items()
            if (value := _level(f"{table.name}, line {number}", q.column, row)) is not None
        }
        own = {k: v for k, v in row.items() if k not in {q.column for q in there.values()}}
        out.append(own | _depth(relation, levels))
    return out


def as_csv(rows: list[dict[str, Any]]) -> str:
    """The answer as CSV, depths to a tenth of a µm."""
    text = StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({k: f"{v:.1f}" if isinstance(v, float) else v for k, v in row.items()})
    return text.getvalue()


def _depth(relation: Relation, levels: dict[str, float]) -> dict[str, Any]:
    if not levels:
        return dict.fromkeys(FOUND[:-1]) | {"reason": "no level is given"}
    found = relation.depth(levels)
    return {
        "median_um": 1e6 * found.median if found.bounded else None,
        "p05_um": 1e6 * found.p05,
        "p95_um": 1e6 * found.p95 if found.bounded else None,
        "reason": bounds_reason(found),
    }


def _level(at: str, column: str, row: dict[str, str]) -> float | None:
    """A positive number; None of an empty cell."""
    if not row[column].strip():
        return None
    try:
        value = float(row[column])
    except ValueError:
        raise InputError(f"{at}: {column} = {row[column]!r} must be a number") from None
    if not isfinite(value) or value <= 0:
        raise InputError(f"{at}: {column} = {row[column]!r} must be positive and finite")
    return value
