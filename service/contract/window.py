"""`windows[]`: one record for each measurement window."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from service.contract.base import ContractModel
from service.contract.shape import Made, made_of
from service.stream.channels import kind_of
from twin import assessment
from twin.windows import Window


class SlowValue(ContractModel):
    """What a window says of a slow channel."""

    value: float | None
    unit: str
    values: int = Field(description="how many of the window it summarises; 0 where it is an older one")
    age_s: float | None = Field(description="of the newest value at the window's end")


@made_of(assessment.WindowAssessment)
class WindowRecord(Made):
    start_time: str | None = Field(default=None, description="start of the window, ISO 8601")
    temperatures: dict[str, SlowValue] | None = Field(default=None, description="slow channels, by place")
    loads: dict[str, SlowValue] | None = Field(
        default=None, description="slow channels of load, by place, in % of the rated load; shown, and not used"
    )
    quality: str | None = Field(default=None, description="`good`, `repaired`, `degraded` or `refused`")
    faults: list[dict[str, Any]] | None = Field(default=None, description="what was wrong with the window's data")
    reason: str | None = Field(default=None, description="why a refused window could not be used")


REQUIRED = (
    "index", "kind", "start_time", "revolutions", "speed_hz", "torque_nm", "rms_measured", "rms_predicted",
    "error_percent", "updated", "rms_after", "k_wear_per_n", "wear_depth_um",
)  # fmt: skip
"""Keys that every record carries, with or without a value."""


def refused_record(reason: str) -> dict[str, Any]:
    """The record of a window that could not be used: all required keys, without values."""
    return {**dict.fromkeys(REQUIRED), "kind": "measurement", "updated": False, "reason": reason}


def slow_channels(window: Window) -> dict[str, dict[str, Any]]:
    """What a window's record says of its slow channels, by the kind's key (`temperatures`) and name; no key without.

    Each is a `SlowValue` in the contract's units.
    """
    out: dict[str, dict[str, Any]] = {}
    for label, slow in window.slow.items():
        kind, name = kind_of(label), label.partition("/")[2]
        out.setdefault(kind.record_key, {})[name] = {
            "value": slow.value - kind.si_offset,
            "unit": kind.unit,
            "values": slow.count,
            "age_s": slow.age,
        }
    return out
