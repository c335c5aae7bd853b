"""What one number of an effect is: unit, bounds, prior, and the value at which the effect is not there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isnan
from typing import Any

from twin.errors import ImpossibleSize


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter of an effect, named as the dataclass field that holds it."""

    name: str
    unit: str  # SI; "" for a pure number
    low: float  # smallest value that makes sense
    high: float
    prior: float  # spread about the neutral value before any measurement; of an angle its whole range
    neutral: float = 0.0  # where the effect vanishes, whatever the others are, unless `shape`
    shape: bool = False  # only shapes the effect: no value of it makes the effect vanish
    phase: str = ""  # parameter that holds its phase, where it is an amplitude with a free one
    teeth: int | None = None  # 0 one value a pinion tooth, 1 one a gear tooth, None not by tooth
    several: bool = False  # whether it has several values that belong to no teeth

    @property
    def many(self) -> bool:
        """Whether it has several values, and none where the effect is not there."""
        return self.teeth is not None or self.several


def check(effect: Any) -> None:
    """Raises ImpossibleSize where a parameter is outside its bounds; the neutral value is always allowed."""
    for parameter in effect.parameters:
        value = getattr(effect, parameter.name)
        for v in value if parameter.many else (value,):
            if isnan(v) or not (parameter.low <= v <= parameter.high or v == parameter.neutral):
                unit = f" {parameter.unit}" if parameter.unit else ""
                raise ImpossibleSize(
                    f"{type(effect).__name__}.{parameter.name} = {v:g}{unit} is outside "
                    f"{parameter.low:g} … {parameter.high:g}{unit}; another unit?"
                )


def neutral(effect: Any) -> Any:
    """The same effect with nothing left of it: every parameter that is no mere shape at its neutral value."""
    changes = {}
    for parameter in effect.parameters:
        if not parameter.shape:
            changes[parameter.name] = () if parameter.many else parameter.neutral
    return replace(effect, **changes)
