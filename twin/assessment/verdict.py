"""The window that a verdict rests on."""

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
