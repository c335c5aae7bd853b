"""Data quality of one asset: what was wrong with its frames, by who receives them, and with its windows, by the twin's
side; together they are the section `data_quality` of the answer.

The `action` of a fault says how it was dealt with: `repaired` (the rest is sound), `degraded` (something essential is
missing or not to be trusted), `refused` (nothing usable is left), `none` (noted only).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from twin.windows import Fault, Window

_SEVERITY = ("none", "repaired", "degraded", "refused")  # of actions; a window without one that matters is good
_OF_FRAMES = {"gap", "shed", "left_out", "clock", "conflict"}
REPAIRABLE = 0.2  # share of a channel that may be missing before its window is degraded
RECENT = 50  # faults kept in full


def grade_of(faults: Iterable[Fault]) -> str:
    """The grade of a window with these faults: that of the worst."""
    worst = max((_SEVERITY.index(f.action) for f in faults), default=0)
    return _SEVERITY[worst] if worst else "good"


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


@dataclass(slots=True)
class Counts:
    """Windows since the asset was first seen, and their newest faults in full."""

    windows: dict[str, int] = field(default_factory=lambda: dict.fromkeys(("good", *_SEVERITY[1:]), 0))
    faults: list[dict[str, Any]] = field(default_factory=list)
    found: dict[str, dict[str, int]] = field(default_factory=dict)  # in the making of windows, by channel and kind

    def note_window(
        self, index: int, window: Window, grade: str, found: Mapping[tuple[str, str], int]
    ) -> list[dict[str, Any]]:
        """Counts one window, with what its making has found; answers its faults as JSON-safe data."""
        self.windows[grade] = self.windows.get(grade, 0) + 1
        for (label, kind), number in found.items():
            kinds = self.found.setdefault(label, {})
            kinds[kind] = kinds.get(kind, 0) + number
        faults = [{"window": index, **fault_json(fault)} for fault in window.faults]
        self.faults = [*self.faults, *faults][-RECENT:]
        return faults

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe data."""
        return asdict(self)

    def copy(self) -> Counts:
        """Counts of their own, equal to these."""
        return Counts(**self.to_dict())

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Counts:
        """From `to_dict`; what is absent is not counted yet."""
        return cls(**{f.name: data[f.name] for f in fields(cls) if f.name in data})


def received_quality(
    counters: Mapping[str, Mapping[str, int]], expected: Iterable[str], faults: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """What is known of an asset's frames, JSON-safe.

    counters  what was counted of them, by channel and kind
    faults    that belong to no window
    """
    return {
        "channels": {label: dict(kinds) for label, kinds in sorted(counters.items())},
        "missing_channels": sorted(label for label in expected if not counters.get(label, {}).get("frames")),
        "faults": list(faults),
    }


def data_quality(counts: Mapping[str, Any], received: Mapping[str, Any]) -> dict[str, Any]:
    """The section `data_quality`: the windows, and what was counted of each channel by both sides.

    counts    as `Counts.to_dict` gives them
    received  as `received_quality` gives it
    """
    windows = Counts.from_dict(counts)
    channels = {label: dict(kinds) for label, kinds in received.get("channels", {}).items()}
    for label, found in windows.found.items():
        kinds = channels.setdefault(label, {})
        kinds |= {kind: kinds.get(kind, 0) + number for kind, number in found.items()}
    return {
        "windows": windows.windows,
        "channels": dict(sorted(channels.items())),
        "missing_channels": list(received.get("missing_channels", ())),
        "faults": [*received.get("faults", ()), *windows.faults][-RECENT:],
    }


def outside_windows(fault: Fault) -> dict[str, Any]:
    """A fault that belongs to no window, as JSON-safe data."""
    return {"window": None, **fault_json(fault)}


def fault_json(fault: Fault) -> dict[str, Any]:
    """A fault as JSON-safe data."""
    return {
        "kind": fault.kind,
        "channel": fault.channel,
        "count": int(fault.count),
        "action": fault.action,
        "detail": fault.detail,
    }
