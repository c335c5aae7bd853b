"""The parts of an answer that are made of the assessment: their names in the contract, and what is put into words."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from service.contract.shape import NAMES, Made, Said, made_of
from twin import assessment
from twin.assessment.key import GIVEN

# -- values ------------------------------------------------------------------------------------------------


@made_of(assessment.Unavailable)
class NotAvailable(Made):
    """Takes the place of a part that cannot be computed from what is known."""

    status: Annotated[Literal["not available"], Said(lambda missing: "not available")]


@made_of(assessment.Interval)
class Band(Made):
    """Median and 5–95 % interval."""


@made_of(assessment.ParameterValue)
class Figure(Made):
    """One parameter of an effect."""


# -- residual, effects, and what is unexplained ------------------------------------------------------------

MILLION = 1e6  # revolutions that a rate is given over
CURVES = {"frequency": "frequency_hz"}  # keys of curves that say their unit
NAMES[assessment.SpectralLine] = "Line"


@made_of(assessment.HeldOutErrors)
class Errors(Made):
    """Errors on windows that took no part in fitting; null where there were none."""


def _rate(growth: assessment.Growth) -> dict[str, Any] | None:
    """The rate over a million revolutions."""
    rate = growth.rate
    if rate is None:
        return None
    per = rate.unit.removesuffix("/rev")
    unit = "1/1e6 rev" if per == "1" else f"{per}/1e6 rev"
    return {"value": rate.value * MILLION, "unit": unit, "std": rate.std * MILLION}


@made_of(assessment.Growth)
class Growth(Made):
    """How the size of an effect has gone on after its onset, where it is not constant."""

    rate_per_million_revolutions: Annotated[Figure | None, Said(_rate, shown=GIVEN)] = Field(
        default=None,
        description="of a size that grows evenly: mean since the onset, per 1e6 revolutions of the pinion",
    )


def _label(effect: assessment.EffectAssessment) -> str | None:
    from twin.effects.channel_faults import label_of  # loads half of the twin, which a start does without

    return label_of(effect.name)


def _curves(effect: assessment.EffectAssessment) -> dict[str, list[float]]:
    return {CURVES.get(name, name): [float(value) for value in values] for name, values in effect.curves.items()}


@made_of(assessment.EffectAssessment)
class Effect(Made):
    """An effect that the model lacked and that was added, or a change against a healthy baseline."""

    label: Annotated[str | None, Said(_label, after="name", shown=GIVEN)] = Field(
        default=None, description="for people; absent where the effect is none of the table"
    )
    curves: Annotated[
        dict[str, list[float | None]] | None, Said(_curves, shown=lambda effect: effect.status is None)
    ] = Field(default=None, description="to be drawn")


@made_of(assessment.Residual)
class Residual(Made):
    """What the twin does not explain, over the latest windows."""


@made_of(assessment.Unexplained)
class Unexplained(Made):
    """What the model with its effects does not explain."""
