"""The parts of an answer that are made of the assessment: their names in the contract, and what is put into words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from service.contract.base import AnswerModel, ContractModel, in_unit, not_available
from service.contract.shape import Made, Said, converts, json_of, made_of
from twin import assessment
from twin.assessment.key import GIVEN, HOUR, MICROMETRE, MILLIMETRE

# -- values ------------------------------------------------------------------------------------------------


@made_of(assessment.Unavailable)
class NotAvailable(Made):
    """Takes the place of a part that cannot be computed from what is known."""

    status: Annotated[Literal["not available"], Said(lambda missing: "not available")]


@made_of(assessment.Interval)
class Band(Made): ...


@made_of(assessment.ParameterValue)
class Figure(Made): ...


# -- residual, effects, and what is unexplained ------------------------------------------------------------

MILLION = 1e6  # revolutions that a rate is given over
CURVES = {"frequency": "frequency_hz"}  # keys of curves that say their unit


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
    label: Annotated[str | None, Said(_label, after="name", shown=GIVEN)] = Field(
        default=None, description="for people; absent where the effect is none of the table"
    )
    curves: Annotated[
        dict[str, list[float | None]] | None, Said(_curves, shown=lambda effect: effect.status is None)
    ] = Field(default=None, description="to be drawn")


@made_of(assessment.Residual)
class Residual(Made): ...


@made_of(assessment.Unexplained)
class Unexplained(Made): ...


# -- what the effects rest on ------------------------------------------------------------------------------


@made_of(assessment.Attribution)
class Tracing(Made): ...


# -- comparison with a healthy baseline --------------------------------------------------------------------


@made_of(assessment.RawLimit)
class RawLimit(Made):
    exceeded: Annotated[bool, Said(lambda limit: bool(limit.exceeded))]


@made_of(assessment.BaselineAssessment)
class Baseline(Made): ...


class AssetBaseline(AnswerModel):
    """The healthy baseline of an asset."""

    own: bool = Field(description="false where the asset has none of its own, and that of the settings may hold")
    by: str | None = None
    note: str | None = None
    at: str | None = Field(None, description="when it came into use, ISO 8601")
    windows: list[int] | None = Field(None, description="windows of the asset that it was learned from")
    added: bool | None = Field(None, description="whether recordings of an earlier baseline take part, too")
    baseline: Baseline | None = Field(None, description="what it was learned from, and what it suffices for")


# -- what is known without a model, and what could have been found ----------------------------------------

CAUSES = {
    1: "run-out or eccentricity of the {shaft}, a bent shaft, or a load that varies once per turn of the {shaft}",
    2: "an out-of-round {shaft}, misalignment of its coupling, or a load that varies twice per turn of the {shaft}",
    3: "a form error of the {shaft} with three waves, or a load that varies three times per turn of the {shaft}",
}

AMPLITUDE, PHASE = 0.8, 0.2  # share of amplitude modulation from which, or up to which, it is called by one name alone


def causes_of(shaft: str, multiple: int) -> str:
    """What can modulate the mesh vibration so many times per turn of a shaft."""
    return CAUSES[multiple].format(shaft=shaft)


def _kind_of(found: assessment.Modulation) -> str:
    share = found.amplitude_share
    return "amplitude" if share > AMPLITUDE else "phase" if share < PHASE else "amplitude and phase"


@made_of(assessment.Modulation)
class Modulation(Made):
    channel: Annotated[str, Said(lambda found: f"accel/{found.sensor}")]
    kind: Annotated[str, Said(_kind_of, after="depth_std_percent")] = Field(
        description="amplitude, phase, or amplitude and phase"
    )
    possible_causes: Annotated[str, Said(lambda found: causes_of(found.shaft, found.multiple), after="kind")] = Field(
        description="which the accelerometers cannot distinguish"
    )


def _detectable(found: assessment.Detectable) -> list[str]:
    """What could have been found in words."""
    alarms = found.false_alarms
    return [
        f"What {found.windows} windows would have shown, where nothing was found:",
        *map(_size, found.sizes),
        alarms.reason if isinstance(alarms, assessment.Unavailable) else _alarms(alarms),
    ]


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


@made_of(assessment.Detectable)
class Detectable(Made):
    said: Annotated[list[str], Said(_detectable, after="false_alarms")] = Field(
        default=[], description="the same in words, a heading first, as every view prints it"
    )


# -- wear and remaining life -------------------------------------------------------------------------------

UNKNOWN_AGE = "the age of the gears is not known: the depth is at least what has worn since the first window"


def contradiction(compared: assessment.InspectedDepth) -> str:
    """One inspection that contradicts the windows, as a sentence."""
    windows = compared.by_windows
    flank = "both flanks together" if compared.flank == "combined" else f"the {compared.flank}"
    median = 0.0 if windows.median is None else windows.median / MICROMETRE
    high = median if windows.p95 is None else windows.p95 / MICROMETRE
    return (
        f"The inspection at {compared.revolutions:,.0f} revolutions ({compared.depth / MICROMETRE:.1f} ± "
        f"{compared.std / MICROMETRE:.1f} µm on {flank}) contradicts the windows, which give {median:.1f} µm "
        f"({windows.p05 / MICROMETRE:.1f}–{high:.1f} µm) there: they differ by {abs(compared.difference_in_std):.1f} "
        "standard deviations. Either an effect that the twin lacks shifts its depths, or the inspection is of another "
        "tooth, flank or count. Both are kept, and the band covers both."
    )


@made_of(assessment.InspectionResult)
class Inspections(Made):
    contradictions: Annotated[
        list[str],
        Said(lambda found: [contradiction(c) for c in found.compared if c.contradicts], after="windows_wrong_percent"),
    ] = Field(description="one sentence for each inspection that contradicts the windows")


@made_of(assessment.Preliminary)
class Preliminary(Made): ...


@made_of(assessment.RelationOrigin)
class Relation(Made): ...


@made_of(assessment.LevelReading)
class LevelReading(Made): ...


class Depths(ContractModel):
    """Largest depth along the profile, by flank [µm]."""

    combined: Band | NotAvailable
    pinion: Band | NotAvailable
    gear: Band | NotAvailable


def _reason(wear: assessment.Wear) -> str | None:
    return UNKNOWN_AGE if wear.depth["combined"].median is None else None


@made_of(assessment.Wear)
class Wear(Made):
    """Wear now, by the model of the machine or by a relation of level and depth."""

    max_depth_um: Depths
    relation: Relation | None = None
    levels: dict[str, LevelReading] | None = None
    reason: Annotated[str | None, Said(_reason, after="validity")] = Field(
        default=None, description="why no upper bound of the depth is known, or the lower one is zero"
    )


@converts(assessment.LevelWear)
def _wear_by_level(wear: assessment.LevelWear) -> dict[str, Any]:
    """The keys of `Wear` for a machine without a model."""
    missing = not_available(wear.flank_reason)
    return {
        "k_wear_per_n": None,
        "specific_wear_rate_m2_per_n": None,
        "max_depth_um": {"combined": json_of(wear.depth, MICROMETRE), "pinion": missing, "gear": missing},
        "profile": None,
        "method": "level",
        "relation": json_of(wear.relation),
        "levels": {name: json_of(reading) for name, reading in wear.levels.items()},
        "reason": wear.reason,
        "preliminary": None,
    }


class LifeDistribution(ContractModel):
    """Quantiles of a remaining life: with each probability, no more than this is left."""

    probability: list[float]
    revolutions: list[float | None] = Field(description="null where no bound is known")
    hours: list[float | None]


def _distribution(life: assessment.Life) -> dict[str, Any]:
    left = [None if revolutions is None else float(revolutions) for _, revolutions in life.distribution]
    return {
        "probability": [float(probability) for probability, _ in life.distribution],
        "revolutions": left,
        "hours": [in_unit(revolutions, HOUR * life.speed) for revolutions in left],
    }


@made_of(assessment.Life)
class Rul(Made):
    distribution: Annotated[
        LifeDistribution | None, Said(_distribution, after="reason", shown=lambda life: bool(life.distribution))
    ] = Field(default=None, description="the life as a distribution")
    of_wear_alone: bool | None = Field(
        default=None, description="true where damage of another kind is found, which the life does not count"
    )


# -- encoders alone ----------------------------------------------------------------------------------------


@made_of(assessment.EncoderPair)
class EncoderPair(Made): ...


def with_assumed_radii(section: Mapping[str, Any], radii: tuple[float, float]) -> dict[str, Any]:
    """The section `pair` with run-out in µm on assumed base radii [m] of pinion and gear.

    Where nothing else states a ratio, that of the radii is compared with the measured one.
    """
    ratio = section["ratio"]
    run_out = []
    for term in section["run_out"]:
        length = radii[1] / ratio["value"] if term["shaft"] == "gear" else radii[0]  # 1 µrad · 1 m = 1 µm
        run_out.append(term | {"amplitude_um": term["amplitude_urad"] * length, "std_um": term["std_urad"] * length})
    stated = section["stated"]
    if stated is None:
        from twin.encoder_pair.assessing import stated_ratio  # loads a part of the twin, which a start does without

        source = f"assumed base radii {radii[1] / MILLIMETRE:g}/{radii[0] / MILLIMETRE:g} mm"
        stated = json_of(stated_ratio(radii[1] / radii[0], source, ratio["value"], ratio["std"]))
    known = json_of(assessment.BaseRadii(pinion=radii[0], gear=radii[1], assumed=True))
    return {**section, "run_out": run_out, "base_radii": known, "stated": stated}
