"""Wear depth of a window by a calibrated relation of vibration level and depth (relation.py).

The latest levels under other operating conditions are used with it, for as long as they are recent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.assessment import Interval, LevelReading, LevelWear, RelationOrigin
from twin.errors import NotAvailable, ParameterError
from twin.features.window_features import WindowFeatures
from twin.levels.relation import DepthFound, Origin, Relation
from twin.rig import Rig
from twin.thresholds import deciding

ONE_FLANK = "a level does not show on which flank the wear is"
NOT_STATED = "the relation does not state the {} of its levels; they are assumed to be those of this recording"
NO_RATE = "a level gives the depth of the wear, not its rate"


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelLimits:
    """Which levels are used together."""

    recent: int = deciding(
        10,
        unit="windows",
        meaning="age up to which the level of another operating condition is used with the present one",
        source="not derived: chosen; over so few windows the depth is taken as the same",
    )


LEVEL_LIMITS = LevelLimits()


def not_stated(origin: Origin) -> str | None:
    """What a relation does not state of its levels, as a sentence; None where it states all."""
    missing = [what for what, stated in (("sensor", origin.sensor), ("band", origin.band)) if stated is None]
    return NOT_STATED.format(" and ".join(missing)) if missing else None


def wear_by_level(
    relation: Relation,
    rig: Rig,
    features: WindowFeatures,
    before: Mapping[str, LevelReading],
    index: int,
    limits: LevelLimits = LEVEL_LIMITS,
) -> LevelWear:
    """The depth of both flanks together, from the window's level and the latest under other conditions.

    before  the latest level under each operating condition, before this window
    index   of this window
    Raises NotAvailable where the relation says nothing of this window.
    """
    label = _condition(relation, rig, features)
    assert features.rms is not None
    levels = {
        name: reading
        for name, reading in before.items()
        if index - reading.window <= limits.recent and name in relation.curves and name != label
    }
    levels[label] = LevelReading(level=features.rms, window=index)
    try:
        found = relation.depth({name: reading.level for name, reading in levels.items()})
    except ParameterError as error:
        raise NotAvailable(str(error)) from None
    origin = relation.origin
    return LevelWear(
        depth=stated(found),
        relation=RelationOrigin(
            asset=origin.asset,
            curve=origin.curve,
            causes=tuple(origin.causes),
            sensor=origin.sensor,
            band=origin.band,
            note=not_stated(origin),
        ),
        levels=levels,
        reason=bounds_reason(found),
        flank_reason=ONE_FLANK,
    )


def _condition(relation: Relation, rig: Rig, features: WindowFeatures) -> str:
    """The relation's operating condition that the window belongs to; NotAvailable where it belongs to none."""
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
    return label


def stated(found: DepthFound) -> Interval:
    """The depth [m] as it is shown; no median where the levels may be those of unworn gears: none may have worn."""
    return Interval(
        median=None if found.unworn else float(found.median),
        p05=float(found.p05),
        p95=float(found.p95) if found.bounded else None,
    )


def bounds_reason(found: DepthFound) -> str | None:
    """Why a bound of the depth is not known or is zero, as a sentence; None where both are as the levels give them."""
    reasons = []
    if not found.bounded:
        least = f"at least {found.p05 * 1e6:.0f} µm, " if found.p05 > 0 else ""
        reasons.append(f"the level no longer rises with depth: {least}an upper bound is not known")
    if found.unworn:
        reasons.append("the levels may be those of unworn gears")
    return "; ".join(reasons) or None
