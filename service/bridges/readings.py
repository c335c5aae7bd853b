"""An asset's result as single variables, each with a quality: what a control system reads.

The quality is part of the figure: a depth that is not established is uncertain, one that cannot be computed is no
number, and figures of a machine that sends nothing any more are its last usable ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

from service.contract.finding import SEVERITY

Kind = Literal["number", "count", "yes", "text", "lines"]
Quality = Literal["good", "preliminary", "degraded", "last", "none", "waiting"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """One variable of every asset."""

    kind: Kind
    meaning: str
    unit: str = ""  # by UNECE Recommendation 20, a key of UNITS
    end: str = ""  # variable whose value ends the range; the range begins at 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """A variable's value: None where there is none."""

    value: Any
    quality: Quality
    time: datetime  # of the value, UTC


UNITS = {
    "4H": ("µm", "micrometre"),
    "HUR": ("h", "hour"),
    "HTZ": ("Hz", "hertz"),
    "NU": ("N·m", "newton metre"),
    "MSK": ("m/s²", "metre per second squared"),
    "M44": ("rev", "revolution"),
}
VARIABLES = {
    "level": Variable(kind="text", meaning="status of the machine"),
    "severity": Variable(
        kind="count", meaning="the status as a number: " + ", ".join(f"{n} {level}" for n, level in enumerate(SEVERITY))
    ),
    "reasons": Variable(kind="lines", meaning="why, most important first"),
    "action": Variable(kind="text", meaning="what to do"),
    "data": Variable(kind="text", meaning="quality of the data"),
    "data_reason": Variable(kind="text", meaning="why the data have this quality"),
    "depth_um": Variable(kind="number", unit="4H", end="depth_limit_um", meaning="largest wear depth, median"),
    "depth_p05_um": Variable(kind="number", unit="4H", end="depth_limit_um", meaning="its 5 % bound"),
    "depth_p95_um": Variable(kind="number", unit="4H", end="depth_limit_um", meaning="its 95 % bound"),
    "depth_limit_um": Variable(kind="number", unit="4H", meaning="wear depth at the end of life"),
    "depth_note": Variable(kind="lines", meaning="why the depth is not available, or not established"),
    "life_hours": Variable(kind="number", unit="HUR", meaning="remaining life, median"),
    "life_p05_hours": Variable(kind="number", unit="HUR", meaning="its 5 % bound"),
    "life_p95_hours": Variable(kind="number", unit="HUR", meaning="its 95 % bound"),
    "life_revolutions": Variable(kind="number", unit="M44", meaning="remaining life in turns of the pinion, median"),
    "life_note": Variable(kind="lines", meaning="why the life is not available, or not established"),
    "revolutions": Variable(kind="number", unit="M44", meaning="of the pinion since new"),
    "speed_hz": Variable(kind="number", unit="HTZ", meaning="pinion speed"),
    "torque_nm": Variable(kind="number", unit="NU", meaning="input torque"),
    "rms_measured_m_s2": Variable(kind="number", unit="MSK", meaning="vibration level, measured"),
    "rms_predicted_m_s2": Variable(kind="number", unit="MSK", meaning="vibration level, by the twin"),
    "window": Variable(kind="count", meaning="index of the newest measurement window"),
    "window_start": Variable(kind="text", meaning="its start"),
    "alarms_active": Variable(kind="count", meaning="open alarms that are active"),
    "alarms_unacknowledged": Variable(kind="count", meaning="open alarms that nobody has acknowledged"),
    "alarms": Variable(kind="lines", meaning="open alarms, most urgent first"),
    "retired": Variable(kind="yes", meaning="whether the asset is out of use"),
}  # fmt: skip


def readings_of(result: Mapping[str, Any], alarms: Sequence[Mapping[str, Any]], now: datetime) -> dict[str, Reading]:
    """All variables of an asset, from its result in short (`service.contract.plant`) and its open alarms."""
    window, wear, life = result["window"] or {}, result["wear"], result["life"]
    at = _time(window.get("start_time"), now)
    depth, hours, revolutions = wear.get("depth_um") or {}, life.get("hours") or {}, life.get("revolutions") or {}
    of_window = {name: window.get(name) for name in ("revolutions", "speed_hz", "torque_nm")}
    of_window |= {name: window.get(name) for name in ("rms_measured_m_s2", "rms_predicted_m_s2")}
    of_window |= {"window": window.get("index"), "window_start": window.get("start_time")}
    of_wear = {"depth_um": depth.get("median"), "depth_p05_um": depth.get("p05"), "depth_p95_um": depth.get("p95")}
    of_life = {
        "life_hours": hours.get("median"),
        "life_p05_hours": hours.get("p05"),
        "life_p95_hours": hours.get("p95"),
    }
    of_life["life_revolutions"] = revolutions.get("median")
    figures: dict[str, Reading] = {}
    for group, preliminary in (
        (of_window, False),
        (of_wear, bool(wear.get("preliminary"))),
        (of_life, bool(life.get("preliminary"))),
    ):
        for name, value in group.items():
            figures[name] = Reading(value=value, quality=_quality(value, result, preliminary), time=at)
    limit = wear.get("limit_um")
    figures["depth_limit_um"] = Reading(value=limit, quality="none" if limit is None else "good", time=now)
    said = {
        "level": result["level"],
        "severity": SEVERITY.index(result["level"]),
        "reasons": list(result["reasons"]),
        "action": result["action"],
        "data": result["data"],
        "data_reason": result["data_reason"],
        "depth_note": _note(wear),
        "life_note": _note(life),
        "alarms_active": result["alarms"]["active"],
        "alarms_unacknowledged": result["alarms"]["unacknowledged"],
        "alarms": [f"{alarm['level']}: {alarm['reason']}" for alarm in alarms],
        "retired": result["retired"],
    }
    figures |= {name: Reading(value=value, quality="good", time=now) for name, value in said.items()}
    return {name: figures[name] for name in VARIABLES}


def _quality(value: Any, result: Mapping[str, Any], preliminary: bool) -> Quality:
    if value is None:
        return "waiting" if result["window"] is None else "none"
    if result["data"] == "stale" or result["retired"]:
        return "last"
    if preliminary:
        return "preliminary"
    return "degraded" if result["data"] == "degraded" else "good"


def _note(part: Mapping[str, Any]) -> list[str]:
    return [part["reason"]] if "reason" in part else list(part.get("preliminary") or ())


def _time(text: str | None, now: datetime) -> datetime:
    """A window's start, where a control system can show it: its clock may be any."""
    try:
        at = datetime.fromisoformat(text or "").astimezone(UTC)
    except (ValueError, OverflowError):
        return now
    return at if at.year >= 1970 else now
