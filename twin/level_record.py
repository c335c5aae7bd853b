"""The vibration level against the machine's own first windows, under each operating condition.

With a model, the level is taken relative to what the model predicts, so that wear, which raises levels, raises nothing
here; without one it is the measured level. Limits are those of learned_limits.py.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.assessment import LevelExcess
from twin.learned_limits import DEFAULT, LearnedLimits, OperatingPoint, learned
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelAlarm:
    """When a level beyond its learned limit is an alarm."""

    windows: int = deciding(
        3,
        unit="windows",
        meaning="windows in a row beyond the alarm limit from which the level is an alarm; before that it is watched",
        source="convention: as many as an alarm by a learned limit needs (`DURATION` of the default rules); a spike is "
        "in one window",
    )
    points: int = deciding(
        16,
        meaning="operating conditions whose levels are remembered; the one that was learned first is forgotten",
        source="not derived: more than a machine with set points has",
    )


ALARM = LevelAlarm()


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedLevel:
    """What is learned under one operating condition; plain serialisable data."""

    point: OperatingPoint
    relative: bool  # to the level that the model predicts
    values: tuple[float, ...] = ()  # of the first windows, taken as healthy
    beyond: int = 0  # windows in a row beyond the alarm limit


Levels = tuple[LearnedLevel, ...]


def with_level(
    known: Levels, point: OperatingPoint, value: float, *, relative: bool, sensor: str, limits: LearnedLimits = DEFAULT
) -> tuple[Levels, LevelExcess | None]:
    """The levels with one more window's, and by how much it lies beyond its limit; None where it does not."""
    own = next((x for x in known if x.relative == relative and x.point.matches(point, limits)), None)
    rest = tuple(x for x in known if x is not own)
    own = own or LearnedLevel(point=point, relative=relative)
    found = learned(own.values, limits)
    if found is None:
        own = replace(own, values=(*own.values, value)) if value > 0 else own
        return (*rest, own)[-ALARM.points :], None
    own = replace(own, beyond=own.beyond + 1 if value > found.alarm else 0)
    excess = LevelExcess(
        sensor=sensor, value=value, median=found.median, limit=found.alarm, relative=relative, windows=own.beyond,
        lasting=own.beyond >= ALARM.windows,
    )  # fmt: skip
    return (*rest, own)[-ALARM.points :], excess if own.beyond else None
