"""The answer to what was asked of another duty, by the twin."""

from __future__ import annotations

from datetime import UTC, datetime
from math import inf
from typing import Any

from service.contract.base import in_unit, iso_time
from service.contract.parts import Band, NotAvailable, Preliminary
from service.contract.what_if import (
    DateBand,
    DutyDistribution,
    DutyPointIn,
    RunningTime,
    Survival,
    Target,
    WhatIf,
    WhatIfIn,
)
from twin.assessment import Life, Unavailable
from twin.assessment.key import HOUR, MICROMETRE
from twin.errors import NotAvailable as Missing
from twin.errors import ParameterError
from twin.rig import Rig
from twin.state import State
from twin.updating.running_time import HOURS_A_DAY, NS, RUNNING, running_share
from twin.what_if import DutyLife, DutyPoint, Phase, what_if


def answer(asset: str, rig: Rig, state: State, asked: WhatIfIn) -> dict[str, Any]:
    """The answer to what was asked; NotAvailable or ParameterError where there is none."""
    life = state.latest.life
    if not isinstance(life, Life):
        why = life.reason if isinstance(life, Unavailable) else "no window has given a remaining life yet"
        raise Missing(f"a life under another duty is not available: {why}")
    clock = _Clock(rig, state, asked.hours_per_day)
    target = clock.running_hours(asked.until, "until") if asked.until else asked.hours
    limit = None if asked.max_depth_um is None else asked.max_depth_um * MICROMETRE
    found = what_if(rig, state, _phases(asked, life, clock), None if target is None else target * HOUR, limit)
    hours, revolutions = (
        Band.model_validate({"median": q[0.5], "p05": q[0.05], "p95": q[0.95]})
        for q in (
            {p: in_unit(time, HOUR) for p, time, _ in found.quantiles},
            {p: turned for p, _, turned in found.quantiles},
        )
    )
    return WhatIf(
        asset=asset,
        since=clock.since,
        criterion=life.criterion,
        max_depth_um=(limit or life.limit) / MICROMETRE,
        reached=found.reached,
        hours=hours,
        revolutions=revolutions,
        date=clock.dates(hours),
        running=clock.running,
        distribution=DutyDistribution(
            probability=[p for p, _, _ in found.quantiles],
            hours=[in_unit(time, HOUR) for _, time, _ in found.quantiles],
            revolutions=[turned for _, _, turned in found.quantiles],
        ),
        survival=_survival(found),
        target=None if target is None else _target(found, target, asked.until, clock),
        present_hours=Band.of(life.time, HOUR),
        preliminary=None if found.preliminary is None else Preliminary.of(found.preliminary),
        notes=list(found.notes),
        reason=found.reason,
    ).as_json()


class _Clock:
    """From hours of operation to dates and back, counted from the latest window."""

    def __init__(self, rig: Rig, state: State, hours_per_day: float | None) -> None:
        known = running_share(rig, state.running)
        self._missing = known.reason if isinstance(known, Unavailable) else ""
        self._share, source = (0.0, "") if isinstance(known, Unavailable) else known
        if hours_per_day is not None:
            self._share, source = hours_per_day / HOURS_A_DAY, "request"
        self._now_ns = state.running[-1].time_ns if state.running else None
        self.since = None if self._now_ns is None else iso_time(self._now_ns)
        self.running: RunningTime | NotAvailable = (
            RunningTime(hours_per_day=HOURS_A_DAY * self._share, source=source)
            if self._share
            else NotAvailable.of(Unavailable(reason=self._missing))
        )

    def running_hours(self, date: datetime, name: str) -> float:
        """Hours of operation from the latest window to a date."""
        if not self._share or self._now_ns is None:
            raise Missing(f"hours_per_day is needed to reckon with dates: {self._missing or 'no window has a date'}")
        aware = date if date.tzinfo else date.replace(tzinfo=UTC)
        ahead = aware.timestamp() - self._now_ns * NS
        if ahead <= 0:
            raise ParameterError(f"{name} = {date.isoformat()} lies before the latest window ({self.since})")
        return ahead * self._share / HOUR

    def dates(self, hours: Band) -> DateBand | NotAvailable:
        """The dates of a band of hours of operation."""
        if isinstance(self.running, NotAvailable):
            return self.running
        return DateBand(median=self.date(hours.median), p05=self.date(hours.p05), p95=self.date(hours.p95))

    def date(self, hours: float | None) -> str | None:
        """The date after so many hours of operation; None where it is not known, or more than a hundred years ahead."""
        if hours is None or not self._share or self._now_ns is None:
            return None
        ahead = hours * HOUR / self._share
        return None if ahead > RUNNING.furthest else iso_time(self._now_ns + round(ahead / NS))


def _phases(asked: WhatIfIn, life: Life, clock: _Clock) -> tuple[Phase, ...]:
    if asked.calendar is None:
        if asked.duty is None:
            return (Phase(points=(DutyPoint(speed=life.speed, torque=life.torque),)),)
        return (Phase(points=_points(asked.duty)),)
    phases, before = [], 0.0
    for i, one in enumerate(asked.calendar):
        name = f"calendar[{i}]"
        last = i == len(asked.calendar) - 1
        if last != (one.hours is None and one.until is None):
            raise ParameterError(
                f"{name}: the last phase of a calendar has no end" if last else f"{name}: needs `hours` or `until`"
            )
        if one.hours is not None and one.until is not None:
            raise ParameterError(f"{name}: give `hours` or `until`, not both")
        end = inf if last else before + (one.hours or 0.0)
        if one.until is not None:
            end = clock.running_hours(one.until, f"{name}.until")
        if end <= before:
            raise ParameterError(f"{name} ends before it begins")
        phases.append(Phase(points=_points(one.duty), duration=(end - before) * HOUR))
        before = end
    return tuple(phases)


def _points(duty: list[DutyPointIn]) -> tuple[DutyPoint, ...]:
    points = [p.share for p in duty]
    even = len(duty) > 1 and all(share == 1 for share in points)
    if even:
        raise ParameterError("a duty of several conditions needs their shares of the running time")
    return tuple(DutyPoint(speed=p.speed_hz, torque=p.torque_nm, share=p.share) for p in duty)


def _survival(found: DutyLife) -> Survival:
    known = [(time / HOUR, p) for time, p in found.survival if time < inf]
    return Survival(hours=[time for time, _ in known], probability=[p for _, p in known])


def _target(found: DutyLife, hours: float, until: datetime | None, clock: _Clock) -> Target:
    date = clock.date(hours) if until is None else until.isoformat()
    return Target(hours=hours, date=date, probability=found.probability, at_least=found.at_least)
