"""Condition indicators of the latest window that has any, as a compact table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from service.cli.show import number

SENSOR = (("RMS m/s²", "rms"), ("kurtosis", "kurtosis"), ("crest", "crest_factor"))
GEAR = (
    ("turns", "turns"), ("FM0", "fm0"), ("FM4", "fm4"), ("NA4", "na4"), ("M6A", "m6a"), ("M8A", "m8a"),
    ("energy ratio", "energy_ratio"), ("sideband level", "sideband_level_factor"),
)  # fmt: skip


def indicator_lines(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """One line for each gear and accelerometer; none where no window has indicators."""
    record = next((r for r in reversed(records) if r.get("indicators")), None)
    if record is None:
        return []
    raw = [name for name, sensor in record["indicators"].items() if sensor.get("unit")]
    heads = ["sensor", *(title for title, _ in SENSOR), "gear", *(title for title, _ in GEAR)]
    rows = [heads]
    for name, sensor in record["indicators"].items():
        own = [name, *(number(sensor.get(key), 3) for _, key in SENSOR)]
        gears = sensor.get("gears") or {"–": {}}
        rows += [[*own, gear, *(number(found.get(key), 3) for _, key in GEAR)] for gear, found in gears.items()]
    widths = [max(len(row[i]) for row in rows) for i in range(len(heads))]
    table = ["  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in rows]
    if raw:  # a level without a unit is none in m/s²
        table[0] = table[0].replace("RMS m/s²", "RMS".rjust(len("RMS m/s²")))
        table.append(f"The unit of {', '.join(raw)} is not known: RMS of raw values.")
    doubt = next((f" ({s['doubt']})" for s in record["indicators"].values() if s.get("doubt")), "")
    return [f"Condition indicators, window {record['index']}{doubt}", *table]
