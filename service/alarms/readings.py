"""What the rules look at: the findings of the status, and the numbers of a window's record."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from service.alarms.quantities import JUDGED
from service.contract.finding import SEVERITY, sentence
from service.contract.overview import is_available
from twin.learned_limits import OperatingPoint

UNUSABLE = ("degraded", "refused")
BY_STATUS = frozenset(JUDGED) - {"data"}
OF_GEARS = ("fm0", "fm4", "na4", "energy_ratio", "sideband_level_factor")
OF_SENSORS = ("rms", "kurtosis", "crest_factor")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One quantity at one place: a number to be compared with limits, or a level that a criterion gave."""

    quantity: str
    place: str = ""
    value: float | None = None  # in the quantity's unit
    level: str | None = None  # of SEVERITY, where a criterion gave it
    reason: str = ""
    action: str = ""
    preliminary: bool = False  # at most watch, unless
    supported: bool = False  # by earlier windows, in which the figure was established
    point: OperatingPoint | None = None  # of the window


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """All that one window, or one look at the clock, says."""

    readings: tuple[Reading, ...]
    judged: frozenset[str]  # quantities of which a criterion that gives no reading is normal
    depth_known: bool = False


def of_window(record: Mapping[str, Any], report: Mapping[str, Any] | None, data: Mapping[str, Any]) -> Readings:
    """The readings of one committed window.

    report  the twin's newest answer; data  the section `data` as it is shown
    """
    found = list(_of_data(data))
    judged = {"data"}
    known = is_available((report or {}).get("wear"))
    if record.get("quality") == "refused":
        return Readings(readings=tuple(found), judged=frozenset(judged), depth_known=known)
    if report is not None:
        said = of_report(report)
        found += said.readings
        judged |= said.judged
    found += _of_record(record)
    return Readings(readings=tuple(found), judged=frozenset(judged), depth_known=known)


def of_report(report: Mapping[str, Any]) -> Readings:
    """The readings of a report alone, as after a decision on an effect."""
    status = report.get("status")
    found = (*(_of_status(status) if status else ()), *_of_figures(report))
    judged = BY_STATUS if status else frozenset()
    return Readings(readings=found, judged=judged, depth_known=is_available(report.get("wear")))


def of_data(data: Mapping[str, Any]) -> Readings:
    """The readings of the data quality alone, when no window comes."""
    return Readings(readings=tuple(_of_data(data)), judged=frozenset({"data"}))


def _of_data(data: Mapping[str, Any]) -> Iterator[Reading]:
    if data["level"] in ("degraded", "stale"):
        yield Reading(
            quantity="data",
            level="watch",
            reason=sentence(f"The data are {data['level']}: {data['reason']}"),
            action="Check the acquisition, the sensors and the connection.",
        )


def _of_status(status: Mapping[str, Any]) -> Iterator[Reading]:
    for finding in status.get("findings") or ():
        quantity, _, place = finding["subject"].partition("/")
        if SEVERITY.index(finding["level"]) >= SEVERITY.index("watch"):
            yield Reading(
                quantity=quantity, place=place, level=finding["level"], reason=finding["reason"],
                action=finding["action"],
            )  # fmt: skip
    if SEVERITY.index(status["level"]) >= SEVERITY.index("watch"):
        said = (status.get("reasons") or [f"The status is {status['level']}."])[0]
        yield Reading(quantity="status", level=status["level"], reason=said, action=status.get("action", ""))


def _of_figures(report: Mapping[str, Any]) -> Iterator[Reading]:
    """Depth and life as numbers, for rules with limits of their own."""
    wear, rul = report.get("wear") or {}, report.get("rul") or {}
    for quantity, part, band in (
        ("depth", wear, (wear.get("max_depth_um") or {}).get("combined")),
        ("life", rul, rul.get("hours")),
    ):
        if is_available(part) and isinstance(band, Mapping) and band.get("median") is not None:
            preliminary = part.get("preliminary") or {}
            yield Reading(
                quantity=quantity, value=band["median"], preliminary=bool(preliminary),
                supported=bool(preliminary.get("established_before")),
            )  # fmt: skip


def _of_record(record: Mapping[str, Any]) -> Iterator[Reading]:
    point = OperatingPoint(speed=record.get("speed_hz"), torque=record.get("torque_nm"))
    for sensor, own in (record.get("indicators") or {}).items():
        for name in OF_SENSORS:
            if own.get(name) is not None:
                yield Reading(quantity=name, place=sensor, value=own[name], point=point)
        for gear, values in (own.get("gears") or {}).items():
            for name in OF_GEARS:
                if values.get(name) is not None:
                    yield Reading(quantity=name, place=f"{sensor}/{gear}", value=values[name], point=point)
    for place, slow in (record.get("temperatures") or {}).items():
        if slow.get("value") is not None and slow.get("values"):
            yield Reading(quantity="temperature", place=place, value=slow["value"], point=point)


def usable(record: Mapping[str, Any]) -> bool:
    """Whether limits may be learned from a window."""
    return record.get("quality") not in UNUSABLE
