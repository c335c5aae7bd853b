"""The mapping file of `gear-twin import`: which column is which channel, in which unit, on which gears.

    schema = "gear-import/1"
    asset = "my-gearbox"
    description = "…"
    started = 2020-10-28T00:00:00Z         # left out where not known, or where the data file states it
    zone = "Europe/Berlin"                 # of a date that is a local time, as the file states it or `started`
    notes = ["…"]                          # kept with the recording
    age = "new"                            # of the gears when the file begins: also "5000 rev", "1200 h" or "unknown"

    [file]
    path = "channels.csv"                  # of any format of service/files/readers, relative to this file
    sample_rate_hz = 25600                 # left out where the data file has a time column, or states its rate
    time_column = "Time (s)"               # found by its name where left out; "" if a column of that name is no time
    delimiter = ";"                        # of a text file: found in it where left out, as are the next two
    decimal = ","
    header_row = 4                         # line with the names of the columns; 0: there is none

    [channels.ch14]                        # name of the sensor, shaft (pinion or gear) or place
    kind = "accel"                         # a kind of service/stream/channels.py, or "tachometer"; accel if left out
    column = "ch14"                        # header of a column, or name in the file; the channel's name if left out
    unit = "V"                             # one of the kind's units of import, such as m/s2, g, V, Nm
    sensitivity = 0.0510204                # V per the contract's unit of the kind, with unit V
    scale = 1.0                            # the file's values times this are in `unit`; -1 turns the polarity

    [channels.encoder.pinion]              # kind and name, for a torque meter and an encoder on one shaft; the same as
                                           # [channels."encoder/pinion"]
    unit = "s"                             # times of its edges; or "quadrature": two levels, 0 or 1, at every sample
    columns = ["enc1_a", "enc1_b"]         # of a quadrature encoder, in place of `column`
    edges_per_rev = 1024                   # with quadrature the fourfold counts; or the name of a number in the file
    first_edge_index = 0

    [channels.tachometer.pinion]           # pulses in an analog column
    column = "Tacho (V)"
    pulses_per_rev = 1                     # 1 if left out
    threshold = "auto"                     # or a level in the column's unit
    hysteresis = 0.5                       # in the column's unit; from the pulses' height if left out
    edge = "rising"                        # or "falling"
    missing_teeth = 0                      # of a toothed wheel with a gap, such as 2 of 60

    [rig]                                  # a rig file of what is known: tooth counts, nominal speed, …; may be empty;
                                           # or above all tables: rig = "rig.toml", relative to this file

Every fault is one line that names the key, its value and what would be right.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from service.errors import InputError
from service.files.documents import Part, load_document, number_of
from service.files.readers import TextForm, format_of
from service.files.rig import age_of, checked_rig, load_mapping
from service.files.units import UNITS
from service.stream.channels import CHANNEL_KINDS, SHAFTS, ChannelKind, Conversion, Layout
from service.stream.wire.topics import NAME
from twin.features.pulses import PulseSettings

SCHEMA = "gear-import/1"
RATES = (1.0, 1e7)  # [Hz]
TEXT_FILES = (".csv", ".tsv", ".txt", ".gz", ".dat", ".asc")
QUADRATURE, COUNTS, PULSES = "quadrature", "counts", "pulses"
SAMPLED = (QUADRATURE, COUNTS, PULSES)  # units of encoders whose columns are sampled evenly; others hold edge times
ROLL_OVER = (2.0**16, 2.0**24, 2.0**32)  # of counters
TACHOMETER = "tachometer"  # a kind of this file alone: what comes of it is an encoder channel
KINDS = (*CHANNEL_KINDS, TACHOMETER)
EDGES = (1, 1e7)  # a turn
SENSITIVITY = re.compile(
    r"^\s*(?P<number>\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)\s*(?P<volt>m?V|µV|μV|uV)\s*/\s*(?P<per>.+?)\s*$"
)
VOLT = {"V": 1.0, "mV": 1e-3, "µV": 1e-6, "μV": 1e-6, "uV": 1e-6}
FLANKS = ("rising", "falling")
OF_PULSES = ("pulses_per_rev", "threshold", "hysteresis", "edge", "missing_teeth")
_CHANNEL = (
    "kind", "column", "unit", "sensitivity", "scale", "edges_per_rev", "first_edge_index", "note", "columns",
    *OF_PULSES,
)  # fmt: skip
_KEYS = ("schema", "asset", "description", "started", "zone", "notes", "age", "file", "channels", "rig")
_FILE = ("path", "sample_rate_hz", "time_column", "delimiter", "decimal", "header_row")


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelMapping:
    """One column, or the two of a quadrature encoder, and what it becomes."""

    kind: str  # a key of CHANNEL_KINDS
    name: str  # sensor, shaft or place
    key: str  # of its table in the mapping file, for messages
    place: str  # the same with the file's name
    columns: tuple[str, ...]
    unit: str
    factor: float = 1.0  # from the file's values to the contract's unit: factor · value + offset
    offset: float = 0.0
    edges_per_rev: int = 0  # 0 where the data file holds it, or of no encoder
    edges_per_rev_from: str = ""  # the number of the data file that holds it
    first_edge_index: int | None = None  # None where the mapping does not state it, and edges count from 0
    pulses: PulseSettings | None = None  # of a tachometer
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
    started: datetime | None  # without `tzinfo` where its zone is not stated
    zone: str | None  # of local times, such as Europe/Berlin
    notes: tuple[str, ...]
    path: Path
    sample_rate: float | None  # [Hz]; None where the data file states it
    time_column: str | None  # None: found by its name; empty: there is none
    text: TextForm
    channels: tuple[ChannelMapping, ...]
    rig: dict[str, Any]
    age: str | float | None  # of the gears when the file begins, as in a rig file; None where it is not stated


def load_import_mapping(path: str | Path, source: str | Path | None = None) -> ImportMapping:
    """The checked mapping of a mapping file; InputError with the key that is wrong.

    source  data file of a mapping that names none
    """
    path = Path(path)
    _refuse_data_file(path)
    return checked_mapping(load_document(path, "mapping file"), path, source)


def checked_mapping(data: dict[str, Any], path: Path, source: str | Path | None = None) -> ImportMapping:
    """The mapping of a TOML document read from `path`."""
    document = Part(str(path), data).of_schema(SCHEMA).only(*_KEYS)
    where, asset = document.where, document.asset()
    file = document.table("file").only(*_FILE)
    named = file.text("path", "must name a data file, or --source must", "" if source else None, least=0)
    channels = document.table("channels")
    if not channels.values:
        raise InputError(f"{where}: channels must name at least one column")
    rig = _rig_of(document, path)
    rig.setdefault("schema", "gear-rig/1")
    rig.setdefault("name", asset)
    checked_rig(rig, f"{where}: rig")
    mapped = mapped_channels(channels)
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
        started=_started(document),
        zone=None if data.get("zone") is None else str(data["zone"]),
        notes=document.texts("notes"),
        path=path.parent / named,
        sample_rate=file.number_if_stated("sample_rate_hz", RATES, "Hz", "kHz?"),
        time_column=_time_column(file),
        text=_text_form(file),
        channels=mapped,
        rig=rig,
        age=_age(document, rig),
    )


def _age(document: Part, rig: dict[str, Any]) -> str | float | None:
    """The gears' age when the file begins; a rig file of its own speaks of the machine's counter, not of this file."""
    if "age" in document.values:
        speed = rig.get("operating", {}).get("pinion_speed_hz")
        return age_of(f"{document.where}: age", document.values["age"], speed)
    return None if isinstance(document.values.get("rig"), str) else rig.get("gears", {}).get("age")


def _rig_of(document: Part, path: Path) -> dict[str, Any]:
    """The rig file of a mapping: its table, or the file that it names."""
    named = document.values.get("rig")
    return load_mapping(path.parent / named) if isinstance(named, str) else dict(document.table("rig").values)


def _refuse_data_file(path: Path) -> None:
    """InputError where a data file is given in place of a mapping."""
    try:
        form = format_of(path)
    except OSError:
        return  # load_document says what is wrong
    if form is not None or path.suffix.lower() in TEXT_FILES:
        kind = form.name if form else "text"
        raise InputError(
            f"{path} is a data file ({kind}), not a mapping file; `gear-twin import {path} --guess` proposes a mapping"
        )


def _time_column(file: Part) -> str | None:
    if "time_column" not in file.values:
        return None
    return file.text("time_column", 'must name a column, or be "" where there is none', least=0)


def _text_form(file: Part) -> TextForm:
    """The layout of a text file, as far as the mapping gives it."""
    separator, decimal = (file.values.get(key) for key in ("delimiter", "decimal"))
    if separator is not None and (not isinstance(separator, str) or len(separator) != 1):
        raise file.fault("delimiter", "must be one character")
    if decimal not in (None, ".", ","):
        raise file.fault("decimal", "must be '.' or ','")
    row = file.number_if_stated("header_row", (0, 1e6))
    return TextForm(separator=separator, decimal=decimal, header_row=None if row is None else int(row))


def _started(document: Part) -> datetime | None:
    value = document.values.get("started")
    if value is None:
        return None
    if not isinstance(value, datetime):
        raise document.fault("started", "must be a date with time, such as 2020-10-28T00:00:00Z")
    if value.replace(tzinfo=value.tzinfo or UTC).timestamp() <= 0:
        raise document.fault("started", "must lie after 1970-01-01")
    return value


def mapped_channels(tables: Part) -> tuple[ChannelMapping, ...]:
    """The channels of the table `[channels]`; InputError with the key that is wrong."""
    channels: list[ChannelMapping] = []
    for kind, name, table in _tables(tables):
        channel = _channel(kind, name, table)
        twin = next((c for c in channels if c.label == channel.label), None)
        if twin is not None:
            raise InputError(
                f"{tables.where}: {channel.key} and {twin.key} are both {channel.label}; a channel has one column"
            )
        channels.append(channel)
    return tuple(channels)


def _tables(tables: Part) -> Iterator[tuple[str, str, Part]]:
    """Kind (empty where only the table says it), name and table of every channel."""
    for name in tables.values:
        table = tables.table(name)
        kind, slash, rest = name.partition("/")
        if slash and kind in KINDS:
            yield kind, rest, table
        elif name in KINDS and table.values and all(isinstance(t, dict) for t in table.values.values()):
            yield from ((name, inner, table.table(inner)) for inner in table.values)
        else:
            yield "", name, table


def _channel(prefix: str, name: str, table: Part) -> ChannelMapping:
    segment = table.only(*_CHANNEL).one_of("kind", KINDS, prefix or "accel")
    if prefix and segment != prefix:
        raise table.fault("kind", "contradicts the name of its table")
    is_tachometer = segment == TACHOMETER
    kind, key = CHANNEL_KINDS["encoder" if is_tachometer else segment], table.path.removesuffix(".")
    if not NAME.fullmatch(name):
        raise InputError(
            f"{table.where}: {key}: a {kind.named_by}'s name must be 1 to 64 letters, digits, '_', '-' or '.'"
        )
    if kind.names and name not in kind.names:
        raise InputError(
            f"{table.where}: {key}: a channel of kind {kind.segment} must be named {' or '.join(kind.names)}, such as "
            f"[channels.{kind.segment}.{SHAFTS[0]}]"
        )
    first = table.number_if_stated("first_edge_index", (0, 2**53)) if kind.layout is Layout.EDGES else None
    return ChannelMapping(
        kind=kind.segment,
        name=name,
        key=key,
        place=f"{table.where}: {key}",
        first_edge_index=None if first is None else int(first),
        note=str(table.values.get("note", "")),
        **(_pulses(name, table) if is_tachometer else _values(kind, name, table)),
    )


def _values(kind: ChannelKind, name: str, table: Part) -> dict[str, Any]:
    """Columns and conversion of a channel."""
    hint = f"; for pulses of a voltage: kind = {TACHOMETER!r}" if kind.layout is Layout.EDGES else ""
    unit = table.one_of("unit", kind.import_units, more=hint)
    _refuse(table, OF_PULSES, f"goes with kind {TACHOMETER!r} only")
    conversion = kind.import_units[unit]
    edges = table.values.get("edges_per_rev") if kind.layout is Layout.EDGES else 0
    if kind.layout is Layout.EDGES and not isinstance(edges, str):
        edges = checked_edges(f"{table.where}: {table.path}edges_per_rev", edges)
    scale = table.number("scale", (-1e12, 1e12), default=1.0)
    if scale == 0:
        raise InputError(f"{table.where}: {table.path}scale = 0 makes every value 0; 1 leaves them as they are")
    return {
        "columns": _columns(name, unit, table),
        "unit": unit,
        "factor": _factor(kind, conversion, table) * scale,
        "offset": conversion.offset,
        "edges_per_rev": 0 if isinstance(edges, str) else edges,
        "edges_per_rev_from": edges if isinstance(edges, str) else "",
    }


def _pulses(name: str, table: Part) -> dict[str, Any]:
    """A column of pulses, which becomes the encoder of its shaft."""
    why = f"does not go with kind {TACHOMETER!r}"
    _refuse(table, ("sensitivity", "columns", "scale"), why)
    _refuse(table, ("edges_per_rev",), f"{why}: pulses_per_rev?")
    unit = "in the column's unit"
    automatic = table.values.get("threshold") == "auto"
    per_rev = checked_edges(f"{table.where}: {table.path}pulses_per_rev", table.values.get("pulses_per_rev", 1))
    settings = PulseSettings(
        per_rev=per_rev,
        threshold=None if automatic else table.number_if_stated("threshold", (-1e9, 1e9), unit),
        hysteresis=table.number_if_stated("hysteresis", (0, 1e9), unit),
        falling=table.one_of("edge", FLANKS, FLANKS[0]) == "falling",
        missing_teeth=int(table.number("missing_teeth", (0, max(per_rev // 4, 0)), "teeth", default=0)),
    )
    columns = (str(table.values.get("column", name)),)
    return {"columns": columns, "unit": PULSES, "edges_per_rev": per_rev, "pulses": settings}


def _refuse(table: Part, names: tuple[str, ...], why: str) -> None:
    for name in names:
        if name in table.values:
            raise table.fault(name, why)


def _factor(kind: ChannelKind, conversion: Conversion, table: Part) -> float:
    """What the values of the column are multiplied by; of volts, one over the sensitivity that the mapping gives."""
    if conversion.per_volt:
        key = f"{table.where}: {table.path}sensitivity"
        return 1 / number_of(key, _volts_per_unit(kind, table), (1e-9, 1e9), f"V per {kind.unit}", "mV?")
    if "sensitivity" in table.values:
        raise table.fault("sensitivity", f"goes with unit 'V' only, not {table.values['unit']!r}")
    return conversion.factor


def _volts_per_unit(kind: ChannelKind, table: Part) -> Any:
    """A sensitivity as on a certificate, such as `100 mV/g`, in V per the contract's unit; others as they are."""
    stated = table.values.get("sensitivity")
    if not isinstance(stated, str):
        return stated
    found = SENSITIVITY.match(stated)
    unit = UNITS.get(found["per"].strip("() ").lower()) if found else None
    if not found or unit is None or unit[0] != kind.segment:
        own = " or ".join(f"'100 mV/{u}'" for u in kind.import_units if u.lower() in UNITS)
        raise table.fault("sensitivity", f"must be a number of V per {kind.unit}, or a text such as {own}")
    volts = float(found["number"].replace(",", ".")) * VOLT[found["volt"]]
    return volts / (unit[2] * kind.import_units[unit[1]].factor)


