"""The shapes of the REST answers, for the OpenAPI page and for what is posted.

Reports are written by the twin and passed on as they are; these models describe them. Every part may be
`not available` with its reason where too little is known of the machine, and parts may carry more than
is named here.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

Flank = Literal["combined", "pinion", "gear"]


class _Open(BaseModel):
    model_config = ConfigDict(extra="allow")


class Problem(BaseModel):
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


class NotAvailable(BaseModel):
    """Stands for a part that cannot be computed from what is known."""

    status: Literal["not available"]
    reason: str


class Band(_Open):
    """Median and 5–95 % band."""

    median: float | None
    p05: float | None
    p95: float | None


class WindowRecord(_Open):
    """One measurement window."""

    index: int
    kind: str = Field(description="`measurement` or `calibration`")
    start_time: JsonValue = Field(None, description="start of the window")
    revolutions: float | None = Field(None, description="of the pinion since new, at the window's middle")
    speed_hz: float | None = Field(None, description="pinion speed [Hz]")
    torque_nm: float | None = Field(None, description="input torque [N·m]")
    rms_measured: float | None = Field(None, description="reference accelerometer, in the rig's band [m/s²]")
    rms_predicted: float | None = Field(None, description="before any update in this window [m/s²]")
    error_percent: float | None = Field(None, description="100·(predicted − measured)/measured")
    updated: bool | None = Field(None, description="true where the error passed the threshold")
    rms_after: float | None = Field(None, description="predicted again after the update [m/s²]")
    k_wear_per_n: float | None = Field(None, description="Archard coefficient K [1/N]")
    wear_depth_um: float | None = Field(None, description="largest combined depth [µm]")
    quality: str | None = Field(None, description="`good`, `repaired`, `degraded` or `refused`")
    faults: list[dict[str, Any]] | None = Field(None, description="what was wrong with the window's data")


class Depths(_Open):
    """Largest depth along the profile, by flank [µm]."""

    combined: Band | NotAvailable | None = None
    pinion: Band | NotAvailable | None = None
    gear: Band | NotAvailable | None = None


class Wear(_Open):
    """Wear now."""

    k_wear_per_n: float | None = Field(None, description="Archard coefficient K [1/N]")
    specific_wear_rate_m2_per_n: float | None = Field(None, description="dimensional coefficient k [m²/N]")
    max_depth_um: Depths | NotAvailable | None = None
    profile: JsonValue = Field(None, description="depth along both flanks")
    relation: JsonValue = Field(None, description="of level and depth: what it is of, and what it does not say of that")


class Rul(_Open):
    """Remaining useful life at the present operating condition."""

    criterion: JsonValue = None
    revolutions: Band | NotAvailable | None = None
    hours: Band | NotAvailable | None = None


class Residual(_Open):
    """What the twin does not explain, over the latest windows."""

    rms_error_percent: float | NotAvailable | None = None
    waveform_error_percent: float | NotAvailable | None = None
    bands: JsonValue = Field(None, description="per gear-mesh harmonic: measured and predicted RMS")
    orders: JsonValue = Field(None, description="the strongest unexplained lines, strongest first")


class Figure(_Open):
    """One parameter of an effect."""

    value: float | None
    unit: str
    std: float | None


class Evidence(_Open):
    """How much better the machine is explained with the effect."""

    log_evidence: float | None = Field(None, description="natural logarithm of the evidence over the twin without it")
    over_runner_up: float | None = Field(None, description="the same over the next best explanation")
    runner_up: str | None = None
    not_told_from: list[str] | None = Field(None, description="explanations that these channels cannot tell it from")
    detail: str = ""


class Errors(_Open):
    """Errors on windows that took no part in fitting."""

    rms_percent: float | None = None
    waveform_percent: float | None = None


class Effect(_Open):
    """An effect that the model lacked and that was added."""

    name: str
    status: str | None = Field(None, description="`found`, `accepted` or `pinned`")
    parameters: dict[str, Figure] | None = None
    evidence: Evidence | None = None
    error_before: Errors | None = None
    error_after: Errors | None = None
    wear_depth_um_before: float | None = Field(None, description="at the latest window, without the effect [µm]")
    wear_depth_um_after: float | None = Field(None, description="with it [µm]")
    onset_revolutions: float | None = Field(None, description="of the pinion; 0 if there from the start")


class Tracing(_Open):
    """What the effects rest on, and what the twin would say without them."""

    candidates: list[dict[str, JsonValue]] | None = None
    held_out: list[int] | None = Field(None, description="indices of windows kept from all fits")
    fitted: list[int] | None = None
    rejected: list[str] | None = Field(None, description="names that an engineer has ruled out")
    unknown: str | None = Field(None, description="what has no name, in words")
    depths: list[dict[str, JsonValue]] | None = Field(None, description="depth by window without and with the effects")
    residual: JsonValue = Field(None, description="of one held-out window by band and order, before and after")
    log: list[dict[str, JsonValue]] | None = Field(None, description="every change of the model with its evidence")


class DecisionIn(BaseModel):
    """What is to become of an effect."""

    model_config = ConfigDict(extra="forbid", strict=True)

    decision: Literal["accept", "reject", "pin", "release"] = Field(
        description="accept: stays, confirmed; reject: leaves and is not added again; pin: stays with these very "
        "numbers; release: the data decide again"
    )


class DecisionAnswer(BaseModel):
    """A decision that has been kept."""

    id: int
    asset: str
    name: str
    decision: str
    received_ns: int = Field(description="Unix time [ns]")
    done: bool = Field(description="false while it is queued")


class Unexplained(_Open):
    """What is left beyond the model and its effects."""

    share_percent: float | NotAvailable | None = None
    verdict: str | None = Field(None, description="`explained`, `unknown_effect` or `insufficient_data`")


class RunOut(_Open):
    """What comes once, or so many times, a turn of one wheel."""

    shaft: str
    multiple: int = Field(description="times a turn")
    amplitude_urad: float | None = Field(description="as an angle of the pinion [µrad]")
    std_urad: float | None
    amplitude_um: float | None = Field(description="on the wheel's base radius [µm]; null where none is known")
    std_um: float | None
    not_told_from: list[str] = Field(description="what encoders alone cannot tell it from")


class Pair(_Open):
    """What two encoders tell of a pair whose rig file gives no model."""

    window: int = Field(description="index of the window that told it")
    ratio: Figure | None = Field(None, description="turns of the pinion for one of the gear")
    teeth_that_fit: list[str] | None = Field(None, description="tooth counts gear/pinion within two deviations")
    stated: JsonValue = Field(None, description="the rig file's ratio, and whether the encoders contradict it")
    run_out: list[RunOut] | None = None
    rest_urad: dict[str, float | None] | None = Field(
        None,
        description="rms of the transmission error [µrad of the pinion] `before` and `after` run-out is taken out",
    )
    missed_counts: JsonValue = Field(None, description="sharp steps that no wheel repeats: time and counts")
    sharp_steps: JsonValue = Field(None, description="others: what a wheel repeats, or what was passed once only")
    transmission_error: JsonValue = Field(None, description="over the pinion's turns, before and after [µrad]")
    speed: JsonValue = Field(None, description="of either shaft against time [Hz]")
    status: str | None = Field(None, description="`not available` with a `reason`, where the window does not tell it")


class Asset(_Open):
    """The whole state of one asset, the same as `gear-twin assess` writes."""

    asset: str
    windows: list[WindowRecord]
    wear: Wear | NotAvailable
    rul: Rul | NotAvailable
    residual: Residual | NotAvailable
    effects: list[Effect] | NotAvailable
    unexplained: Unexplained | NotAvailable
    tracing: Tracing | NotAvailable
    pair: Pair | None = Field(None, description="absent where a model is known, or an encoder is not there")
    data_quality: dict[str, Any]


class AssetSummary(BaseModel):
    """One asset in the list."""

    asset: str
    status: Literal["waiting", "ok", "degraded", "stale"]
    reason: str
    windows: int
    updates: int
    revolutions: float | None
    last_window: JsonValue = Field(description="start of the latest window")
    rig: str | None = Field(description="name of the rig file in use")
    last_event_id: int


class TrendPoint(_Open):
    """Depth and remaining life with their bands, as of one window."""

    index: int | None
    kind: str | None
    revolutions: float | None
    updated: bool | None
    depth_um: dict[Flank, Band] | None = None
    rul_hours: Band | None = None
    rul_revolutions: Band | None = None


class FaultTotal(BaseModel):
    """A kind of fault in the data, added up over all windows."""

    kind: str
    channel: str
    action: str = Field(description="what was done: `repaired`, `degraded`, `refused` or `none`")
    count: int = Field(description="frames, samples or edges concerned")
    windows: int = Field(description="windows concerned")


class Quality(_Open):
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


class TwinDepth(BaseModel):
    """The twin's own depth at the inspection's revolutions."""

    max_depth_um: Band
    extrapolated: bool = Field(description="true where the revolutions lie outside the windows")
    from_revolutions: float
    to_revolutions: float


class InspectionAnswer(BaseModel):
    """A measured depth with the twin's own figure beside it."""

    inspection: Inspection
    twin: TwinDepth | NotAvailable
    difference_um: float | None = Field(None, description="twin minus measured [µm]")
    difference_percent: float | None = Field(None, description="of the measured depth")
    within_band: bool | None = Field(None, description="whether the measured depth lies in the 5–95 % band")
    difference_in_std: float | None = Field(
        None, description="difference over the joint standard deviation of inspection and twin"
    )


class StaleAsset(BaseModel):
    """An asset whose figures no longer say how the machine is now."""

    asset: str
    since: str = Field(description="ISO 8601, by the service's clock")
    reason: str


class Readiness(BaseModel):
    """Whether frames are accepted, and what of them is missing."""

    status: Literal["ready"]
    stale: list[StaleAsset]


class Health(BaseModel):
    """State of the process."""

    status: Literal["ok"]
