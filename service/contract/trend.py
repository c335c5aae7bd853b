"""What is kept of each report for every window."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def is_available(part: Any) -> bool:
    """Whether a part of a report holds figures."""
    return bool(part) and not (isinstance(part, Mapping) and part.get("status") == "not available")


def figures(report: Mapping[str, Any]) -> dict[str, Any]:
    """What one window's report says of depth and life with their bands, kept for each window.

    `depth_um` by flank and `rul_hours`, `rul_revolutions`: each `median`, `p05`, `p95`; absent where the
    report has none.
    """
    out: dict[str, Any] = {}
    wear, rul = report.get("wear"), report.get("rul")
    if is_available(wear) and isinstance(wear, Mapping):
        depth = {
            flank: band
            for flank in ("combined", "pinion", "gear")
            if (band := _band((wear.get("max_depth_um") or {}).get(flank)))
        }
        if depth:
            out["depth_um"] = depth
    if is_available(rul) and isinstance(rul, Mapping):
        for unit in ("hours", "revolutions"):
            if band := _band(rul.get(unit)):
                out[f"rul_{unit}"] = band
    return out


def _band(value: Any) -> dict[str, float | None] | None:
    if not isinstance(value, Mapping) or value.get("median") is None:
        return None
    return {key: value.get(key) for key in ("median", "p05", "p95")}
