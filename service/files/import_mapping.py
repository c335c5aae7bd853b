"""The mapping file of `gear-twin import`: which column is which channel, in which unit, on which gears.

    schema = "gear-import/1"
    asset = "my-gearbox"
    description = "…"
    started = 2020-10-28T00:00:00Z         # left out where not known
    notes = ["…"]                          # kept with the recording

    [file]
    path = "channels.npz"                  # CSV, CSV.gz or NPZ, relative to this file
    sample_rate_hz = 25600
    delimiter = ","                        # of a CSV

    [channels.ch14]                        # name of the sensor, shaft (pinion or gear) or place
    kind = "accel"                         # a kind of service/stream/channels.py; accel if left out
    column = "ch14"                        # header of a CSV column, array of an NPZ; the name if left out
    unit = "V"                             # one of the kind's units of import, such as m/s2, g, V, Nm
    sensitivity = 0.0510204                # V per the contract's unit of the kind, with unit V

    [channels.pinion]
    kind = "encoder"
    unit = "s"                             # times of its edges; or "quadrature": two levels, 0 or 1, at every sample
    columns = ["enc1_a", "enc1_b"]         # of a quadrature encoder, in place of `column`
    edges_per_rev = 1024                   # with quadrature the fourfold counts; or the name of a number in an NPZ file
    first_edge_index = 0

    [rig]                                  # a rig file of what is known: tooth counts, nominal speed, …; may be empty

Every fault is one line that names the key, its value and what would be right.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from service.errors import InputError
from service.files.documents import check_asset, check_keys, check_schema, load_document, number_of, table_of
from service.files.rig import checked_rig
from service.stream.channels import CHANNEL_KINDS, ChannelKind, Conversion, Layout
from service.stream.wire.topics import NAME

SCHEMA = "gear-import/1"
RATES = (1.0, 1e7)  # [Hz]
QUADRATURE = "quadrature"
EDGES = (1, 1e7)  # a turn
_KEYS: dict[str, tuple[str, ...]] = {
    "": ("schema", "asset", "description", "started", "notes", "file", "channels", "rig"),
    "file.": ("path", "sample_rate_hz", "delimiter"),
    "channels.": (
        "kind", "column", "unit", "sensitivity", "edges_per_rev", "first_edge_index", "note", "columns",
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelMapping:
    """One column, or the two of a quadrature encoder, and what it becomes."""

    kind: str  # a key of CHANNEL_KINDS
    name: str  # sensor, shaft or place
    columns: tuple[str, ...]
    unit: str
    factor: float = 1.0  # from the file's values to the contract's unit: factor · value + offset
    offset: float = 0.0
    edges_per_rev: int = 0  # 0 where the data file holds it, or of no encoder
    edges_per_rev_from: str = ""  # the number of the data file that holds it
    first_edge_index: int = 0
    note: str = ""

    @property
    def label(self) -> str:
        return f"{self.kind}/{self.name}"

    @property
    def left_out(self) -> str:
        """Why the column is checked but not imported; empty where it is imported."""
        return CHANNEL_KINDS[self.kind].import_units[self.unit].left_out


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportMapping:
    """A whole mapping file, checked."""

    where: str  # the mapping file's name, for messages
    asset: str
    description: str
    started: datetime | None
    notes: tuple[str, ...]
    path: Path
    sample_rate: float  # [Hz]
    delimiter: str
    channels: tuple[ChannelMapping, ...]
    rig: dict[str, Any]


def load_import_mapping(path: str | Path) -> ImportMapping:
    """The checked mapping of a mapping file; InputError with the key that is wrong."""
    path = Path(path)
    return checked_mapping(load_document(path, "mapping file"), path)


def checked_mapping(data: dict[str, Any], path: Path) -> ImportMapping:
    """The mapping of a TOML document read from `path`."""
    where = str(path)
    check_schema(where, data, SCHEMA)
    check_keys(where, _KEYS, "", data)
    asset = check_asset(where, data)
    file = table_of(where, data, "file")
    check_keys(where, _KEYS, "file.", file)
    if not isinstance(file.get("path"), str):
        raise InputError(f"{where}: file.path = {file.get('path')!r} must name a CSV, CSV.gz or NPZ file")
    channels = table_of(where, data, "channels")
    if not channels:
        raise InputError(f"{where}: channels must name at least one column")
    rig = dict(table_of(where, data, "rig"))
    rig.setdefault("schema", "gear-rig/1")
    rig.setdefault("name", asset)
    checked_rig(rig, f"{where}: rig")
    mapped = tuple(_channel(where, name, table) for name, table in channels.items())
    reference = rig.get("sensors", {}).get("accelerometer")
    sensors = [c.name for c in mapped if c.kind == "accel" and not c.left_out]
    if reference is not None and reference not in sensors:
        raise InputError(
            f"{where}: rig.sensors.accelerometer = {reference!r} must be one of the accelerometers: "
            f"{', '.join(sensors) or 'none is mapped'}"
        )
    return ImportMapping(
        where=where,
        asset=asset,
        description=str(data.get("description", "")),
        started=_started(where, data.get("started")),
        notes=tuple(str(n) for n in data.get("notes", ())),
        path=path.parent / file["path"],
        sample_rate=number_of(where, "file.sample_rate_hz", file.get("sample_rate_hz"), RATES, "Hz", "kHz?"),
        delimiter=str(file.get("delimiter", ",")),
        channels=mapped,
        rig=rig,
    )


def _channel(where: str, name: str, table: Any) -> ChannelMapping:
    key = f"channels.{name}"
    if not isinstance(table, dict):
        raise InputError(f"{where}: {key} = {table!r} must be a table")
    check_keys(where, _KEYS, "channels.", table, key + ".")
    kind = _kind_of(where, key, name, table)
    unit = table.get("unit")
    if not isinstance(unit, str) or unit not in kind.import_units:
        raise InputError(f"{where}: {key}.unit = {unit!r} must be one of {', '.join(kind.import_units)}")
    conversion = kind.import_units[unit]
    edges, edges_from, first = 0, "", 0
    if kind.layout is Layout.EDGES:
        given = table.get("edges_per_rev")
        if isinstance(given, str):
            edges_from = given
        else:
            edges = checked_edges(where, f"{key}.edges_per_rev", given)
        first = int(number_of(where, f"{key}.first_edge_index", table.get("first_edge_index", 0), (0, 2**53), ""))
    return ChannelMapping(
        kind=kind.segment,
        name=name,
        columns=_columns(where, key, name, unit, table),
        unit=unit,
        factor=_factor(where, key, kind, conversion, table),
        offset=conversion.offset,
        edges_per_rev=edges,
        edges_per_rev_from=edges_from,
        first_edge_index=first,
        note=str(table.get("note", "")),
    )


def _kind_of(where: str, key: str, name: str, table: dict[str, Any]) -> ChannelKind:
    """The kind of a channel, which must allow its name."""
    segment = table.get("kind", "accel")
    if not isinstance(segment, str) or segment not in CHANNEL_KINDS:
        raise InputError(f"{where}: {key}.kind = {segment!r} must be one of {', '.join(CHANNEL_KINDS)}")
    kind = CHANNEL_KINDS[segment]
    if not NAME.fullmatch(name):
        raise InputError(f"{where}: {key}: a {kind.named_by}'s name must be 1 to 64 letters, digits, '_', '-' or '.'")
    if kind.names and name not in kind.names:
        raise InputError(f"{where}: {key}: a channel of kind {segment} must be named {' or '.join(kind.names)}")
    return kind


def _factor(where: str, key: str, kind: ChannelKind, conversion: Conversion, table: dict[str, Any]) -> float:
    """What the values of the column are multiplied by; of volts, one over the sensitivity that the mapping gives."""
    sensitivity = table.get("sensitivity")
    if conversion.per_volt:
        return 1 / number_of(where, f"{key}.sensitivity", sensitivity, (1e-9, 1e9), f"V per {kind.unit}", "mV?")
    if sensitivity is not None:
        raise InputError(
            f"{where}: {key}.sensitivity = {sensitivity!r} goes with unit 'V' only, not {table.get('unit')!r}"
        )
    return conversion.factor


def checked_edges(where: str, key: str, value: Any) -> int:
    """A number of edges a turn; InputError where it cannot be."""
    number = number_of(where, key, value, EDGES, "edges")
    if number != int(number):
        raise InputError(f"{where}: {key} = {number:g} must be a whole number of edges a turn")
    return int(number)


def _columns(where: str, key: str, name: str, unit: str, table: dict[str, Any]) -> tuple[str, ...]:
    """The columns of a channel: one, or the two levels of a quadrature encoder."""
    if unit != QUADRATURE:
        if "columns" in table:
            raise InputError(f"{where}: {key}.columns goes with unit {QUADRATURE!r} only, not {unit!r}; column?")
        return (str(table.get("column", name)),)
    columns = table.get("columns")
    if "column" in table or not isinstance(columns, list) or not all(isinstance(c, str) for c in columns):
        raise InputError(f"{where}: {key}.columns must name the two levels, a and b, of a quadrature encoder")
    if len(columns) != 2 or columns[0] == columns[1]:
        raise InputError(f"{where}: {key}.columns = {columns} must name two columns, the levels a and b")
    return tuple(columns)


def _started(where: str, value: Any) -> datetime | None:
    if value is None:
        return None
    if not isinstance(value, datetime):
        raise InputError(f"{where}: started = {value!r} must be a date with time, such as 2020-10-28T00:00:00Z")
    moment = value if value.tzinfo else value.replace(tzinfo=UTC)
    if moment.timestamp() <= 0:
        raise InputError(f"{where}: started = {value.isoformat()} must lie after 1970-01-01")
    return moment
