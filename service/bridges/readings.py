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


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable of every asset."""

    kind: Kind
    of: str  # where the result has its value; empty: it is made of several
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
FIGURES = ("window", "wear", "life")  # parts of the result whose values have the time and the quality of the window
STATED = "depth_limit_um"  # the one among them that the rig file states
LEVELS = ", ".join(f"{n} {level}" for n, level in enumerate(SEVERITY))
VARIABLES = {
    "level": Variable("text", "level", "status of the machine"),
    "severity": Variable("count", "", f"the status as a number: {LEVELS}"),
    "reasons": Variable("lines", "reasons", "why, most important first"),
    "action": Variable("text", "action", "what to do"),
    "data": Variable("text", "data", "quality of the data"),
    "data_reason": Variable("text", "data_reason", "why the data have this quality"),
    "depth_um": Variable("number", "wear.depth_um.median", "largest wear depth, median", "4H", end=STATED),
    "depth_p05_um": Variable("number", "wear.depth_um.p05", "its 5 % bound", "4H", end=STATED),
    "depth_p95_um": Variable("number", "wear.depth_um.p95", "its 95 % bound", "4H", end=STATED),
    "depth_limit_um": Variable("number", "wear.limit_um", "wear depth at the end of life", "4H"),
    "depth_note": Variable("lines", "", "why the depth is not available, or not established"),
    "life_hours": Variable("number", "life.hours.median", "remaining life, median", "HUR"),
    "life_p05_hours": Variable("number", "life.hours.p05", "its 5 % bound", "HUR"),
    "life_p95_hours": Variable("number", "life.hours.p95", "its 95 % bound", "HUR"),
    "life_revolutions": Variable(
        "number", "life.revolutions.median", "remaining life in turns of the pinion, median", "M44"
    ),
    "life_note": Variable("lines", "", "why the life is not available, or not established"),
    "revolutions": Variable("number", "window.revolutions", "of the pinion since new", "M44"),
    "speed_hz": Variable("number", "window.speed_hz", "pinion speed", "HTZ"),
    "torque_nm": Variable("number", "window.torque_nm", "input torque", "NU"),
    "rms_measured_m_s2": Variable("number", "window.rms_measured_m_s2", "vibration level, measured", "MSK"),
    "rms_predicted_m_s2": Variable("number", "window.rms_predicted_m_s2", "vibration level, by the twin", "MSK"),
    "window": Variable("count", "window.index", "index of the newest measurement window"),
    "window_start": Variable("text", "window.start_time", "its start"),
    "alarms_active": Variable("count", "alarms.active", "open alarms that are active"),
    "alarms_unacknowledged": Variable("count", "alarms.unacknowledged", "open alarms that nobody has acknowledged"),
    "alarms": Variable("lines", "", "open alarms, most urgent first"),
    "retired": Variable("yes", "retired", "whether the asset is out of use"),
}


def readings_of(result: Mapping[str, Any], alarms: Sequence[Mapping[str, Any]], now: datetime) -> dict[str, Reading]:
    """All variables of an asset, from its result in short (`service.contract.plant`) and its open alarms."""
    at = _time((result["window"] or {}).get("start_time"), now)
    made = {
        "severity": SEVERITY.index(result["level"]),
        "depth_note": _note(result["wear"]),
        "life_note": _note(result["life"]),
        "alarms": [f"{alarm['level']}: {alarm['reason']}" for alarm in alarms],
    }
    readings = {}
    for name, variable in VARIABLES.items():
        value = made[name] if name in made else _found(result, variable.of)
        part = variable.of.partition(".")[0]
        if part in FIGURES and name != STATED:
            preliminary = bool((result[part] or {}).get("preliminary"))
            readings[name] = Reading(value=value, quality=_quality(value, result, preliminary), time=at)
        else:
            readings[name] = Reading(value=value, quality="none" if value is None else "good", time=now)
    return readings


def _found(result: Mapping[str, Any], path: str) -> Any:
    """What the result has at a path; None where a part of it is not there."""
    found: Any = result
    for key in path.split("."):
        found = (found or {}).get(key)
    return found


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
