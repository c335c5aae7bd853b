"""Tables of levels: the series of `gear-twin relate`, whose wear depths are known, and tables whose depths are asked.

A series file names its table and the rig that the levels are of:

    schema = "gear-series/1"
    asset = "my-gearbox"
    description = "…"
    notes = ["…"]

    [file]
    path = "records.csv"                   # one row a record, relative to this file
    case = "case"                          # column: which records are of one assembly of the machine
    depth = "wear_depth_um"                # column: largest depth, both flanks together
    depth_unit = "um"                      # um, mm or m
    unworn_by_day = "start"                # column, may be left out: unworn records of one day are one assembly
    delimiter = ","

    [sensor]                               # what the levels are of; each may be left out where it is not known
    name = "a2"                            # accelerometer, as rig files of this machine name it
    band_hz = [0.0, 2000.0]                # band of the RMS

    [levels.fast]                          # one table an operating condition
    column = "rms"                         # RMS of the reference accelerometer
    unit = "g"                             # g or m/s2; "1": an indicator that the model does not predict
    speed_hz = 45.0                        # of the pinion
    torque_nm = 5.1                        # on the pinion

    [estimated]                            # numbers of the rig below that may be off by so much, up or down
    "gears.face_width" = 1.2

    [rig]                                  # a rig file, with all that the model needs

A table of `gear-twin depths` has the columns that the relation's series had, in the same units, one row a record. A
cell may be empty: the depth is then by the other columns alone. All other columns go into the answer as they are.

Every fault is one line that names the key, its value and what would be right.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from io import StringIO
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import InputError
from service.file_faults import reading
from service.files.documents import Part, load_document, number_of
from service.files.rig import checked_rig
from service.stream.channels import STANDARD_GRAVITY
from twin.errors import ParameterError
from twin.levels.relation import INDICATOR, Cases, Quantity, Relation
from twin.levels.trials import LEAST_WORN
from twin.levels.wear_by_level import bounds_reason
from twin.model import Condition
from twin.rig import Rig

SCHEMA = "gear-series/1"
DEPTH_UNITS = {"um": 1e-6, "mm": 1e-3, "m": 1.0}
LEVEL_UNITS = {"g": STANDARD_GRAVITY, "m/s2": 1.0, INDICATOR: 1.0}
DEEPEST = 0.01  # [m]
FACTORS = (1.001, 100.0)
SPEEDS, TORQUES = (0.01, 2000.0), (1e-3, 1e6)  # [Hz], [N·m]
FREQUENCIES = (0.0, 1e6)  # [Hz]
DATE = 10  # characters of an ISO date
FOUND = ("median_um", "p05_um", "p95_um", "reason")
ONE_UNIT = "m/s2"  # of the levels of a relation that states none


@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """A checked series file with its records."""

    asset: str
    description: str
    notes: tuple[str, ...]
    rig: Rig
    conditions: Mapping[str, Condition]
    quantities: Mapping[str, Quantity]  # column and unit of every condition
    estimated: Mapping[str, float]
    cases: Cases
    records: int
    sensor: str | None = None  # accelerometer of the levels, None where it is not stated
    band: tuple[float, float] | None = None  # of the levels [Hz]

    @property
    def stated(self) -> tuple[str, ...]:
        """Which of "sensor" and "band" of the levels the series states."""
        return tuple(name for name, value in (("sensor", self.sensor), ("band", self.band)) if value is not None)


def load_series(path: Path, source: Path | None = None) -> Series:
    """A series file with the records it names, or those of another file; InputError with what is wrong."""
    document = Part(str(path), load_document(path, "series file")).of_schema(SCHEMA)
    document.only("schema", "asset", "description", "notes", "file", "sensor", "levels", "estimated", "rig")
    where, asset, levels = document.where, document.asset(), document.table("levels")
    file = document.table("file").only("path", "case", "depth", "depth_unit", "unworn_by_day", "delimiter")
    if not levels.values:
        raise InputError(f"{where}: levels must name at least one operating condition")
    conditions = {name: _condition(levels.table(name)) for name in levels.values}
    quantities = {k: Quantity(column=str(v.get("column")), unit=v["unit"]) for k, v in levels.values.items()}
    if not any(quantity.modelled for quantity in quantities.values()):
        raise InputError(f"{where}: levels names indicators alone (unit {INDICATOR!r}): one vibration level is needed")
    sensor, band = _sensor(document.table("sensor"))
    tables = document.table("rig")
    values = dict(tables.values)
    if band is not None:
        seen = tables.table("sensors")
        if list(seen.values.get("band_hz", band)) != list(band):
            raise seen.fault("band_hz", f"contradicts sensor.band_hz = {[*band]}")
        values["sensors"] = {**seen.values, "band_hz": [*band]}
    rig = checked_rig({"schema": "gear-rig/1", "name": asset} | values, f"{where}: rig")
    factors = document.table("estimated")
    estimated = {key: factors.number(key, FACTORS) for key in factors.values}
    for key in estimated:
        if not isinstance(rig.get(key), (int, float)):
            raise InputError(f"{where}: estimated.{key} is no number of the rig file given here")
    records, cases = _cases(file, path.parent, source, quantities)
    return Series(
        asset=asset,
        description=str(document.values.get("description", "")),
        notes=document.texts("notes"),
        rig=rig,
        conditions=conditions,
        quantities=quantities,
        estimated=estimated,
        cases=cases,
        records=records,
        sensor=sensor,
        band=band,
    )


def _sensor(table: Part) -> tuple[str | None, tuple[float, float] | None]:
    """What the levels are of: sensor and band [Hz], None where the series does not say."""
    table.only("name", "band_hz")
    name = table.text("name", "must name an accelerometer") if "name" in table.values else None
    band = table.values.get("band_hz")
    if band is None:
        return name, None
    if not isinstance(band, list) or len(band) != 2:
        raise table.fault("band_hz", "must be [lowest, highest] in Hz")
    low, high = (number_of(f"{table.where}: sensor.band_hz", f, FREQUENCIES, "Hz", "kHz?") for f in band)
    if not low < high:
        raise table.fault("band_hz", "must rise")
    return name, (low, high)


def _condition(table: Part) -> Condition:
    table.only("column", "unit", "speed_hz", "torque_nm").one_of("unit", LEVEL_UNITS)
    try:
        return Condition(
            speed_hz=table.number("speed_hz", SPEEDS, "Hz", "rev/min?"),
            torque=table.number("torque_nm", TORQUES, "N·m", "N·mm?"),
        )
    except ParameterError as error:
        raise InputError(f"{table.where}: {table.path.removesuffix('.')}: {error}") from None


def _cases(file: Part, folder: Path, source: Path | None, quantities: Mapping[str, Quantity]) -> tuple[int, Cases]:
    """Number of records, and the assemblies they make."""
    table = folder / file.text("path", "must name a CSV file") if source is None else source
    for key in ("case", "depth"):
        if key not in file.values:
            raise InputError(f"{file.where}: file.{key} must name a column of {table.name}")
    names = {key: str(file.values[key]) for key in ("case", "depth", "unworn_by_day") if key in file.values}
    columns = {f"file.{key}": name for key, name in names.items()}
    columns |= {f"levels.{key}.column": quantity.column for key, quantity in quantities.items()}
    header, rows = _read_table(table, str(file.values.get("delimiter", ",")))
    for key, column in columns.items():
        if column not in header:
            raise InputError(f"{file.where}: {key} = {column!r} is not in {table.name}, which has {', '.join(header)}")
    unit = DEPTH_UNITS[file.one_of("depth_unit", DEPTH_UNITS, "m")]
    groups: dict[str, list[tuple[float, list[float]]]] = {}
    for at, row in rows:
        depth = _number(at, names["depth"], row) * unit
        if not 0 <= depth < DEEPEST:
            raise InputError(f"{at}: depth {depth:g} m is outside [0, {DEEPEST:g}); another file.depth_unit?")
        group = row[names["case"]]
        if depth == 0 and "unworn_by_day" in names:
            group = f"{group} {row[names['unworn_by_day']][:DATE]}"
        measured = [_level(at, q, row) for q in quantities.values()]
        groups.setdefault(group, []).append((depth, measured))
    for group, members in groups.items():
        if len({depth for depth, _ in members}) > 1:
            raise InputError(f"{table.name}: records of {group!r} have several depths: one a case")
    if sum(members[0][0] > 0 for members in groups.values()) < LEAST_WORN:
        raise InputError(f"{table.name}: too few worn cases, at least {LEAST_WORN} are needed")
    values = [np.array([measured for _, measured in members]) for members in groups.values()]
    return len(rows), Cases(
        name=tuple(groups),
        depth=np.array([members[0][0] for members in groups.values()]),
        level={k: np.array([v[:, i].mean() for v in values]) for i, k in enumerate(quantities)},
        scatter={
            k: np.array([v[:, i].std(ddof=1) if len(v) > 1 else np.nan for v in values])
            for i, k in enumerate(quantities)
        },
    )


def depths_of(relation: Relation, table: Path, delimiter: str = ",") -> list[dict[str, Any]]:
    """Every row with the depth of both flanks together [µm]; InputError with what is wrong."""
    columns = {k: relation.quantities.get(k, Quantity(column=k, unit=ONE_UNIT)) for k in relation.curves}
    wrong = [q.unit for q in columns.values() if q.unit not in LEVEL_UNITS]
    if wrong:
        raise InputError(f"the relation's unit {wrong[0]!r} must be one of {', '.join(LEVEL_UNITS)}")
    header, rows = _read_table(table, delimiter)
    if not rows:
        raise InputError(f"{table}: has no rows")
    there = {k: q for k, q in columns.items() if q.column in header}
    if not there:
        wanted = ", ".join(repr(q.column) for q in columns.values())
        raise InputError(f"{table}: none of the relation's columns is there: {wanted}")
    levels = {q.column for q in there.values()}
    return [
        {k: v for k, v in row.items() if k not in levels}
        | _depth(
            relation,
            {k: _level(at, q, row) for k, q in there.items() if row[q.column].strip()},
        )
        for at, row in rows
    ]


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


def _level(at: str, quantity: Quantity, row: Mapping[str, str]) -> float:
    """A level in its relation's unit, such as m/s²."""
    value = _number(at, quantity.column, row)
    if value <= 0:
        raise InputError(f"{at}: {quantity.column} = {row[quantity.column]!r} must be positive and finite")
    return value * LEVEL_UNITS[quantity.unit]


