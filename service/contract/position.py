"""`{prefix}/{asset}/twin/position`: how far an asset's stream is stored. Publishers keep their frames by it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from pydantic import Field, ValidationError

from service.contract.base import ContractModel


class ChannelPositionModel(ContractModel):
    """The newest frame received of one channel."""

    sequence: int
    start_time_ns: int
    missing: list[tuple[int, int]] = Field(default=[], description="sequence numbers waited for, [first, last]")


class PositionModel(ContractModel):
    """What a publisher may forget, and what it should keep or send again."""

    asset: str
    instance: str = Field(description="another one after each start of the service, and after an adoption")
    accepting: bool = Field(description="whether frames of the asset are used")
    reason: str | None = Field(default=None, description="why they are not")
    behind: bool = Field(
        default=False,
        description="true where the service was too busy to answer after the frames sent before: ask again",
    )
    unsettled_from_ns: int | None = Field(
        default=None, description="start of the earliest frame that is held in memory only; null where none is"
    )
    settled_until_ns: int | None = Field(default=None, description="end of the newest window that is stored")
    channels: Mapping[str, ChannelPositionModel] = {}
    left_out: Mapping[str, int] = Field(default={}, description="frames of the asset that were not used, by cause")
    ahead_frames: int = Field(default=256, description="frames that may be sent before this is asked again")
    ahead_bytes: int = Field(default=2**22, description="bytes of these frames")
    backlog: int = Field(default=0, description="windows that wait to be processed")
    unassessed: str | None = Field(
        default=None, description="why windows that are stored cannot be assessed at present"
    )
    shed: int = Field(
        default=0, description="windows left out for want of room, on arrival or while they waited to be processed"
    )


def why_unknown(stream: str) -> str:
    """Why no frames are used of a stream whose asset nobody has adopted."""
    return (
        f"asset {stream} is unknown to the service: adopt it on the page, or by gear-twin remote assets adopt {stream}"
    )


def why_retired(asset: str) -> str:
    """Why no frames are used of an asset that is retired."""
    return f"asset {asset} is retired: its frames are left out"


def not_connected(stream: str, reason: str | None = None) -> PositionModel:
    """The position of a stream while there is no connection to the network."""
    reason = reason or "the service is not connected to the network"
    return PositionModel(asset=stream, instance="", accepting=False, reason=reason)


def position_text(model: PositionModel) -> str:
    """As it is published."""
    return json.dumps(model.model_dump(mode="json"), allow_nan=False)


def position_of(text: str | bytes) -> PositionModel | None:
    """What a text says, keys of later versions left aside; None where it is no position."""
    try:
        data: Any = json.loads(text)
        channels = {label: _known(ChannelPositionModel, each) for label, each in data.get("channels", {}).items()}
        return PositionModel.model_validate({**_known(PositionModel, data), "channels": channels})
    except (AttributeError, ValueError, ValidationError):
        return None


def _known(model: type[ContractModel], data: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in data.items() if key in model.model_fields}
