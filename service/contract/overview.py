"""What a list of assets shows of each: the kind of machine, depth with its limit, and remaining life."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from service.contract.trend import is_available
from twin.assessment.key import MICROMETRE

Kind = Literal["model", "baseline", "encoders", "level"]


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
