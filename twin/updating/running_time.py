"""How much of the time a machine runs, and on which date a remaining life ends.

    u = Σ ΔN/f / Δt          date = t + L/u

ΔN  revolutions of the pinion from one window to the next, which it makes whether it is recorded or not
f   pinion speed, the mean of both windows  [Hz]      Δt  from the first of these windows to the latest  [s]
L   running time left  [s]                            t   start of the latest window

The rig file's operating.hours_per_day is used where it is given; else u is observed over the latest RUNNING.recent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.assessment import Life, LifeDate, Unavailable
from twin.rig import Rig
from twin.thresholds import deciding

HOURS_A_DAY = 24.0
NS = 1e-9  # [s]
DAY = 86400.0  # [s]
MOST_MARKS = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningLimits:
    """From which windows the running time per day is observed."""

    least: float = deciding(
        7 * DAY,
        unit="s",
        meaning="time between the first and the latest window from which a running time per day is observed",
        source="not derived: chosen; a week shows working days and free days",
    )
    recent: float = deciding(
        30 * DAY,
        unit="s",
        meaning="how far back the running time per day is observed",
        source="not derived: chosen; a change of shifts shows within a month",
    )
    margin: float = deciding(
        1.05,
        of="the time that has passed",
        meaning="running time from which counter and clock contradict each other",
        source="not derived: allows for the wander of the speed between two windows",
    )
    furthest: float = deciding(
        100 * 365.25 * DAY,
        unit="s",
        meaning="time ahead beyond which no date is stated",
        source="not derived: chosen; a date beyond a hundred years plans nothing",
    )


RUNNING = RunningLimits()


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """The running time up to one window."""

    time_ns: int  # start of the window [Unix ns]
    revolutions: float  # of the pinion
    speed: float  # [Hz]
    run: float  # running time since the first window [s]


Marks = tuple[Mark, ...]


def with_mark(marks: Marks, time_ns: int, revolutions: float | None, speed: float | None) -> Marks:
    """The marks with a window's; as they are where it has no count or speed, or is earlier than the latest."""
    if revolutions is None or not speed:
        return marks
    run = 0.0
    if marks:
        last = marks[-1]
        if time_ns <= last.time_ns or revolutions < last.revolutions:
            return marks
        run = last.run + (revolutions - last.revolutions) / (0.5 * (speed + last.speed))
    marks = (*marks, Mark(time_ns=time_ns, revolutions=revolutions, speed=speed, run=run))
    if len(marks) <= MOST_MARKS:
        return marks
    half = MOST_MARKS // 2
    return (*marks[:half:2], *marks[half:])  # older ones thinned, the first kept


def running_share(rig: Rig, marks: Marks, limits: RunningLimits = RUNNING) -> tuple[float, str] | Unavailable:
    """The share of the time that the machine runs, and where it is from; or why it is not known."""
    stated = rig.get("operating.hours_per_day")
    if stated is not None:
        return stated / HOURS_A_DAY, "rig file"
    missing = "the date is not available: give the running time per day as operating.hours_per_day in the rig file"
    if not marks:
        return Unavailable(reason=missing)
    last = marks[-1]
    recent = [m for m in marks if (last.time_ns - m.time_ns) * NS <= limits.recent]
    earlier = [m for m in marks if (last.time_ns - m.time_ns) * NS > limits.recent]
    first = earlier[-1] if earlier and (last.time_ns - recent[0].time_ns) * NS < limits.least else recent[0]
    passed, run = (last.time_ns - first.time_ns) * NS, last.run - first.run
    if passed < limits.least:
        return Unavailable(
            reason=f"{missing}; the windows so far cover {passed / 3600:.3g} h, and {limits.least / DAY:.0f} days are "
            "needed to observe it"
        )
    if run > limits.margin * passed:
        return Unavailable(
            reason=f"{missing}; it cannot be observed, because the revolutions counted would take {run / 3600:.3g} h "
            f"and only {passed / 3600:.3g} h have passed by the recordings' clock"
        )
    if not run > 0:
        return Unavailable(reason=f"{missing}; the machine has not run in the last {passed / DAY:.0f} days")
    return min(run / passed, 1.0), "observed"


def dated(rig: Rig, life: Life | Unavailable, marks: Marks, limits: RunningLimits = RUNNING) -> Life | Unavailable:
    """A life with the dates at which its median and band end."""
    if isinstance(life, Unavailable):
        return life
    share = running_share(rig, marks, limits)
    if isinstance(share, Unavailable):
        return replace(life, date=share)
    if not marks:
        return replace(life, date=Unavailable(reason="the date is not available: no window has a count and a speed"))
    used, source = share
    now = marks[-1].time_ns

    def at(left: float | None) -> int | None:
        ahead = None if left is None else left / used
        return None if ahead is None or ahead > limits.furthest else now + round(ahead / NS)

    time = life.time
    return replace(
        life,
        date=LifeDate(
            since_ns=now, running_share=used, source=source, median_ns=at(time.median), p05_ns=at(time.p05),
            p95_ns=at(time.p95),
        ),
    )  # fmt: skip
