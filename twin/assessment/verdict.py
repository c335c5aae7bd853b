"""The window that a verdict rests on, and a level far beyond what was learned of the machine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from twin.assessment.key import HIDDEN, ISO_TIME, OPTIONAL, Key

_AGE = Key("age_s", meaning="from its start to that of the latest window", after="start_time")


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictWindow:
    """The window that the verdict rests on: the latest that was assessed, and the windows since."""

    index: Annotated[
        int | None,
        Key("window", meaning="index of the latest assessed window; null where none has been assessed"),
    ]
    start_time_ns: Annotated[int | None, Key("start_time", ISO_TIME, "its start, ISO 8601")]
    usual: Annotated[
        float | None, Key("usual_s", meaning="usual time between assessed windows of this machine")
    ]  # None before the second
    latest_ns: Annotated[int, HIDDEN]  # start of the latest window [Unix ns]
    since: Annotated[int, Key("not_assessed", meaning="windows since, none of which was assessed")] = 0
    reason: Annotated[str, Key(meaning="why the latest of them was not", null=True, shown=OPTIONAL)] = ""

    @property
    def age(self) -> Annotated[float | None, _AGE]:
        """From its start to that of the latest window [s]."""
        return None if self.start_time_ns is None else max(self.latest_ns - self.start_time_ns, 0) / 1e9


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
