"""`detectable`: what could have been found where nothing was, and how many false alarms a year has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from service.contract.base import ContractModel
from service.contract.parts import NotAvailable

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment


class SmallestSize(ContractModel):
    """The smallest size of an effect of the alarm class that the windows so far would have shown."""

    name: str = Field(description="of the effect")
    parameter: str = Field(description="what the size is of")
    unit: str
    value: float | None = Field(description="null where no size would have been found")
    basis: str = Field(description="what the figure rests on, or why there is none")


class FalseAlarms(ContractModel):
    """False alarms to be expected of a healthy machine in a year."""

    per_machine_year: float = Field(description="at most")
    rate: float = Field(description="share of the searches of healthy machines in which an effect may be reported")
    searches_per_year: float = Field(description="in the year to come, at the windows in a year so far")
    windows_per_year: float


class Detectable(ContractModel):
    """What could have been found: where nothing was, or where the verdict is `explained`."""

    windows: int = Field(description="measurement windows that were searched")
    effects: list[SmallestSize]
    false_alarms: FalseAlarms | NotAvailable
    said: list[str] = Field(default=[], description="the same in words, a heading first, as every view prints it")

    @classmethod
    def of(cls, found: assessment.Detectable) -> Detectable:
        from twin.assessment import Unavailable

        sizes, alarms = found.sizes, found.false_alarms
        return cls(
            windows=found.windows,
            effects=[
                SmallestSize(name=s.name, parameter=s.parameter, unit=s.unit, value=s.value, basis=s.basis)
                for s in sizes
            ],
            false_alarms=NotAvailable.of(alarms)
            if isinstance(alarms, Unavailable)
            else FalseAlarms(
                per_machine_year=alarms.expected, rate=alarms.rate, searches_per_year=alarms.searches,
                windows_per_year=alarms.windows,
            ),
            said=[
                f"What {found.windows} windows would have shown, where nothing was found:",
                *map(_size, sizes),
                alarms.reason if isinstance(alarms, Unavailable) else _alarms(alarms),
            ],
        )  # fmt: skip


def _size(one: assessment.SmallestSize) -> str:
    """One smallest size in words."""
    of = one.parameter.replace("_", " ")
    from_ = "nothing" if one.value is None else f"{of} from {one.value:.4g} {one.unit}".rstrip()
    return f"{one.name.replace('_', ' ')}: {from_} ({one.basis})"


def _alarms(found: assessment.FalseAlarms) -> str:
    """The false alarms of a year in words."""
    return (
        f"false alarms of a healthy machine: at most {found.expected:.4g} a year, by {found.searches:.0f} searches at "
        f"a rate of {100 * found.rate:g} %"
    )
