"""What every model of the contract is made of: strict JSON, units, and what stands for a missing quantity.

Models are built from the twin's assessment (`Model.of(...)`) and describe the REST answers in OpenAPI; `as_json` gives
the answer itself. A key that a builder does not set is left out; a value that is not finite is null.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from math import pi
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.json_text import plain

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment

MICROMETRE = 1e-6  # [m]
MILLIMETRE = 1e-3  # [m]
MICRORADIAN = 1e-6  # [rad]
PERCENT = 0.01
HOUR = 3600.0  # [s]
DEGREE = pi / 180  # [rad]


class AnswerModel(BaseModel):
    """What an answer is described by: made ready when it is first used, not when the service starts."""

    model_config = ConfigDict(defer_build=True)


class ContractModel(AnswerModel):
    """A part of the contract: all of its keys are declared."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    def as_json(self) -> dict[str, Any]:
        """The part as strict JSON data, without the keys that were not set."""
        return plain(self.model_dump(mode="python", by_alias=True, exclude_unset=True))


class NotAvailable(ContractModel):
    """Takes the place of a part that cannot be computed from what is known."""

    status: Literal["not available"]
    reason: str

    @classmethod
    def of(cls, missing: assessment.Unavailable) -> NotAvailable:
        return cls(status="not available", reason=missing.reason)


class Band(ContractModel):
    """Median and 5–95 % interval."""

    median: float | None = Field(description="null where only a lower bound is known")
    p05: float | None
    p95: float | None = Field(description="null where no upper bound is known")

    @classmethod
    def of(cls, interval: assessment.Interval, unit: float = 1.0) -> Band:
        """The interval in multiples of `unit` (SI)."""
        return cls(
            median=in_unit(interval.median, unit), p05=interval.p05 / unit, p95=in_unit(interval.p95, unit)
        )  # fmt: skip


class Figure(ContractModel):
    """One parameter of an effect."""

    value: float | None
    unit: str
    std: float | None

    @classmethod
    def of(cls, parameter: assessment.ParameterValue) -> Figure:
        return cls(value=parameter.value, unit=parameter.unit, std=parameter.std)


def not_available(reason: str) -> dict[str, Any]:
    """What takes the place of a quantity that cannot be given, as JSON data."""
    return NotAvailable(status="not available", reason=reason).as_json()


def in_unit(value: float | None, unit: float) -> float | None:
    """A value of SI in multiples of `unit`; None stays None."""
    return None if value is None else value / unit


def iso_time(time_ns: int) -> str:
    """Unix time [ns] as ISO 8601 in UTC, to the nanosecond."""
    seconds, rest = divmod(time_ns, 1_000_000_000)
    return (datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)).strftime(f"%Y-%m-%dT%H:%M:%S.{rest:09d}Z")


def spoken_time(seconds: float) -> str:
    """A span of time [s] in the unit that people use for it: "26 min", "16 days"."""
    for size, unit in ((2 * 365.25 * 24 * HOUR, "years"), (90 * 24 * HOUR, "months"), (72 * HOUR, "days"), (HOUR, "h")):
        if seconds >= size:
            return f"{seconds / _SPAN[unit]:.2g} {unit}"
    return f"{seconds / 60:.2g} min" if seconds >= 60 else f"{seconds:.2g} s"


_SPAN = {"years": 365.25 * 24 * HOUR, "months": 30.44 * 24 * HOUR, "days": 24 * HOUR, "h": HOUR}
