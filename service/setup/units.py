"""Numbers with their units, as a person writes them: "2 mm", "600 rpm", "1,5 kW".

A bare number is refused: a module of 2 could be millimetres or metres, a speed of 10 could be hertz or turns a minute.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import pi, radians

from service.errors import InputError

INCH, POUND_FOOT, HORSEPOWER = 0.0254, 1.3558179483314004, 745.6998715822702
UNITS: Mapping[str, Mapping[str, float]] = {  # kind of quantity → unit → factor to SI
    "length": {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "µm": 1e-6, "um": 1e-6, "in": INCH},
    "speed": {"rpm": 1 / 60, "1/min": 1 / 60, "min-1": 1 / 60, "Hz": 1.0, "rad/s": 1 / (2 * pi)},
    "torque": {"Nm": 1.0, "N·m": 1.0, "N*m": 1.0, "kNm": 1e3, "lbf·ft": POUND_FOOT, "lbf*ft": POUND_FOOT},
    "power": {"kW": 1e3, "W": 1.0, "MW": 1e6, "hp": HORSEPOWER},
    "angle": {"deg": radians(1.0), "°": radians(1.0), "rad": 1.0},
    "rate": {"Hz": 1.0, "kHz": 1e3, "S/s": 1.0, "kS/s": 1e3},
}
WRITTEN = re.compile(r"\s*([+-]?[\d.,]+(?:[eE][+-]?\d+)?)\s*(\S.*?)?\s*")


def quantity(where: str, given: object, kind: str, example: str) -> float:
    """A quantity in SI; InputError where the unit is missing or not one of its kind."""
    found = WRITTEN.fullmatch(given) if isinstance(given, str) else None
    if found is None or not found[2]:
        raise InputError(f"{where} = {given!r} needs a number with its unit, such as {example!r}")
    factor = UNITS[kind].get(found[2])
    if factor is None:
        raise InputError(f"{where} = {given!r}: {found[2]!r} is no unit of {kind}; known: {', '.join(UNITS[kind])}")
    try:
        return float(found[1].replace(",", ".")) * factor
    except ValueError:
        raise InputError(f"{where} = {given!r}: {found[1]!r} is not a number, as in {example!r}") from None