def _columns(name: str, unit: str, table: Part) -> tuple[str, ...]:
    """The columns of a channel: one, or the two levels of a quadrature encoder."""
    columns = table.values.get("columns")
    if unit != QUADRATURE:
        _refuse(table, ("columns",), f"goes with unit {QUADRATURE!r} only, not {unit!r}; column?")
        return (str(table.values.get("column", name)),)
    if "column" in table.values or not isinstance(columns, list) or not all(isinstance(c, str) for c in columns):
        raise table.fault("columns", "must name the two levels, a and b, of a quadrature encoder")
    if len(columns) != 2 or columns[0] == columns[1]:
        raise table.fault("columns", "must name two columns, the levels a and b")
    return tuple(columns)


def checked_edges(key: str, value: Any) -> int:
    """A number of edges a turn; InputError where it cannot be."""
    number = number_of(key, value, EDGES, "edges")
    if number != int(number):
        raise InputError(f"{key} = {number:g} must be a whole number of edges a turn")
    return int(number)


def unwrapped(values: np.ndarray, per_turn: int = 0) -> np.ndarray:
    """The values of a counter without its passing from the largest number to 0, or back; others as they are.

    per_turn  counts a turn, of a counter that begins anew with each; 0 where they are not known
    """
    steps = np.diff(values)
    largest = np.abs(steps).max(initial=0.0)
    size = next((s for s in (float(per_turn), *ROLL_OVER) if values.max() < s and s / 2 < largest), None)
    if size is None or values.min() < 0:
        return values
    steps -= size * np.rint(steps / size)
    return np.concatenate(([values[0]], values[0] + np.cumsum(steps)))
