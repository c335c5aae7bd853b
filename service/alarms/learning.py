"""Learned limits of one rule at one place: values are gathered by operating condition, then the limits hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from service.alarms.memory import KeyMemory, LearnedPoint
from service.alarms.readings import Reading
from twin.learned_limits import DEFAULT, LearnedLimits, Limits, OperatingPoint, learned

MOST_POINTS = 24  # operating conditions that are learned for one quantity; a window under a further one is not judged


def limits_at(own: KeyMemory, reading: Reading, windows: int, *, learn: bool) -> Limits | None:
    """The limits under the reading's operating condition; None while they are learned, which this reading adds to.

    windows  how many values limits are learned from
    learn    whether the value is taken as healthy
    """
    assert reading.value is not None
    point = reading.point or OperatingPoint(speed=None, torque=None)
    known = next((p for p in own.learned if _point(p).matches(point)), None)
    if known is not None and len(known.values) >= windows:
        return learned(known.values[:windows], _with(windows))
    if not learn or not reading.value > 0:
        return None
    if known is None:
        if len(own.learned) >= MOST_POINTS:
            return None
        known = LearnedPoint(speed=point.speed, torque=point.torque)
        own.learned.append(known)
    known.values.append(reading.value)
    return None


def progress(own: KeyMemory, windows: int) -> list[dict[str, Any]]:
    """How far the learning has come under each operating condition, for people."""
    return [_said(point, windows) for point in own.learned]


def _said(point: LearnedPoint, windows: int) -> dict[str, Any]:
    at: Mapping[str, Any] = {"speed_hz": point.speed, "torque_nm": point.torque}
    count = min(len(point.values), windows)
    limits = learned(point.values[:windows], _with(windows)) if count >= windows else None
    if limits is None:
        return {**at, "windows": count, "text": f"learning: {count} of {windows} windows"}
    return {
        **at,
        "windows": count,
        "median": limits.median,
        "watch": limits.watch,
        "alarm": limits.alarm,
        "text": f"learned from {count} windows; at most {DEFAULT.watch_rate:.1g} of healthy windows lie beyond the "
        f"watch limit, {DEFAULT.alarm_rate:.1g} beyond the alarm limit",
    }


def _point(point: LearnedPoint) -> OperatingPoint:
    return OperatingPoint(speed=point.speed, torque=point.torque)


def _with(windows: int) -> LearnedLimits:
    return replace(DEFAULT, windows=windows)
