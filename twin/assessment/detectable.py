"""What the windows of a machine of which nothing was found would have shown, and how often a search is wrong."""

from __future__ import annotations

from dataclasses import dataclass

from twin.assessment.values import Unavailable


@dataclass(frozen=True, slots=True, kw_only=True)
class SmallestSize:
    """The smallest size of one effect that the windows so far would have shown."""

    name: str
    parameter: str  # what the size is of
    unit: str  # SI, "" for a pure number
    value: float | None  # None where no size would have been found
    basis: str  # what the figure rests on, or why there is none
    hidden: bool = False  # whether the channels are there, and yet no size would have shown in them


@dataclass(frozen=True, slots=True, kw_only=True)
class FalseAlarms:
    """How many effects healthy machines are expected to be given in a year."""

    rate: float  # of the searches
    windows: float  # measurement windows in a year, by those so far
    searches: float  # in the year to come
    expected: float  # false alarms in the year, at most


@dataclass(frozen=True, slots=True, kw_only=True)
class Detectable:
    """What could have been found where nothing was."""

    windows: int  # that were searched
    sizes: tuple[SmallestSize, ...]  # of each effect of the alarm class
    false_alarms: FalseAlarms | Unavailable
