"""One channel of a mapping file, checked: which column becomes which channel, in which unit.

A channel is a table of `[channels]`, in one of three forms; the last two allow a torque meter and an encoder on
one shaft:

    [channels.ch14]             # an accelerometer, or with `kind` another channel of this name
    [channels."torque/pinion"]  # kind and name
    [channels.encoder.pinion]   # likewise
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from service.errors import InputError
from service.files.documents import check_keys, given, number_of
from service.files.units import UNITS
from service.stream.channels import CHANNEL_KINDS, SHAFTS, ChannelKind, Conversion, Layout
from service.stream.wire.topics import NAME
from twin.features.pulses import PulseSettings

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
KEYS: dict[str, tuple[str, ...]] = {
    "channels.": (
        "kind", "column", "unit", "sensitivity", "scale", "edges_per_rev", "first_edge_index", "note", "columns",
        "pulses_per_rev", "threshold", "hysteresis", "edge", "missing_teeth",
    ),
}  # fmt: skip
OF_PULSES = ("pulses_per_rev", "threshold", "hysteresis", "edge", "missing_teeth")


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelMapping:
    """One column, or the two of a quadrature encoder, and what it becomes."""

    kind: str  # a key of CHANNEL_KINDS
    name: str  # sensor, shaft or place
    key: str  # of its table in the mapping file, for messages
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


def mapped_channels(where: str, tables: dict[str, Any]) -> tuple[ChannelMapping, ...]:
    """The channels of the table `[channels]`; InputError with the key that is wrong."""
    channels: list[ChannelMapping] = []
    for key, kind, name, table in _tables(where, tables):
        channel = _channel(where, key, kind, name, table)
        twin = next((c for c in channels if c.label == channel.label), None)
        if twin is not None:
            raise InputError(f"{where}: {key} and {twin.key} are both {channel.label}; a channel has one column")
        channels.append(channel)
    return tuple(channels)


def _tables(where: str, tables: dict[str, Any]) -> Iterator[tuple[str, str, str, dict[str, Any]]]:
    """Key, kind (empty where only the table says it), name and table of every channel."""
    for name, table in tables.items():
        key = f"channels.{name}"
        if not isinstance(table, dict):
            raise InputError(f"{where}: {key} = {table!r} must be a table")
        kind, slash, rest = name.partition("/")
        if slash and kind in KINDS:
            yield key, kind, rest, table
        elif name in KINDS and table and all(isinstance(t, dict) for t in table.values()):
            for inner, own in table.items():
                yield f"{key}.{inner}", name, inner, own
        else:
            yield key, "", name, table


def _channel(where: str, key: str, prefix: str, name: str, table: dict[str, Any]) -> ChannelMapping:
    check_keys(where, KEYS, "channels.", table, key + ".")
    segment = table.get("kind", prefix or "accel")
    if not isinstance(segment, str) or segment not in KINDS:
        raise InputError(f"{where}: {key}.kind = {segment!r} must be one of {', '.join(KINDS)}")
    if prefix and segment != prefix:
        raise InputError(f"{where}: {key}.kind = {segment!r} contradicts the name of its table")
    if segment == TACHOMETER:
        return _tachometer(where, key, name, table)
    kind = _kind_of(where, key, name, segment)
    unit = table.get("unit")
    if not isinstance(unit, str) or unit not in kind.import_units:
        hint = f"; for pulses of a voltage: kind = {TACHOMETER!r}" if kind.layout is Layout.EDGES else ""
        raise InputError(f"{where}: {key}.unit = {given(unit)} must be one of {', '.join(kind.import_units)}{hint}")
    _refuse(where, key, table, OF_PULSES, f"goes with kind {TACHOMETER!r} only")
    conversion = kind.import_units[unit]
    edges, edges_from = 0, ""
    first: int | None = None
    if kind.layout is Layout.EDGES:
        stated = table.get("edges_per_rev")
        if isinstance(stated, str):
            edges_from = stated
        else:
            edges = checked_edges(where, f"{key}.edges_per_rev", stated)
        first = _first_edge_index(where, key, table)
    factor = _factor(where, key, kind, conversion, table) * _scale(where, key, table)
    return ChannelMapping(
        kind=kind.segment,
        name=name,
        key=key,
        columns=_columns(where, key, name, unit, table),
        unit=unit,
        factor=factor,
        offset=conversion.offset,
        edges_per_rev=edges,
        edges_per_rev_from=edges_from,
        first_edge_index=first,
        note=str(table.get("note", "")),
    )


def _tachometer(where: str, key: str, name: str, table: dict[str, Any]) -> ChannelMapping:
    """A column of pulses, which becomes the encoder of its shaft."""
    _kind_of(where, key, name, "encoder")
    why = f"does not go with kind {TACHOMETER!r}"
    _refuse(where, key, table, ("sensitivity", "columns", "scale"), why)
    _refuse(where, key, table, ("edges_per_rev",), f"{why}: pulses_per_rev?")
    threshold, hysteresis = table.get("threshold"), table.get("hysteresis")
    if threshold is not None and threshold != "auto":
        threshold = number_of(where, f"{key}.threshold", threshold, (-1e9, 1e9), "in the column's unit")
    if hysteresis is not None:
        hysteresis = number_of(where, f"{key}.hysteresis", hysteresis, (0, 1e9), "in the column's unit")
    edge = table.get("edge", FLANKS[0])
    if edge not in FLANKS:
        raise InputError(f"{where}: {key}.edge = {edge!r} must be {' or '.join(FLANKS)}")
    per_rev = checked_edges(where, f"{key}.pulses_per_rev", table.get("pulses_per_rev", 1))
    missing = number_of(
        where, f"{key}.missing_teeth", table.get("missing_teeth", 0), (0, max(per_rev // 4, 0)), "teeth"
    )
    settings = PulseSettings(
        per_rev=per_rev,
        threshold=None if threshold == "auto" else threshold,
        hysteresis=hysteresis,
        falling=edge == "falling",
        missing_teeth=int(missing),
    )
    return ChannelMapping(
        kind="encoder",
        name=name,
        key=key,
        columns=(str(table.get("column", name)),),
        unit=PULSES,
        edges_per_rev=per_rev,
        first_edge_index=_first_edge_index(where, key, table),
        pulses=settings,
        note=str(table.get("note", "")),
    )


def _refuse(where: str, key: str, table: dict[str, Any], names: tuple[str, ...], why: str) -> None:
    for name in names:
        if name in table:
            raise InputError(f"{where}: {key}.{name} = {table[name]!r} {why}")


def _kind_of(where: str, key: str, name: str, segment: str) -> ChannelKind:
    """The kind of a channel, which must allow its name."""
    kind = CHANNEL_KINDS[segment]
    if not NAME.fullmatch(name):
        raise InputError(f"{where}: {key}: a {kind.named_by}'s name must be 1 to 64 letters, digits, '_', '-' or '.'")
    if kind.names and name not in kind.names:
        raise InputError(
            f"{where}: {key}: a channel of kind {segment} must be named {' or '.join(kind.names)}, such as "
            f"[channels.{segment}.{SHAFTS[0]}]"
        )
    return kind


def _first_edge_index(where: str, key: str, table: dict[str, Any]) -> int | None:
    index = table.get("first_edge_index")
    return None if index is None else int(number_of(where, f"{key}.first_edge_index", index, (0, 2**53), ""))


def _scale(where: str, key: str, table: dict[str, Any]) -> float:
    """What the file's values are multiplied by to be in the unit: gain, full scale, or −1 for the other polarity."""
    scale = number_of(where, f"{key}.scale", table.get("scale", 1.0), (-1e12, 1e12), "")
    if scale == 0:
        raise InputError(f"{where}: {key}.scale = 0 makes every value 0; 1 leaves them as they are")
    return scale


