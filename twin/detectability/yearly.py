"""False alarms to be expected of a healthy machine in a year: searches are repeated, and each may be wrong.

    expected ≤ r·s

r  share of searches of healthy machines in which any effect is reported (twin/required_evidence.py: stated for a whole
   campaign, so that it bounds each of its searches)
s  searches in the year to come, by the schedule (twin/tracing/schedule.py), at the windows in a year so far

Limits   searches of one machine share most of their windows, so that there are fewer false alarms than this; a sign of
         something new adds a search
"""

from __future__ import annotations

from twin.assessment import FalseAlarms, Unavailable
from twin.tracing.schedule import SCHEDULE_LIMITS, ScheduleLimits
from twin.updating.running_time import Marks

YEAR = 365.25 * 86_400  # [s]
NS = 1e-9


def false_alarms(rate: float, measured: int, windows_seen: int, marks: Marks) -> FalseAlarms | Unavailable:
    """Of a machine after so many measurement windows.

    rate          of false alarms of a search
    windows_seen  of whatever kind
    marks         times of windows
    """
    elapsed = (marks[-1].time_ns - marks[0].time_ns) * NS if len(marks) > 1 else 0.0
    if not elapsed > 0 or windows_seen < 2:
        return Unavailable(
            reason="false alarms in a year are not available: one window does not say how often one comes"
        )
    windows = (windows_seen - 1) / elapsed * YEAR
    searches = float(searches_within(measured, windows))
    return FalseAlarms(rate=rate, windows=windows, searches=searches, expected=rate * searches)


def searches_within(measured: int, more: float, limits: ScheduleLimits = SCHEDULE_LIMITS) -> int:
    """Searches after so many measurement windows, until there are so many more."""
    count, at = 0, float(measured)
    while True:
        at += 1 if at < limits.each_until else max(1, int(at * limits.pause_share))
        if at > measured + more:
            return count
        count += 1
