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
        self.faults = [*self.faults, *faults][-_RECENT:]
        return faults

    def note(self, kind: str, channel: str, count: int, action: str, detail: str) -> None:
        """Keeps a fault that belongs to no window."""
        fault = Fault(kind=kind, channel=channel, count=count, action=action, detail=detail)
        self.faults = [*self.faults, {"window": None, **fault_json(fault)}][-_RECENT:]

    def to_dict(self, counters: Mapping[str, Mapping[str, int]], expected: Iterable[str] = ()) -> dict[str, Any]:
        """The section `data_quality` of the answer.

        counters  what was counted of frames, by channel and kind
        """
        channels = {label: dict(kinds) for label, kinds in counters.items()}
        for label, found in self.found.items():
            kinds = channels.setdefault(label, {})
            kinds |= {kind: kinds.get(kind, 0) + number for kind, number in found.items()}
        return {
            "windows": dict(self.windows),
            "channels": dict(sorted(channels.items())),
            "missing_channels": sorted(label for label in expected if not counters.get(label, {}).get("frames")),
            "faults": [dict(fault) for fault in self.faults],
        }

    def copy(self) -> Quality:
        """Counts of their own, equal to these."""
        found = {label: dict(kinds) for label, kinds in self.found.items()}
        return replace(self, windows=dict(self.windows), faults=list(self.faults), found=found)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], found: Mapping[str, Mapping[str, int]]) -> Quality:
        """From the section of an answer, and what was found in the making of windows."""
        return cls(
            windows=dict(data["windows"]),
            faults=[dict(fault) for fault in data["faults"]],
            found={label: dict(kinds) for label, kinds in found.items()},
        )


def fault_json(fault: Fault) -> dict[str, Any]:
    """A fault as JSON-safe data."""
    return {
        "kind": fault.kind,
        "channel": fault.channel,
        "count": int(fault.count),
        "action": fault.action,
        "detail": fault.detail,
    }
