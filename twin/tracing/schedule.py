"""When the history is searched for effects, and which windows of it are kept.

The search from scratch is made at LEAST_WINDOWS measurement windows and again each time there are half as many more.
Between, a trace fits what was found anew, and searches on where the misfit has grown: at every window of a short
campaign, at ever fewer of a long one, and at once where a window shows a sign of something new (change_detection.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.state import LEAST_WINDOWS, Tracing
from twin.updating.conditions import kind_of
from twin.updating.history import WindowInput

MOST_HISTORY = 40  # windows that are kept, to be replayed


@dataclass(frozen=True, slots=True, kw_only=True)
class ScheduleLimits:
    """How often effects are sought."""

    each_until: int = deciding(
        12,
        unit="windows",
        meaning="measurement windows up to which each is traced",
        source="not derived: chosen so that a short campaign is followed window by window",
    )
    pause_share: float = deciding(
        0.25,
        of="measurement windows so far",
        meaning="pause between two traces of a longer campaign",
        source="not derived: chosen so that the cost of tracing grows with the logarithm of the campaign's length",
    )
    search_share: float = deciding(
        0.5,
        of="measurement windows so far",
        meaning="windows more until the search from scratch is made again",
        source="not derived: chosen so that the cost of searching grows with the logarithm of the campaign's length",
    )
    misfit_growth: float = deciding(
        1.3,
        of="misfit after the latest trace",
        meaning="misfit up to which a trace between two searches does not search on",
        source="not derived: chosen",
    )


SCHEDULE_LIMITS = ScheduleLimits()


def search_due(tracing: Tracing) -> bool:
    """Whether the search from scratch is due."""
    return tracing.measured >= tracing.next_search


def trace_due(tracing: Tracing) -> bool:
    """Whether a trace is due, of whatever kind."""
    return tracing.measured >= LEAST_WINDOWS and (search_due(tracing) or tracing.measured >= tracing.next_trace)


def after_trace(tracing: Tracing, limits: ScheduleLimits = SCHEDULE_LIMITS) -> Tracing:
    """The memory with the next trace set."""
    short = tracing.measured < limits.each_until
    pause = 1 if short else int(tracing.measured * limits.pause_share)
    return replace(tracing, next_trace=tracing.measured + pause)


def after_search(tracing: Tracing, waiting: bool, limits: ScheduleLimits = SCHEDULE_LIMITS) -> Tracing:
    """The memory with the next search set; `waiting` where only the latest window shows something new."""
    if waiting:
        return replace(tracing, next_search=tracing.measured + 1, next_trace=tracing.measured + 1)
    return replace(tracing, next_search=tracing.measured + max(2, int(tracing.measured * limits.search_share)))


def tolerated_misfit(tracing: Tracing, search: bool, limits: ScheduleLimits = SCHEDULE_LIMITS) -> float:
    """Misfit of the mesh lines up to which no more effects are sought."""
    return 0.0 if search else limits.misfit_growth * (tracing.latest.misfit_after or 0.0)


def thinned(rig: Rig, history: tuple[WindowInput, ...]) -> tuple[WindowInput, ...]:
    """At most MOST_HISTORY windows: every second of the older measurement windows goes."""
    if len(history) <= MOST_HISTORY:
        return history
    measurement = [i for i, t in enumerate(history) if kind_of(t.features, rig) == "measurement"]
    old = measurement[: 2 * len(measurement) // 3]
    drop = set(old[1::2]) or {1}
    return tuple(t for i, t in enumerate(history) if i not in drop)
