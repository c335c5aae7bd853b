"""What was wrong with a window's data: how bad it is, and how often each kind occurred.

The `action` of a fault says how it was dealt with: `repaired` (the rest is sound), `degraded` (something essential is
missing or not to be trusted), `refused` (nothing usable is left), `none` (noted only).
"""

from __future__ import annotations

from collections.abc import Iterable

from twin.windows import Fault

GRADES = {
    "none": "good",
    "repaired": "repaired",
    "degraded": "degraded",
    "refused": "refused",
}  # of a window, by action
_SEVERITY = tuple(GRADES)
_OF_FRAMES = {"gap", "shed", "left_out", "clock", "conflict"}
REPAIRABLE = 0.2  # share of a channel that may be missing before its window is degraded


def grade_of(faults: Iterable[Fault]) -> str:
    """The grade of a window with these faults: that of the worst."""
    worst = max((_SEVERITY.index(f.action) for f in faults), default=0)
    return GRADES[_SEVERITY[worst]]


def by_share(share: float) -> str:
    """How a fault is dealt with that concerns a share of a channel's values."""
    return "repaired" if share <= REPAIRABLE else "degraded"


def totals(faults: Iterable[Fault]) -> dict[tuple[str, str], int]:
    """Counts by (channel, kind), but for kinds whose frames are counted one by one."""
    out: dict[tuple[str, str], int] = {}
    for fault in faults:
        if fault.kind not in _OF_FRAMES:
            out[fault.channel, fault.kind] = out.get((fault.channel, fault.kind), 0) + fault.count
    return out
