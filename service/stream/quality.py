"""Data quality of one asset: what was wrong with its stream, counted by channel and kind."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from twin.windows import Fault, Window

_RECENT = 50  # faults kept in full


@dataclass(slots=True)
class Quality:
    """Counts since the asset was first seen, and the newest faults in full."""

    windows: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(("good", "repaired", "degraded", "refused"), 0)
    )
    faults: list[dict[str, Any]] = field(default_factory=list)

    def note_window(self, index: int, window: Window, grade: str) -> list[dict[str, Any]]:
        """Counts one window; answers its faults as JSON-safe data."""
        self.windows[grade] = self.windows.get(grade, 0) + 1
        faults = [{"window": index, **fault_json(fault)} for fault in window.faults]
        self.faults = [*self.faults, *faults][-_RECENT:]
        return faults

    def note(self, kind: str, channel: str, count: int, action: str, detail: str) -> None:
        """Keeps a fault that belongs to no window."""
        fault = Fault(kind=kind, channel=channel, count=count, action=action, detail=detail)
        self.faults = [*self.faults, {"window": None, **fault_json(fault)}][-_RECENT:]

    def to_dict(self, counters: Mapping[str, Mapping[str, int]], expected: Iterable[str] = ()) -> dict[str, Any]:
        """The section `data_quality` of the answer."""
        return {
            "windows": dict(self.windows),
            "channels": {label: dict(kinds) for label, kinds in sorted(counters.items())},
            "missing_channels": sorted(label for label in expected if not counters.get(label, {}).get("frames")),
            "faults": [dict(fault) for fault in self.faults],
        }

    def copy(self) -> Quality:
        """Counts of their own, equal to these."""
        return replace(self, windows=dict(self.windows), faults=list(self.faults))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Quality:
        return cls(windows=dict(data["windows"]), faults=[dict(fault) for fault in data["faults"]])


def fault_json(fault: Fault) -> dict[str, Any]:
    """A fault as JSON-safe data."""
    return {
        "kind": fault.kind,
        "channel": fault.channel,
        "count": int(fault.count),
        "action": fault.action,
        "detail": fault.detail,
    }
