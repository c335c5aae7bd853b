"""What if: the remaining life under another duty, as it is asked for and answered."""

from __future__ import annotations

from datetime import datetime

from pydantic import BaseModel, ConfigDict, Field, model_validator

from service.contract.base import ContractModel
from service.contract.parts import Band, NotAvailable, Preliminary

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
