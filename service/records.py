"""The JSON that the twin answers with: one document an asset, the same from every source of frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, is_dataclass
from math import isfinite
from typing import Any

import numpy as np

NO_WINDOW = "no whole measurement window has been received yet"
PARTS = ("wear", "rul", "residual", "unexplained")


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


def not_available(reason: str) -> dict[str, str]:
    """What stands in a report where a part of it cannot be computed."""
    return {"status": "not available", "reason": reason}


def is_available(part: Any) -> bool:
    """Whether a part of a report holds figures."""
    return bool(part) and not (isinstance(part, Mapping) and part.get("status") == "not available")


def document(asset: str, windows: Iterable[Mapping], report: Mapping[str, Any] | None) -> dict[str, Any]:
    """The whole state of one asset, with the names of the contract's section 4."""
    report = report or {}
    parts = {name: report.get(name) or not_available(NO_WINDOW) for name in PARTS}
    effects = report.get("effects")
    rest = {k: v for k, v in report.items() if k not in (*PARTS, "effects", "asset", "windows")}
    return {
        "asset": asset,
        "windows": list(windows),
        **parts,
        "effects": [] if effects is None else effects,
        **rest,
    }


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
