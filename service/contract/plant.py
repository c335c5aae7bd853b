"""What bridges publish: a result of one line, open alarms, one change of an alarm, and whether the service runs.

Version 1. Keys may be added, and none is removed or changes its meaning within a version; units are in the names.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

from pydantic import Field

from service.contract.alarms import Alarm, AlarmCount, counted
from service.contract.base import ContractModel, not_available
from service.contract.finding import Level
from service.contract.overview import is_available, overview
from service.contract.parts import Band, NotAvailable
from service.contract.status import DataLevel
from service.contract.verdict import Verdict

VERSION = 1
NO_FIGURE = "this machine's answer has no such figure"


class PlantWindow(ContractModel):
    """The newest measurement window."""

    index: int
    start_time: str | None = Field(description="ISO 8601, by the recording's clock")
    quality: str | None = Field(description="`good`, `repaired`, `degraded` or `refused`")
    revolutions: float | None = Field(description="of the pinion since new")
    speed_hz: float | None = Field(description="pinion speed")
    torque_nm: float | None = Field(description="input torque")
    rms_measured_m_s2: float | None = Field(description="reference accelerometer, in the rig's band")
    rms_predicted_m_s2: float | None = Field(description="by the twin, before any update")


class PlantDepth(ContractModel):
    """Largest wear depth of both flanks together."""

    depth_um: Band
    limit_um: float | None = Field(description="depth at the end of life; null where none is stated")
    preliminary: list[str] = Field(description="why the depth is not established; empty where it is")


class PlantLife(ContractModel):
    """Remaining life at the present operating condition."""

    hours: Band
    revolutions: Band
    reached: bool = Field(description="whether the end of life has been reached")
    of_wear_alone: bool = Field(default=False, description="whether damage is found that the life does not count")
    preliminary: list[str] = Field(description="why the life is not established; empty where it is")


class PlantResult(ContractModel):
    """An asset's result in short."""

    type: Literal["result"]
    schema_version: Literal[1]
    asset: str
    time: str = Field(description="when it was published, by the service's clock, ISO 8601")
    level: Level = Field(description="status of the machine")
    summary: str = Field(default="", description="the state in at most 25 words")
    reasons: list[str] = Field(description="one sentence each, most important first")
    action: str = Field(description="what to do, in the imperative")
    since: str | None = Field(description="when the level was reached, ISO 8601")
    verdict: Verdict | None = Field(default=None, description="the window that the level rests on, and its age")
    last_seen: str | None = Field(default=None, description="when the newest frame or window came, ISO 8601")
    data: DataLevel = Field(description="quality of the data, apart from the machine's health")
    data_reason: str
    window: PlantWindow | None = Field(description="null before the first window")
    wear: PlantDepth | NotAvailable
    life: PlantLife | NotAvailable
    alarms: AlarmCount
    epoch: int = Field(description="number of the present gears")
    retired: bool


class PlantAlarms(ContractModel):
    """An asset's open alarms."""

    type: Literal["alarms"]
    schema_version: Literal[1]
    asset: str
    time: str
    alarms: list[Alarm] = Field(description="most urgent first, without their histories")


class PlantAlarmChange(ContractModel):
    """One change of an alarm."""

    type: Literal["alarm"]
    schema_version: Literal[1]
    asset: str
    event_id: int = Field(description="of the asset's event; a change that comes twice has the same")
    verb: str = Field(description="`raised`, `escalated`, `lowered`, `ended`, `acknowledged` or `cleared`")
    alarm: Alarm


class PlantService(ContractModel):
    """Whether the service runs; the broker publishes `offline` where it loses the service."""

    type: Literal["service"]
    schema_version: Literal[1]
    state: Literal["online", "offline"]


MODELS = (PlantResult, PlantAlarms, PlantAlarmChange, PlantService)


def plant_result(
    whole: Mapping[str, Any], rig: Mapping[str, Any] | None, alarms: Iterable[Mapping[str, Any]], time: str
) -> dict[str, Any]:
    """An asset's result in short, from its whole state, its rig and its open alarms."""
    status, data, records = whole["status"], whole["data"], whole["windows"]
    return {
        "type": "result",
        "schema_version": VERSION,
        "asset": whole["asset"],
        "time": time,
        "level": status["level"],
        "summary": status.get("summary") or "",
        "reasons": list(status["reasons"]),
        "action": status["action"],
        "since": (status.get("since") or {}).get("time"),
        "verdict": status.get("verdict"),
        "last_seen": whole.get("last_seen"),
        "data": data["level"],
        "data_reason": data["reason"],
        "window": _window(records[-1]) if records else None,
        "wear": _depth(whole, rig),
        "life": _life(whole["rul"]),
        "alarms": counted(alarms),
        "epoch": whole["epoch"],
        "retired": whole["retired"] is not None,
    }


def plant_alarms(asset: str, alarms: Iterable[Mapping[str, Any]], time: str) -> dict[str, Any]:
    """An asset's open alarms."""
    shown = [{key: value for key, value in alarm.items() if key != "history"} for alarm in alarms]
    return {"type": "alarms", "schema_version": VERSION, "asset": asset, "time": time, "alarms": shown}


def plant_alarm_change(asset: str, number: int, data: Mapping[str, Any]) -> dict[str, Any]:
    """One change of an alarm, from the data of the asset's event."""
    alarm = {key: value for key, value in data["alarm"].items() if key != "history"}
    named = {"type": "alarm", "schema_version": VERSION, "asset": asset, "event_id": number}
    return {**named, "verb": data["verb"], "alarm": alarm}


def plant_service(state: Literal["online", "offline"]) -> dict[str, Any]:
    """Whether the service runs."""
    return {"type": "service", "schema_version": VERSION, "state": state}


def _window(record: Mapping[str, Any]) -> dict[str, Any]:
    return {name: record.get(name.removesuffix("_m_s2")) for name in PlantWindow.model_fields}


def _depth(whole: Mapping[str, Any], rig: Mapping[str, Any] | None) -> dict[str, Any]:
    wear = whole["wear"]
    depth: Mapping[str, Any] = (wear.get("max_depth_um") or {}).get("combined") or {} if is_available(wear) else wear
    if not is_available(depth):
        return dict(depth or not_available(NO_FIGURE))
    limit = overview(whole, rig)["limit_um"]
    return {"depth_um": _band(depth), "limit_um": limit, "preliminary": _preliminary(wear)}


def _life(rul: Mapping[str, Any]) -> dict[str, Any]:
    if not is_available(rul):
        return dict(rul or not_available(NO_FIGURE))
    bands = {unit: _band(rul.get(unit) or {}) for unit in ("hours", "revolutions")}
    alone = bool(rul.get("of_wear_alone"))
    return {**bands, "reached": bool(rul.get("reached")), "of_wear_alone": alone, "preliminary": _preliminary(rul)}


def _band(band: Mapping[str, Any]) -> dict[str, Any]:
    return {key: band.get(key) for key in Band.model_fields}


def _preliminary(part: Mapping[str, Any]) -> list[str]:
    return list((part.get("preliminary") or {}).get("reasons") or ())
