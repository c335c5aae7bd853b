"""Condition indicators and operating figures of every window, as curves over the history.

They are read from the windows' records, which are kept of every window; raw signals are not needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from service.results.store import StoredWindow

OWN = (
    ("rms_measured", "Vibration level, measured", "m/s²"),
    ("rms_predicted", "Vibration level, predicted", "m/s²"),
    ("error_percent", "Error of the predicted level", "%"),
    ("wear_depth_um", "Wear depth", "µm"),
    ("speed_hz", "Pinion speed", "Hz"),
    ("torque_nm", "Torque at the pinion", "N·m"),
)
SENSOR = (("rms", "RMS", "m/s²"), ("kurtosis", "kurtosis", ""), ("crest_factor", "crest factor", ""))
GEAR = (
    ("fm0", "FM0"), ("fm4", "FM4"), ("na4", "NA4"), ("m6a", "M6A"), ("m8a", "M8A"),
    ("energy_ratio", "energy ratio"), ("sideband_level_factor", "sideband level factor"),
)  # fmt: skip


@dataclass(slots=True, kw_only=True)
class Trend:
    """One quantity over the windows."""

    name: str
    label: str
    unit: str
    group: str  # level, operation, a sensor's or a gear's indicators, …
    values: list[float | None] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trends:
    """All quantities of an asset's windows that have any value."""

    index: tuple[int, ...]
    start_time: tuple[str, ...]
    revolutions: tuple[float | None, ...]
    quality: tuple[str, ...]
    quantities: tuple[Trend, ...]


def trends_of(windows: Sequence[StoredWindow]) -> Trends:
    """The quantities of windows, oldest first."""
    found: dict[str, Trend] = {}
    for row, window in enumerate(windows):
        for name, label, unit, group, value in _quantities(window.record):
            if value is None:
                continue
            trend = found.setdefault(name, Trend(name=name, label=label, unit=unit, group=group))
            trend.values += [None] * (row - len(trend.values)) + [value]
    for trend in found.values():
        trend.values += [None] * (len(windows) - len(trend.values))
    records = [w.record for w in windows]
    order = {group: i for i, group in enumerate(("level", "operation", "mesh bands", "temperature"))}
    return Trends(
        index=tuple(r["index"] for r in records),
        start_time=tuple(r.get("start_time") or "" for r in records),
        revolutions=tuple(r.get("revolutions") for r in records),
        quality=tuple(r.get("quality") or "good" for r in records),
        quantities=tuple(sorted(found.values(), key=lambda t: order.get(t.group, len(order)))),
    )


Quantity = tuple[str, str, str, str, float | None]  # name, label, unit, group, value


def _quantities(record: Mapping[str, Any]) -> Iterator[Quantity]:
    for key, label, unit in OWN:
        yield key, label, unit, "operation" if key in ("speed_hz", "torque_nm") else "level", record.get(key)
    for k, value in enumerate(record.get("mesh_bands") or (), 1):
        yield f"mesh_band_{k}", f"Mesh harmonic {k} with sidebands, RMS", "m/s²", "mesh bands", value
    for place, slow in (record.get("temperatures") or {}).items():
        yield f"temperature/{place}", f"Temperature, {place}", slow["unit"], "temperature", slow["value"]
    for sensor, own in (record.get("indicators") or {}).items():
        for key, label, unit in SENSOR:
            shown = "" if own.get("unit") else unit  # of raw values, whose unit is not known
            yield f"{sensor}/{key}", f"{sensor}: {label}", shown, f"accel/{sensor}", own.get(key)
        for gear, indicators in (own.get("gears") or {}).items():
            for key, label in GEAR:
                group = f"accel/{sensor}, {gear}"
                yield f"{sensor}/{gear}/{key}", f"{sensor}, {gear}: {label}", "", group, indicators.get(key)
