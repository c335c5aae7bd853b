"""Wear depths that were measured on the flanks, as data."""

from __future__ import annotations

from dataclasses import dataclass

from twin.assessment import FLANKS
from twin.errors import ParameterError

MEASURED_DEPTH = "measure the wear depth at a stop, and enter it (`inspections`)"  # a remedy, for people
MOST_INSPECTIONS = 40  # those of the highest revolutions are used


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """A wear depth that was measured on the flanks."""

    revolutions: float  # of the pinion since new
    depth: float  # largest along the profile [m]
    flank: str  # "combined", "pinion" or "gear"
    std: float  # of the measurement [m]

    def __post_init__(self) -> None:
        if self.flank not in FLANKS:
            raise ParameterError(f"flank = {self.flank!r} must be one of {', '.join(FLANKS)}")
        if not self.revolutions >= 0:
            raise ParameterError(f"revolutions = {self.revolutions:g} of an inspection must not be negative")
        if not 0 <= self.depth < 0.1:
            raise ParameterError(f"depth = {self.depth:g} m of an inspection is outside [0, 0.1) m; micrometres?")
        if not 0 < self.std < 0.1:
            raise ParameterError(f"std = {self.std:g} m of an inspection is outside (0, 0.1) m; micrometres?")


def with_inspection(inspections: tuple[Inspection, ...], one: Inspection) -> tuple[Inspection, ...]:
    """The inspections with one more, in the order of their revolutions."""
    return tuple(sorted((*inspections, one), key=lambda i: i.revolutions))[-MOST_INSPECTIONS:]
