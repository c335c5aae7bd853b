"""What the windows of a machine of which nothing was found would have shown, and how often a search is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from twin.assessment.key import HIDDEN, Key
from twin.assessment.values import Unavailable


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallestSize:
    """The smallest size of an effect of the alarm class that the windows so far would have shown."""

    name: Annotated[str, Key(meaning="of the effect")]
    parameter: Annotated[str, Key(meaning="what the size is of")]
    unit: str  # SI, "" for a pure number
    value: Annotated[float | None, Key(meaning="null where no size would have been found")]
    basis: Annotated[str, Key(meaning="what the figure rests on, or why there is none")]
    hidden: Annotated[bool, HIDDEN] = False  # its channels were compared, and yet change too much to show any size


@dataclass(frozen=True, slots=True, kw_only=True)
class FalseAlarms:
    """False alarms to be expected of a healthy machine in a year."""

    expected: Annotated[float, Key("per_machine_year", meaning="at most")]
    rate: Annotated[float, Key(meaning="share of the searches of healthy machines in which an effect may be reported")]
    searches: Annotated[float, Key("searches_per_year", meaning="in the year to come, at the windows in a year so far")]
    windows: Annotated[float, Key("windows_per_year")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Detectable:
    """What could have been found: where nothing was, or where the verdict is `explained`."""

    windows: Annotated[int, Key(meaning="measurement windows that were searched")]
    sizes: Annotated[tuple[SmallestSize, ...], Key("effects")]  # of each effect of the alarm class
    false_alarms: FalseAlarms | Unavailable
