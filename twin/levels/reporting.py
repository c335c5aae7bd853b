"""Depth of a window by a calibrated relation, in the names of the contract; JSON-safe data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin.errors import NotAvailable, ParameterError
from twin.features.window_features import WindowFeatures
from twin.levels.relation import Origin, Relation
from twin.report import MICRO, not_available
from twin.rig import Rig

RECENT = 10  # windows for which the level of another condition stands beside
ONE_FLANK = "the level does not tell on which flank the wear is"
NOT_STATED = "the relation does not say of which {} its levels are; a level is taken to be of the same"
NO_RATE = "a level gives the depth of the wear, not its rate"


def not_stated(origin: Origin) -> str | None:
    """That a relation does not say what its levels are of, None where it does."""
    missing = [what for what, stated in (("sensor", origin.sensor), ("band", origin.band)) if stated is None]
    return NOT_STATED.format(" and ".join(missing)) if missing else None


def wear_by_level(
    relation: Relation, rig: Rig, features: WindowFeatures, before: Mapping[str, Any], index: int
) -> dict[str, Any]:
    """`wear` of a window: depth of both flanks together, from its level and the latest under other conditions.

    before  `wear` of the window before
    Raises NotAvailable where the relation says nothing of this window.
    """
    if rig.teeth != relation.teeth:
        raise NotAvailable(f"the rig file has {rig.teeth} teeth, the relation's {relation.teeth}: which are right?")
    if features.rms is None or features.speed_hz is None:
        raise NotAvailable("the relation of level and depth needs a level and a speed")
    origin = relation.origin
    if origin.sensor is not None and origin.sensor != features.sensor:
        raise NotAvailable(f"the relation is of sensor {origin.sensor!r}, this level of {features.sensor!r}")
    if origin.band is not None and origin.band != rig.band:
        here, there = (f"{low:g} to {high:g} Hz" for low, high in (rig.band, origin.band))
        raise NotAvailable(f"the relation is of the RMS from {there}, this level from {here}")
    label = relation.condition_of(features.speed_hz, features.torque_nm)
    if label is None:
        known = ", ".join(f"{c.condition.speed_hz:g} Hz" for c in relation.curves.values())
        raise NotAvailable(
            f"the relation of level and depth holds for {known}, not for {features.speed_hz:.4g} Hz under this load"
        )
    levels = {
        k: v
        for k, v in before.get("levels", {}).items()
        if index - v["window"] <= RECENT and k in relation.curves and k != label
    }
    levels[label] = {"level": features.rms, "window": index}
    try:
        found = relation.depth({k: v["level"] for k, v in levels.items()})
    except ParameterError as error:
        raise NotAvailable(str(error)) from None
    return {
        "k_wear_per_n": None,
        "specific_wear_rate_m2_per_n": None,
        "max_depth_um": {
            "combined": {
                "median": found.median * MICRO,
                "p05": found.p05 * MICRO,
                "p95": found.p95 * MICRO if found.bounded else None,
            },
            "pinion": not_available(ONE_FLANK),
            "gear": not_available(ONE_FLANK),
        },
        "profile": None,
        "way": "level",
        "relation": {
            "asset": origin.asset,
            "causes": list(origin.causes),
            "sensor": origin.sensor,
            "band_hz": None if origin.band is None else list(origin.band),
            "note": not_stated(origin),
        },
        "levels": levels,
        "reason": None
        if found.bounded
        else f"the level no longer rises with depth: at least {found.p05 * MICRO:.0f} µm, an upper bound is not known",
    }
