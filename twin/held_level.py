"""The level of a machine's status that is held until enough windows in a row have been lower.

Levels rise at once. A level that falls with one window would rise again with the scatter of the next.
"""

from __future__ import annotations

from dataclasses import dataclass

from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelHysteresis:
    """When the level of the status falls."""

    windows: int = deciding(
        3,
        unit="windows",
        meaning="assessed windows in a row at a lower level after which watch, alarm or end of life falls to it",
        source="convention: as many as an alarm by a learned limit needs to end (`DURATION` of the default rules)",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldLevel:
    """The level of the status, and the finding that it rests on; plain serialisable data."""

    level: str = "normal"
    subject: str = ""
    reason: str = ""
    action: str = ""
    time_ns: int = 0  # start of the latest window that gave it [Unix ns]
    lower: int = 0  # assessed windows since, each at a lower level
