"""How JSON shows a field of an assessment: its key, unit and meaning, declared with its type.

    depth: Annotated[float, Key("wear_depth_um", MICROMETRE, "largest combined depth")]

A field without a `Key` is shown under its own name. Plain data: `service/contract/shape.py` makes the JSON and its
description of it. The unit of a field holds for all numbers within it that state none themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from enum import Enum
from math import pi
from typing import Any, Final

MICROMETRE = 1e-6  # [m]
MILLIMETRE = 1e-3  # [m]
MICRORADIAN = 1e-6  # [rad]
DEGREE = pi / 180  # [rad]
PERCENT = 0.01
HOUR = 3600.0  # [s]
ISO_TIME: Final = "ISO 8601"  # of Unix time [ns]


class Shown(Enum):
    """Where a key is there."""

    ALWAYS = "always"
    OPTIONAL = "always here, but not in all answers of its kind"
    DEFAULT = "always here; the field's default holds where an answer lacks it"
    GIVEN = "where the value is not None"
    FILLED = "where the value is not empty"
    NEVER = "never"


ALWAYS, OPTIONAL, DEFAULT, GIVEN, FILLED, NEVER = Shown


@dataclass(frozen=True, slots=True)
class Key:
    """How one field, or one property, is shown."""

    name: str = ""  # the field's own where empty
    unit: float | str | None = None  # in SI, or ISO_TIME
    meaning: str = ""
    _: KW_ONLY
    digits: int | None = None  # after the point; None: all
    null: bool = False  # null takes the place of numbers that are not finite, and of an empty text
    choices: tuple[str, ...] = ()  # all values of a text; empty where it is free
    shown: Shown | Callable[[Any], bool] = ALWAYS  # a function is asked with the whole dataclass
    after: str = ""  # of a property: the key that it follows; it comes first where empty


HIDDEN = Key(shown=NEVER)
