"""Reports as strict JSON data, and what is kept of each for every window."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, is_dataclass
from math import isfinite
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """The value as strict JSON data: numpy unwrapped, tuples as lists, not-finite numbers as null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, str) or value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, Iterable):
        return [plain(v) for v in value]
    raise TypeError(f"{type(value).__name__} is not JSON data")


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
