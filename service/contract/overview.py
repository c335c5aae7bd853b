"""A report in short: what a list of assets shows of each, and what is kept of each window's report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from twin.assessment.key import MICROMETRE

Kind = Literal["model", "baseline", "encoders", "level"]


def is_available(part: Any) -> bool:
    """Whether a part of a report holds figures."""
    return bool(part) and not (isinstance(part, Mapping) and part.get("status") == "not available")


def kind_of(whole: Mapping[str, Any]) -> Kind:
    """What the answers about a machine rest on.

    model     a rig model: depth, profile, life and attribution
    baseline  recordings of the healthy machine
    encoders  two encoders of a gear pair
    level     vibration level and condition indicators, with or without a relation of level and depth
    """
    wear = whole.get("wear")
    by_level = isinstance(wear, Mapping) and bool(wear.get("relation"))
    if not by_level and (is_available(wear) or is_available(whole.get("calibration"))):
        return "model"
    if is_available(whole.get("baseline")):
        return "baseline"
    return "encoders" if is_available(whole.get("pair")) else "level"


def overview(whole: Mapping[str, Any], rig: Mapping[str, Any] | None) -> dict[str, Any]:
    """Kind, depth with its limit, and life of an asset's whole state."""
    wear, rul = whole.get("wear"), whole.get("rul")
    depth = (wear.get("max_depth_um") or {}).get("combined") if isinstance(wear, Mapping) else None
    life = rul if isinstance(rul, Mapping) and is_available(rul) else {}
    limit = life.get("max_depth_um")
    if limit is None and rig is not None:
        stated = (rig.get("end_of_life") or {}).get("max_depth")
        limit = None if stated is None else stated / MICROMETRE
    return {
        "kind": kind_of(whole),
        "depth_um": dict(depth) if isinstance(depth, Mapping) and is_available(depth) else None,
        "limit_um": limit,
        "life_hours": life.get("hours"),
        "life_of_wear_alone": bool(life.get("of_wear_alone")),
        "preliminary": any(isinstance(part, Mapping) and bool(part.get("preliminary")) for part in (wear, rul)),
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
