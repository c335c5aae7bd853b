"""The stages of one window in the service: when each of them ended, and who wants to know once it is over."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from service.steady_clock import later_time_ns

NS = 1e-9  # [s]
TOTAL = "total"  # the part of a computation that is all of it


@dataclass(slots=True, kw_only=True)
class Journey:
    """Unix times of this host; 0 for a part that has not ended [ns]."""

    received_ns: int = 0  # the newest frame of the window's asset came
    closed_ns: int = field(default_factory=later_time_ns)  # the window had all its frames; else this process began
    kept_ns: int = 0  # it was durable
    started_ns: int = 0  # its asset's twin was asked
    made_ns: int = 0  # the twin had answered
    stored_ns: int = 0  # its results were durable
    published_ns: int = 0  # they were shown
    parts: Mapping[str, float] = field(default_factory=dict)  # of the computation: `total` and the twin's own [s]

    @property
    def waited(self) -> float:
        """How long ago the window was complete [s]."""
        return max(later_time_ns() - self.closed_ns, 0) * NS

    @property
    def delay(self) -> float:
        """From the complete window to its stored results [s]."""
        return max(self.stored_ns - self.closed_ns, 0) * NS


Arrived = Callable[[str, int, str, Journey], object]
"""Called with asset, the window's index, its grade and its stages."""


def nobody(asset: str, index: int, grade: str, journey: Journey) -> None:
    """Nobody wants to know."""
