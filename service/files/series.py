"""Series file of `gear-twin relate`: levels that were measured at known wear depths, and the rig they are of.

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

Every fault is one line that names the key, its value and what would be right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import InputError
from service.files.csv_table import read_table
from service.files.documents import check_asset, check_keys, check_schema, load_document, number_of, table_of
from service.files.rig import checked_rig
from service.stream.channels import STANDARD_GRAVITY
from twin.errors import ParameterError
from twin.levels.relation import INDICATOR, Cases, Quantity
from twin.levels.trials import LEAST_WORN
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
_KEYS = {
    "": ("schema", "asset", "description", "notes", "file", "sensor", "levels", "estimated", "rig"),
    "file.": ("path", "case", "depth", "depth_unit", "unworn_by_day", "delimiter"),
    "sensor.": ("name", "band_hz"),
    "levels.": ("column", "unit", "speed_hz", "torque_nm"),
}


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
    data, where = load_document(path, "series file"), str(path)
    check_schema(where, data, SCHEMA)
    check_keys(where, _KEYS, "", data)
    asset = check_asset(where, data)
    file, levels = table_of(where, data, "file"), table_of(where, data, "levels")
    check_keys(where, _KEYS, "file.", file)
    if not levels:
        raise InputError(f"{where}: levels must name at least one operating condition")
    conditions = {name: _condition(where, name, table) for name, table in levels.items()}
    if all(table["unit"] == INDICATOR for table in levels.values()):
        raise InputError(f"{where}: levels names indicators alone (unit {INDICATOR!r}): one vibration level is needed")
    sensor, band = _sensor(where, table_of(where, data, "sensor"))
    tables = table_of(where, data, "rig")
    if band is not None:
        seen = table_of(where, tables, "sensors")
        if list(seen.get("band_hz", band)) != list(band):
            raise InputError(f"{where}: rig.sensors.band_hz = {seen['band_hz']} contradicts sensor.band_hz = {[*band]}")
        tables = tables | {"sensors": seen | {"band_hz": [*band]}}
    rig = checked_rig({"schema": "gear-rig/1", "name": asset} | tables, f"{where}: rig")
    estimated = table_of(where, data, "estimated")
    for key, factor in estimated.items():
        number_of(where, f"estimated.{key}", factor, FACTORS, "")
        if not isinstance(rig.get(key), (int, float)):
            raise InputError(f"{where}: estimated.{key} is no number of the rig file given here")
    rows, cases = _cases(where, path, source, file, levels)
    return Series(
        asset=asset,
        description=str(data.get("description", "")),
        notes=tuple(str(n) for n in data.get("notes", ())),
        rig=rig,
        conditions=conditions,
        quantities={k: Quantity(column=str(v["column"]), unit=str(v["unit"])) for k, v in levels.items()},
        estimated={k: float(v) for k, v in estimated.items()},
        cases=cases,
        records=rows,
        sensor=sensor,
        band=band,
    )


def _sensor(where: str, table: Mapping[str, Any]) -> tuple[str | None, tuple[float, float] | None]:
    """What the levels are of: sensor and band [Hz], None where the series does not say."""
    check_keys(where, _KEYS, "sensor.", table)
    name, band = table.get("name"), table.get("band_hz")
    if name is not None and (not isinstance(name, str) or not name):
        raise InputError(f"{where}: sensor.name = {name!r} must name an accelerometer")
    if band is None:
        return name, None
    if not isinstance(band, list) or len(band) != 2:
        raise InputError(f"{where}: sensor.band_hz = {band!r} must be [lowest, highest] in Hz")
    low, high = (number_of(where, "sensor.band_hz", f, FREQUENCIES, "Hz", "kHz?") for f in band)
    if not low < high:
        raise InputError(f"{where}: sensor.band_hz = {band!r} must rise")
    return name, (low, high)


def _condition(where: str, name: str, table: Any) -> Condition:
    key = f"levels.{name}"
    if not isinstance(table, dict):
        raise InputError(f"{where}: {key} = {table!r} must be a table")
    check_keys(where, _KEYS, "levels.", table, key + ".")
    if table.get("unit") not in LEVEL_UNITS:
        raise InputError(f"{where}: {key}.unit = {table.get('unit')!r} must be one of {', '.join(LEVEL_UNITS)}")
    try:
        return Condition(
            speed_hz=number_of(where, f"{key}.speed_hz", table.get("speed_hz"), SPEEDS, "Hz", "rev/min?"),
            torque=number_of(where, f"{key}.torque_nm", table.get("torque_nm"), TORQUES, "N·m", "N·mm?"),
        )
    except ParameterError as error:
        raise InputError(f"{where}: {key}: {error}") from None


def _cases(
    where: str, path: Path, source: Path | None, file: Mapping[str, Any], levels: Mapping[str, Any]
) -> tuple[int, Cases]:
    """Number of records, and the assemblies they make."""
    name = file.get("path")
    if source is None and not isinstance(name, str):
        raise InputError(f"{where}: file.path = {name!r} must name a CSV file")
    table = source if source is not None else path.parent / str(name)
    columns = {f"file.{key}": str(file.get(key)) for key in ("case", "depth", "unworn_by_day") if key in file}
    for key in ("case", "depth"):
        if f"file.{key}" not in columns:
            raise InputError(f"{where}: file.{key} must name a column of {table.name}")
    columns |= {f"levels.{k}.column": str(v.get("column")) for k, v in levels.items()}
    rows = _rows(where, table, str(file.get("delimiter", ",")), columns)
    unit = file.get("depth_unit", "m")
    if unit not in DEPTH_UNITS:
        raise InputError(f"{where}: file.depth_unit = {unit!r} must be one of {', '.join(DEPTH_UNITS)}")
    groups: dict[str, list[tuple[float, list[float]]]] = {}
    for number, row in enumerate(rows, start=2):
        at = f"{table.name}, line {number}"
        depth = _cell(at, columns["file.depth"], row) * DEPTH_UNITS[unit]
        if not 0 <= depth < DEEPEST:
            raise InputError(f"{at}: depth {depth:g} m is outside [0, {DEEPEST:g}); another file.depth_unit?")
        group = row[columns["file.case"]]
        if depth == 0 and "unworn_by_day" in file:
            group = f"{group} {row[columns['file.unworn_by_day']][:DATE]}"
        measured = [_cell(at, v["column"], row) * LEVEL_UNITS[v["unit"]] for v in levels.values()]
        if min(measured) <= 0:
            raise InputError(f"{at}: a level must be positive")
        groups.setdefault(group, []).append((depth, measured))
    for group, members in groups.items():
        if len({depth for depth, _ in members}) > 1:
            raise InputError(f"{table.name}: records of {group!r} have several depths: one a case")
    if sum(members[0][0] > 0 for members in groups.values()) < LEAST_WORN:
        raise InputError(f"{table.name}: too few worn cases, at least {LEAST_WORN} are needed")
    values = {g: np.array([m for _, m in members]) for g, members in groups.items()}
    return len(rows), Cases(
        name=tuple(groups),
        depth=np.array([members[0][0] for members in groups.values()]),
        level={k: np.array([v[:, i].mean() for v in values.values()]) for i, k in enumerate(levels)},
        scatter={
            k: np.array([v[:, i].std(ddof=1) if len(v) > 1 else np.nan for v in values.values()])
            for i, k in enumerate(levels)
        },
    )


def _rows(where: str, table: Path, delimiter: str, columns: Mapping[str, str]) -> list[dict[str, str]]:
    header, rows = read_table(table, delimiter)
    for key, column in columns.items():
        if column not in header:
            raise InputError(f"{where}: {key} = {column!r} is not in {table.name}, which has {', '.join(header)}")
    return rows


def _cell(at: str, column: str, row: Mapping[str, str]) -> float:
    try:
        value = float(row[column])
    except (TypeError, ValueError):
        raise InputError(f"{at}: {column} = {row[column]!r} must be a number") from None
    if not isfinite(value):
        raise InputError(f"{at}: {column} = {row[column]!r} must be finite")
    return value