def _factor(where: str, key: str, kind: ChannelKind, conversion: Conversion, table: dict[str, Any]) -> float:
    """What the values of the column are multiplied by; of volts, one over the sensitivity that the mapping gives."""
    sensitivity = table.get("sensitivity")
    if conversion.per_volt:
        sensitivity = _volts_per_unit(where, key, kind, sensitivity)
        return 1 / number_of(where, f"{key}.sensitivity", sensitivity, (1e-9, 1e9), f"V per {kind.unit}", "mV?")
    if sensitivity is not None:
        raise InputError(
            f"{where}: {key}.sensitivity = {sensitivity!r} goes with unit 'V' only, not {table.get('unit')!r}"
        )
    return conversion.factor


def _volts_per_unit(where: str, key: str, kind: ChannelKind, stated: Any) -> Any:
    """A sensitivity as on a certificate, such as `100 mV/g`, in V per the contract's unit; others as they are."""
    if not isinstance(stated, str):
        return stated
    found = SENSITIVITY.match(stated)
    unit = UNITS.get(found["per"].strip("() ").lower()) if found else None
    if not found or unit is None or unit[0] != kind.segment:
        own = " or ".join(f"'100 mV/{u}'" for u in kind.import_units if u.lower() in UNITS)
        raise InputError(
            f"{where}: {key}.sensitivity = {stated!r} must be a number of V per {kind.unit}, or a text such as {own}"
        )
    volts = float(found["number"].replace(",", ".")) * VOLT[found["volt"]]
    return volts / (unit[2] * kind.import_units[unit[1]].factor)


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
