"""The mapping file of `gear-twin import`: which column is which channel, in which unit, on which gears.

    schema = "gear-import/1"
    asset = "my-gearbox"
    description = "…"
    started = 2020-10-28T00:00:00Z         # left out where not known, or where the data file states it
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

    [channels.encoder.pinion]              # or [channels."encoder/pinion"]; [channels.torque.pinion] may be there, too
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

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from service.errors import InputError
from service.files.documents import check_asset, check_keys, check_schema, given, load_document, number_of, table_of
from service.files.gear_age import age_of
from service.files.import_channel import KEYS, ChannelMapping, mapped_channels
from service.files.readers import TextForm, format_of
from service.files.rig import checked_rig, load_mapping

SCHEMA = "gear-import/1"
RATES = (1.0, 1e7)  # [Hz]
TEXT_FILES = (".csv", ".tsv", ".txt", ".gz", ".dat", ".asc")
_KEYS: dict[str, tuple[str, ...]] = KEYS | {
    "": ("schema", "asset", "description", "started", "notes", "age", "file", "channels", "rig"),
    "file.": ("path", "sample_rate_hz", "time_column", "delimiter", "decimal", "header_row"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportMapping:
    """A whole mapping file, checked."""

    where: str  # the mapping file's name, for messages
    asset: str
    description: str
    started: datetime | None
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
    where = str(path)
    check_schema(where, data, SCHEMA)
    check_keys(where, _KEYS, "", data)
    asset = check_asset(where, data)
    file = table_of(where, data, "file")
    check_keys(where, _KEYS, "file.", file)
    named = file.get("path", "" if source else None)
    if not isinstance(named, str):
        raise InputError(f"{where}: file.path = {given(named)} must name a data file, or --source must")
    channels = table_of(where, data, "channels")
    if not channels:
        raise InputError(f"{where}: channels must name at least one column")
    rig = _rig_of(where, data, path)
    rig.setdefault("schema", "gear-rig/1")
    rig.setdefault("name", asset)
    checked_rig(rig, f"{where}: rig")
    mapped = mapped_channels(where, channels)
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
        path=path.parent / named,
        sample_rate=_rate(where, file),
        time_column=_time_column(where, file),
        text=_text_form(where, file),
        channels=mapped,
        rig=rig,
        age=_age(where, data, rig),
    )


def _age(where: str, data: dict[str, Any], rig: dict[str, Any]) -> str | float | None:
    """The gears' age when the file begins; a rig file of its own speaks of the machine's counter, not of this file."""
    if "age" in data:
        return age_of(f"{where}: age", data["age"], rig.get("operating", {}).get("pinion_speed_hz"))
    return None if isinstance(data.get("rig"), str) else rig.get("gears", {}).get("age")


def _rig_of(where: str, data: dict[str, Any], path: Path) -> dict[str, Any]:
    """The rig file of a mapping: its table, or the file that it names."""
    named = data.get("rig")
    if isinstance(named, str):
        return load_mapping(path.parent / named)
    return dict(table_of(where, data, "rig"))


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


def _rate(where: str, file: dict[str, Any]) -> float | None:
    rate = file.get("sample_rate_hz")
    return None if rate is None else number_of(where, "file.sample_rate_hz", rate, RATES, "Hz", "kHz?")


def _time_column(where: str, file: dict[str, Any]) -> str | None:
    name = file.get("time_column")
    if name is not None and not isinstance(name, str):
        raise InputError(f'{where}: file.time_column = {name!r} must name a column, or be "" where there is none')
    return name


def _text_form(where: str, file: dict[str, Any]) -> TextForm:
    """The layout of a text file, as far as the mapping gives it."""
    for key, most in (("delimiter", 1), ("decimal", 1)):
        text = file.get(key)
        if text is not None and (not isinstance(text, str) or len(text) != most):
            raise InputError(f"{where}: file.{key} = {text!r} must be one character")
    if file.get("decimal") not in (None, ".", ","):
        raise InputError(f"{where}: file.decimal = {file['decimal']!r} must be '.' or ','")
    row = file.get("header_row")
    if row is not None:
        row = int(number_of(where, "file.header_row", row, (0, 1e6), ""))
    return TextForm(separator=file.get("delimiter"), decimal=file.get("decimal"), header_row=row)


def _started(where: str, value: Any) -> datetime | None:
    if value is None:
        return None
    if not isinstance(value, datetime):
        raise InputError(f"{where}: started = {given(value)} must be a date with time, such as 2020-10-28T00:00:00Z")
    moment = value if value.tzinfo else value.replace(tzinfo=UTC)
    if moment.timestamp() <= 0:
        raise InputError(f"{where}: started = {value.isoformat()} must lie after 1970-01-01")
    return moment
