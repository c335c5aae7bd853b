"""The window that a verdict rests on, and a level far beyond what was learned of the machine."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictWindow:
    """The latest window that was assessed, and the windows since."""

    index: int | None  # None where no window has been assessed
    start_time_ns: int | None  # its start [Unix ns]
    usual: float | None  # time between assessed windows of this machine [s]; None before the second
    latest_ns: int  # start of the latest window [Unix ns]
    since: int = 0  # windows after it, none of which was assessed
    reason: str = ""  # why the latest of them was not


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelExcess:
    """A vibration level beyond the limit learned from the machine's own first windows."""

    sensor: str
    value: float  # level [m/s²], or over the level that the model predicts
    median: float  # of the first windows
    limit: float
    relative: bool  # whether the values are relative to the model's
    windows: int  # in a row beyond the limit
    lasting: bool  # whether these are enough for an alarm