def _read_table(table: Path, delimiter: str) -> tuple[list[str], list[tuple[str, dict[str, str]]]]:
    """The names of the columns, and the rows, each with its place and a cell for every column; InputError."""
    if len(delimiter) != 1:
        raise InputError(f"{table}: delimiter = {delimiter!r} must be one character")
    try:
        with reading(table), table.open(encoding="utf-8-sig", newline="") as lines:
            reader = csv.DictReader(lines, delimiter=delimiter)
            header, rows = list(reader.fieldnames or ()), list(reader)
    except (UnicodeDecodeError, csv.Error, ValueError) as error:
        raise InputError(f"{table}: is no readable CSV file: {error}") from None
    placed = [(f"{table.name}, line {number}", row) for number, row in enumerate(rows, start=2)]
    for at, row in placed:
        if None in row or None in row.values():
            raise InputError(f"{at}: {len(header)} cells are needed, as in the header")
    return header, placed


def _number(at: str, column: str, row: Mapping[str, str]) -> float:
    """The finite number in a cell of the row at a place."""
    try:
        value = float(row[column])
    except ValueError:
        raise InputError(f"{at}: {column} = {row[column]!r} must be a number") from None
    if not isfinite(value):
        raise InputError(f"{at}: {column} = {row[column]!r} must be finite")
    return value
