"""The answer about one asset, by the contract's section 4: the same from `assess` and from the service."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

SECTIONS = ("wear", "rul", "residual", "effects", "unexplained", "calibration", "tracing")
RECORD_FIELDS = (
    "index", "kind", "start_time", "revolutions", "speed_hz", "torque_nm", "rms_measured", "rms_predicted",
    "error_percent", "updated", "rms_after", "k_wear_per_n", "wear_depth_um",
)  # fmt: skip


def not_available(reason: str) -> dict[str, Any]:
    """What stands where a quantity cannot be given."""
    return {"status": "not available", "reason": reason}


def assemble(
    asset: str,
    records: Iterable[Mapping[str, Any]],
    report: Mapping[str, Any] | None,
    quality: Mapping[str, Any],
) -> dict[str, Any]:
    """The whole answer: window records, the twin's newest report and the data quality."""
    reason = "no window has been taken into the twin yet"
    blank = {name: [] if name == "effects" else not_available(reason) for name in SECTIONS}
    if report is not None:
        blank["tracing"] = not_available("effects have not been sought in this asset's windows")
    return {
        "asset": asset,
        "windows": [dict(record) for record in records],
        **blank,
        **(report or {}),
        "data_quality": dict(quality),
    }


def refused_record(reason: str) -> dict[str, Any]:
    """The record of a window that could not be taken: all fields of the contract, without values."""
    return {**dict.fromkeys(RECORD_FIELDS), "kind": "measurement", "updated": False, "reason": reason}


def iso_time(time_ns: int) -> str:
    """Unix time [ns] as ISO 8601 in UTC, to the nanosecond."""
    seconds, rest = divmod(time_ns, 1_000_000_000)
    return (datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)).strftime(f"%Y-%m-%dT%H:%M:%S.{rest:09d}Z")
