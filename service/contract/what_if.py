"""What if: the remaining life under another duty, as it is asked for and answered."""

from __future__ import annotations

from datetime import UTC, datetime
from math import inf
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from service.contract.base import HOUR, MICROMETRE, Band, ContractModel, NotAvailable, in_unit, iso_time
from service.contract.wear import Preliminary, preliminary_of
from twin.assessment import Life, Unavailable
from twin.errors import NotAvailable as Missing
from twin.errors import ParameterError
from twin.rig import Rig
from twin.state import State
from twin.updating.running_time import HOURS_A_DAY, NS, RUNNING, running_share
from twin.what_if import DutyLife, DutyPoint, Phase, what_if

LONGEST = 1e7  # hours asked for, some thousand years
STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


class DutyPointIn(BaseModel):
    """One operating condition and its share of the running time."""

    model_config = STRICT

    speed_hz: float = Field(gt=0, le=2000, description="of the pinion")
    torque_nm: float = Field(gt=0, le=1e6, description="on the pinion's shaft")
    share: float = Field(1.0, gt=0, le=1, description="of the running time; the shares of a duty add up to 1")


class PhaseIn(BaseModel):
    """A duty from the end of the phase before until a time."""

    model_config = STRICT

    duty: list[DutyPointIn] = Field(min_length=1, max_length=20)
    hours: float | None = Field(None, gt=0, le=LONGEST, description="how long, in hours of operation")
    until: datetime | None = Field(None, description="or until this date")


class WhatIfIn(BaseModel):
    """What is asked for."""

    model_config = STRICT

    duty: list[DutyPointIn] | None = Field(
        None, min_length=1, max_length=20, description="operating conditions; left out: the present one"
    )
    calendar: list[PhaseIn] | None = Field(
        None,
        min_length=1,
        max_length=20,
        description="in place of `duty`: duties one after the other, the last without end",
    )
    until: datetime | None = Field(None, description="date whose probability of being reached is asked for")
    hours: float | None = Field(
        None, gt=0, le=LONGEST, description="or so many hours of operation from the latest window"
    )
    max_depth_um: float | None = Field(
        None, gt=0, le=1e5, description="depth to reach, below the end of life; left out: the end of life"
    )
    hours_per_day: float | None = Field(
        None, gt=0, le=24, description="running time per day; left out: the rig file's, or as observed"
    )

    @model_validator(mode="after")
    def _one_of_each(self) -> WhatIfIn:
        if self.duty is not None and self.calendar is not None:
            raise ValueError("give `duty` or `calendar`, not both")
        if self.until is not None and self.hours is not None:
            raise ValueError("give `until` or `hours`, not both")
        return self


class RunningTime(ContractModel):
    """The running time per day that dates are counted with."""

    hours_per_day: float
    source: str = Field(description="`request`, `rig file` or `observed`")


class DateBand(ContractModel):
    """Dates, ISO 8601 by the recordings' clock; null where no bound is known within a hundred years."""

    median: str | None
    p05: str | None
    p95: str | None


class DutyDistribution(ContractModel):
    """Quantiles: with each probability, no more than this is left."""

    probability: list[float]
    hours: list[float | None] = Field(description="of operation; null where no bound is known")
    revolutions: list[float | None]


class Survival(ContractModel):
    """The probability that the life is longer than so many hours of operation."""

    hours: list[float]
    probability: list[float]


class Target(ContractModel):
    """A time that was asked for."""

    hours: float = Field(description="of operation from the latest window")
    date: str | None
    probability: float | None = Field(description="that the end of life is not reached before; null where not known")
    at_least: bool = Field(description="whether the probability is a lower bound")


class WhatIf(ContractModel):
    """The remaining life under a duty."""

    asset: str
    since: str | None = Field(description="start of the latest window, from which all times are counted")
    criterion: str
    max_depth_um: float = Field(description="depth to which the life is stated: the end of life, or what was asked for")
    reached: bool
    hours: Band = Field(description="of operation")
    revolutions: Band
    date: DateBand | NotAvailable
    running: RunningTime | NotAvailable
    distribution: DutyDistribution
    survival: Survival
    target: Target | None
    present_hours: Band = Field(description="at the present operating condition, as `rul.hours`")
    preliminary: Preliminary | None
    notes: list[str] = Field(description="where the duty leaves what wear has been seen under")
    reason: str | None = Field(description="why only a lower bound is known")


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
        Band(median=q[0.5], p05=q[0.05], p95=q[0.95])
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
        preliminary=preliminary_of(found.preliminary),
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
            else NotAvailable(status="not available", reason=self._missing)
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
