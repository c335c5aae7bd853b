"""Which values of a rig file are estimates, and how far the machine may differ from them.

A machine of which only the gears' data sheet is known has a rig file in which structure, damping and wear coefficient
are generic. Its table `[estimated]` says so: `parts` names what was estimated, `spread` how far off it may be,
`derived` and `assumed` list the keys. What is answered with such a file carries the spread in its band.

    ln x ~ N(ln x₀, s²)        x₀ value of the file, s the spread of its part; values of a part are independent
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

PARTS: Mapping[str, str] = {
    "structure": "every stiffness of shafts, couplings and bearings",
    "inertias": "every inertia of couplings, encoders, motor and load, and every mass of a bearing",
    "bodies": "masses and inertias of the gears themselves",
    "damping": "modal damping ratio and damping time of the contacts",
    "mesh": "stiffness of the tooth pairs",
    "contact": "contact half-width",
    "wear": "wear coefficient",
}
_BODIES = ("inertias.J5", "inertias.J10", "masses.m5", "masses.m10")
_BY_TABLE = {
    "shafts": "structure",
    "torsional_stiffness": "structure",
    "bearings": "structure",
    "inertias": "inertias",
    "masses": "inertias",
    "damping": "damping",
}
_BY_KEY = {
    "mesh.relative_damping_time": "damping",
    "mesh.stiffness_scale": "mesh",
    "wear.contact_half_width": "contact",
    "wear.K": "wear",
    "shafts.gear_position_fraction": None,  # a place, not a size: it has no spread of its own
} | dict.fromkeys(_BODIES, "bodies")


def part_of(key: str) -> str | None:
    """The part whose spread holds for a key of the rig file; None for one without a spread."""
    return _BY_KEY[key] if key in _BY_KEY else _BY_TABLE.get(key.partition(".")[0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimated:
    """What of a rig file is estimated; nothing where the file has no such table."""

    by: str = ""  # who or what made the estimates
    spread: Mapping[str, float] = field(default_factory=dict)  # part → standard deviation of ln value
    derived: tuple[str, ...] = ()  # keys that follow from given values by a formula or a standard
    assumed: tuple[str, ...] = ()  # keys whose values are generic

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Estimated:
        """The table of a checked rig file's mapping."""
        table = values.get("estimated", {})
        spread = table.get("spread", {})
        return cls(
            by=table.get("by", ""),
            spread={part: spread[part] for part in table.get("parts", ())},
            derived=tuple(table.get("derived", ())),
            assumed=tuple(table.get("assumed", ())),
        )

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts that are estimated, in the file's order; empty where none is."""
        return tuple(self.spread)
