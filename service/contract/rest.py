"""The shapes of what is posted, of problems, and of the answers that only REST gives.

The answer about an asset and its parts are described where they are made: in service/contract.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from service.contract.alarms import AlarmCount
from service.contract.base import AnswerModel
from service.contract.inspections import Changes
from service.contract.overview import Kind
from service.contract.parts import Band, NotAvailable
from service.contract.status import Status

Flank = Literal["combined", "pinion", "gear"]


class Problem(AnswerModel):
    """An error (RFC 9457)."""

    type: str = Field(description="URI of the kind of problem; `about:blank` where the status says it all")
    title: str
    status: int
    detail: str = Field(description="what was wrong here, with the value and what would be right")
    instance: str = Field(description="the path that was asked for")
    errors: list[dict[str, JsonValue]] | None = Field(
        None, description="on 422: the place and fault of each value that cannot be"
    )
    known: list[str] | None = Field(None, description="on 404 of an asset: the assets that are known")
    renamed: str | None = Field(None, description="on 404 of an asset that has another name now: that name")


class DecisionIn(BaseModel):
    """What is to become of an effect."""

    model_config = ConfigDict(extra="forbid", strict=True)

    decision: Literal["accept", "reject", "pin", "release"] = Field(
        description="accept: stays, confirmed; reject: leaves and is not added again; pin: stays with these very "
        "numbers; release: the data decide again"
    )
    by: str | None = Field(None, max_length=200, description="name of the person who decides")
    note: str | None = Field(None, max_length=2000, description="what was seen, or why")


class DecisionAnswer(AnswerModel):
    """A decision that has been kept."""

    id: int
    asset: str
    name: str
    decision: str
    received_ns: int = Field(description="Unix time [ns]")
    by: str | None = Field(None, description="name of the person who decided")
    note: str | None = None
    done: bool = Field(description="false while it is queued")


class Sparkline(AnswerModel):
    """The course of one quantity over the asset's history, evenly thinned."""

    quantity: str
    unit: str
    values: list[float] = Field(description="at most 30, oldest first")


class AssetSummary(AnswerModel):
    """One asset in the list."""

    asset: str
    status: Status
    data: Literal["waiting", "ok", "degraded", "stale"] = Field(description="whether usable data come")
    reason: str = Field(description="of `data`")
    alarms: AlarmCount = Field(description="open alarms")
    windows: int
    updates: int
    revolutions: float | None
    last_window: JsonValue = Field(description="start of the latest window")
    last_frame: str | None = Field(description="when the newest frame was received, ISO 8601 by the service's clock")
    last_seen: str | None = Field(
        description="the later of `last_frame` and of the newest window's reception, ISO 8601"
    )
    rig: str | None = Field(description="name of the rig file in use")
    last_event_id: int
    kind: Kind = Field(description="what the answers about this machine rest on")
    depth_um: Band | None = Field(description="largest combined wear depth [µm]; null where it is not available")
    limit_um: float | None = Field(description="depth at the end of life [µm]; null where no criterion is known")
    life_hours: Band | None = Field(description="remaining life at the present operating condition [h]")
    life_of_wear_alone: bool = Field(False, description="whether damage is found that the life does not count")
    preliminary: bool = Field(description="whether depth or life is preliminary")
    sparkline: Sparkline | None = Field(description="course of depth or level; null before the first window")
    retired: bool = Field(description="out of use: no frames are expected, and those that come are left out")


class TrendPoint(AnswerModel):
    """Vibration level, depth and remaining life with their bands, as of one window."""

    index: int | None
    kind: str | None
    start_time: str | None = None
    revolutions: float | None
    updated: bool | None
    quality: str | None = None
    speed_hz: float | None = None
    torque_nm: float | None = None
    rms_measured: float | None = None
    rms_predicted: float | None = None
    rms_after: float | None = None
    error_percent: float | None = None
    depth_um: dict[Flank, Band] | None = None
    rul_hours: Band | None = None
    rul_revolutions: Band | None = None


class FaultTotal(AnswerModel):
    """A kind of fault in the data, added up over all windows."""

    kind: str
    channel: str
    action: str = Field(description="what was done: `repaired`, `degraded`, `refused` or `none`")
    count: int = Field(description="frames, samples or edges concerned")
    windows: int = Field(description="windows concerned")


class Quality(AnswerModel):
    """Quality of the data so far."""

    windows: dict[str, int] | None = Field(None, description="windows by `good`, `repaired`, `degraded`, `refused`")
    channels: dict[str, dict[str, int]] | None = Field(None, description="frames by channel")
    missing_channels: list[str] | None = Field(None, description="named in the rig file, never seen")
    faults: list[dict[str, Any]] | None = Field(None, description="the latest faults, oldest first")
    totals: list[FaultTotal]


class InspectionIn(BaseModel):
    """A wear depth that was measured on the flanks."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    revolutions: float = Field(ge=0, le=1e15, description="of the pinion since new")
    max_depth_um: float = Field(ge=0, le=1e5, description="largest depth along the profile [µm]")
    flank: Flank = "combined"
    std_um: float = Field(gt=0, le=1e5, description="standard deviation of the measurement [µm]")


class Inspection(InspectionIn):
    """A measured depth as it was kept."""

    id: int
    received_ns: int = Field(description="Unix time [ns]")


class TwinDepth(AnswerModel):
    """The twin's own depth at the inspection's revolutions."""

    max_depth_um: Band
    extrapolated: bool = Field(description="true where the revolutions lie outside the windows")
    from_revolutions: float
    to_revolutions: float


class InspectionAnswer(AnswerModel):
    """A measured depth with the twin's own figure for comparison."""

    inspection: Inspection
    twin: TwinDepth | NotAvailable
    difference_um: float | None = Field(None, description="twin minus measured [µm]")
    difference_percent: float | None = Field(None, description="of the measured depth")
    within_band: bool | None = Field(None, description="whether the measured depth lies in the 5–95 % band")
    difference_in_std: float | None = Field(
        None, description="difference over the joint standard deviation of inspection and twin"
    )
    applied: bool | None = Field(None, description="whether the inspection is part of the estimate")
    reason: str | None = Field(None, description="why it is not")
    changed: Changes | None = Field(None, description="what it changed")
    contradiction: str | None = Field(None, description="where it contradicts the windows, in a sentence")


class StaleAsset(AnswerModel):
    """An asset whose figures no longer say how the machine is now."""

    asset: str
    since: str = Field(description="ISO 8601, by the service's clock")
    reason: str


class Readiness(AnswerModel):
    """Whether frames are accepted, and what of them is missing."""

    status: Literal["ready"]
    stale: list[StaleAsset] | None = Field(None, description="absent for who may not read the assets")
    unserved_partitions: list[int] | None = Field(
        None, description="of a fleet: partitions whose assets nobody processes at present; absent elsewhere"
    )


class Health(AnswerModel):
    """State of the process."""

    status: Literal["ok"]
