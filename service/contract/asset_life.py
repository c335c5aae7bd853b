"""Bodies of REST about the life of an asset."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.contract.base import AnswerModel
from service.stream.wire.topics import NAME

OPTIONAL = ("by", "note", "at", "revolutions", "sensor", "count", "name")
NAMED = f"^{NAME.pattern}$"
MOST_TURNS = 1e15


class AssetIn(BaseModel):
    """An asset that has not sent a frame yet."""

    model_config = ConfigDict(extra="forbid", strict=True)

    asset: str = Field(pattern=NAMED, description="its name, the first part of its keys after the prefix")
    rig: dict[str, Any] | None = Field(None, description="the rig file, as JSON")
    by: str | None = Field(None, max_length=200, description="who creates it")
    note: str | None = Field(None, max_length=2000)


class _Made(BaseModel):
    """Who made a change, and when."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    by: str | None = Field(None, max_length=200, description="who made the change, or answers")
    note: str | None = Field(None, max_length=2000)
    at: str | None = Field(None, max_length=64, description="when it was made, ISO 8601; kept as it is given")

    def kept(self) -> dict[str, Any]:
        """What is kept of it: all that was given but the kind."""
        return {name: value for name in OPTIONAL if (value := getattr(self, name, None)) is not None}


class PlainChange(_Made):
    """A change that needs no more than its name."""

    kind: Literal["oil_changed", "reassembled", "ignore", "retired", "reinstated"]


class GearsReplaced(_Made):
    """Another pair of the same kind, unworn."""

    kind: Literal["gears_replaced"]
    revolutions: float | None = Field(
        None, ge=0, le=MOST_TURNS, description="the encoder's count then; default: by the latest window"
    )


class SensorMoved(_Made):
    """An accelerometer at another place, or another one, or mounted otherwise."""

    kind: Literal["sensor_moved"]
    sensor: str = Field(pattern=NAMED, description="the accelerometer")


class CounterReset(_Made):
    """The revolution count began again; the gears are the same."""

    kind: Literal["counter_reset"]
    revolutions: float | None = Field(
        None, ge=0, le=MOST_TURNS, description="of the pinion since new, at the reset; default: by the latest window"
    )
    count: float | None = Field(None, ge=0, le=MOST_TURNS, description="what it was set to, in turns; default 0")


class Named(_Made):
    """Another name for the asset, or a name for the other machine whose windows wait."""

    kind: Literal["renamed", "other_machine"]
    name: str = Field(pattern=NAMED, description="the asset's new name, or the new asset's")


ChangeIn = Annotated[PlainChange | GearsReplaced | SensorMoved | CounterReset | Named, Field(discriminator="kind")]


class AssetChange(AnswerModel):
    """A change as it was kept."""

    id: int
    asset: str
    kind: str
    received: str = Field(description="ISO 8601, by the service's clock")
    by: str | None = None
    note: str | None = None
    at: str | None = None
    revolutions: float | None = None
    sensor: str | None = None
    count: float | None = None
    name: str | None = None
    done: bool = Field(description="false while it is queued")
    effect: dict[str, Any] | None = Field(None, description="what it changed; null while it is queued")


class Epoch(AnswerModel):
    """The time of one pair of gears."""

    epoch: int
    windows: int
    first: int = Field(description="index of its first window")
    last: int = Field(description="index of its last window")
    since: str = Field(description="start of its first window")
