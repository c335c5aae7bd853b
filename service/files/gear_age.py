"""The age of the gears as a person states it: `new`, "5000 rev", "1200 h" or `unknown`; in a rig file, revolutions."""

from __future__ import annotations

import re

from service.errors import InputError
from twin.gear_age import NEW, UNKNOWN

HOUR = 3600.0  # [s]
EXAMPLE = "5000 rev"
_WRITTEN = re.compile(r"\s*(\d+(?:[.,]\d+)?)\s*(rev|revolutions|turns|h|hours)\s*")


def age_of(where: str, given: object, speed_hz: float | None) -> str | float:
    """`new`, `unknown`, or the revolutions of the pinion that the gears have made; InputError for anything else.

    speed_hz  of the pinion, by which hours become revolutions; None where it is not known
    """
    if given in (NEW, UNKNOWN):
        return str(given)
    found = _WRITTEN.fullmatch(given) if isinstance(given, str) else None
    if found is None:
        raise InputError(
            f"{where} = {given!r} must be {NEW}, {UNKNOWN}, revolutions of the pinion such as {EXAMPLE!r}, or hours "
            "run such as '1200 h'"
        )
    value = float(found[1].replace(",", "."))
    if found[2] not in ("h", "hours"):
        return value
    if speed_hz is None:
        raise InputError(
            f"{where} = {given!r}: hours become revolutions by the pinion's speed, which is not known; state "
            "operating.pinion_speed_hz in the rig file, or revolutions"
        )
    return value * HOUR * speed_hz
