"""What every model of the contract is made of: strict JSON, units, and what stands for a missing quantity.

Models describe the REST answers in OpenAPI; those of the twin's assessment are made in shape.py. A key that is not set
is left out; a value that is not finite is null.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

from pydantic import BaseModel, ConfigDict

from service.json_text import plain
from twin.assessment.key import HOUR


class AnswerModel(BaseModel):
    """What an answer is described by: made ready when it is first used, not when the service starts."""

    model_config = ConfigDict(defer_build=True)


class ContractModel(AnswerModel):
    """A part of the contract: all of its keys are declared."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    def as_json(self) -> dict[str, Any]:
        """The part as strict JSON data, without the keys that were not set."""
        return plain(self.model_dump(mode="python", by_alias=True, exclude_unset=True))


def not_available(reason: str) -> dict[str, Any]:
    """What takes the place of a quantity that cannot be given, as JSON data."""
    return {"status": "not available", "reason": reason}


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
