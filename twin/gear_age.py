"""What is known of the gears' age: the one fact by which revolutions count from new gears, or from an unknown state.

A stream by the interface contract states the age: its encoders count since the gears were new. Where a rig file says
otherwise (`gears.age`, also in what `gear-twin import` attaches to a recording of a file without such a counter), that
holds: a number of revolutions that the gears had made at the count's zero, or that nobody knows.
"""

from __future__ import annotations

from dataclasses import dataclass

from twin.thresholds import deciding

NEW, UNKNOWN = "new", "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class GearAge:
    """The gears' age where a revolution count is zero."""

    known: bool = True
    revolutions: float = 0.0  # of the pinion that they had made; 0 where nobody knows

    @classmethod
    def of(cls, stated: str | float | None) -> GearAge:
        """As a rig file states it: `new`, `unknown` or revolutions; None where it does not, and the count does."""
        if stated == UNKNOWN:
            return cls(known=False)
        return cls(revolutions=0.0 if stated is None or isinstance(stated, str) else stated)


SINCE_NEW = GearAge()  # as a stream by the interface contract counts


@dataclass(frozen=True, slots=True, kw_only=True)
class Newness:
    """Until when gears count as unworn."""

    revolutions: float = deciding(
        150.0,
        unit="turns of the pinion",
        meaning="a window before so many turns since new is one of unworn flanks",
        source="not derived: chosen so that the first windows of a campaign count; at the reference rig's wear "
        "coefficient the depth is then 4 µm",
    )


NEWNESS = Newness()


def unworn(revolutions: float, age_known: bool, limits: Newness = NEWNESS) -> bool:
    """Whether flanks are unworn after so many revolutions since new; never where nobody knows their age."""
    return age_known and revolutions < limits.revolutions
