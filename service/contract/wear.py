"""`wear` and `rul`: wear and remaining life now."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field

from service.contract.base import ContractModel, in_unit, iso_time, not_available
from service.contract.inspections import Inspections
from service.contract.parts import Band, NotAvailable
from service.contract.window import Methods
from twin.assessment.key import DEGREE, HOUR, MICROMETRE, MILLIMETRE

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment


UNKNOWN_AGE = "the age of the gears is not known: the depth is at least what has worn since the first window"


class Depths(ContractModel):
    """Largest depth along the profile, by flank [µm]."""

    combined: Band | NotAvailable
    pinion: Band | NotAvailable
    gear: Band | NotAvailable


class FlankProfile(ContractModel):
    """Depth along one flank."""

    radius_mm: list[float]
    roll_angle_deg: list[float]
    depth_um: list[float]

    @classmethod
    def of(cls, flank: assessment.FlankProfile) -> FlankProfile:
        return cls(
            radius_mm=[r / MILLIMETRE for r in flank.radius],
            roll_angle_deg=[a / DEGREE for a in flank.roll_angle],
            depth_um=[d / MICROMETRE for d in flank.depth],
        )


class Profile(ContractModel):
    """Depth along both flanks, over the nominal path of contact."""

    path_position_mm: list[float] = Field(description="from the pitch point")
    pinion: FlankProfile
    gear: FlankProfile

    @classmethod
    def of(cls, profile: assessment.WearProfile) -> Profile:
        return cls(
            path_position_mm=[s / MILLIMETRE for s in profile.path_position],
            pinion=FlankProfile.of(profile.pinion),
            gear=FlankProfile.of(profile.gear),
        )


class Validity(ContractModel):
    """The depths up to which the model holds."""

    contact_loss_from_um: float | None = Field(description="depth from which the teeth lose contact")
    steady_state_to_um: float | None = Field(description="depth up to which a steady state is known")
    valid: bool = Field(description="whether the present depth is below both")


class LevelReading(ContractModel):
    """The latest level under one operating condition."""

    level: float | None = Field(description="RMS [m/s²]")
    window: int


class Relation(ContractModel):
    """What a relation of level and depth was learned from."""

    asset: str | None
    curve: str = Field(description="what gives the level by depth: `model`, or `monotone cubic` through the cases")
    causes: list[str]
    sensor: str | None
    band_hz: list[float] | None
    note: str | None = Field(description="what the relation does not state")


class EstablishedBefore(ContractModel):
    """What earlier windows of the same gears had established."""

    windows: int = Field(description="worn windows with an established depth")
    revolutions: float = Field(description="of the pinion at the latest of them")
    max_depth_um: float = Field(description="depth there")


class Preliminary(ContractModel):
    """Why a figure is not established: its band is wider, and it raises no alarm unless earlier windows support it."""

    reasons: list[str] = Field(description="one sentence each, with figures")
    remedies: list[str] = Field(description="measurements that would settle it")
    established_before: EstablishedBefore | None = Field(
        default=None, description="where earlier windows support the figure, so that it raises alarms all the same"
    )

    @classmethod
    def of(cls, preliminary: assessment.Preliminary) -> Preliminary:
        before = preliminary.before
        return cls(
            reasons=list(preliminary.reasons),
            remedies=list(preliminary.remedies),
            established_before=None
            if before is None
            else EstablishedBefore(
                windows=before.windows, revolutions=before.revolutions, max_depth_um=before.depth / MICROMETRE
            ),
        )


def preliminary_of(value: assessment.Preliminary | None) -> Preliminary | None:
    return None if value is None else Preliminary.of(value)


class WearGrowth(ContractModel):
    """What the combined depth has grown by since the first window that measured it."""

    since_revolutions: float = Field(description="of the pinion at that window")
    windows: int = Field(description="that have measured the depth")
    max_depth_um: Band = Field(description="growth of the combined depth [µm]")

    @classmethod
    def of(cls, growth: assessment.WearGrowth) -> WearGrowth:
        return cls(
            since_revolutions=growth.since_revolutions,
            windows=growth.windows,
            max_depth_um=Band.of(growth.depth, MICROMETRE),
        )


class RateChange(ContractModel):
    """A change of the wear rate by more than a factor of three."""

    factor: float = Field(description="rate since the change over the rate before")
    revolutions: float = Field(description="of the pinion at the change")
    windows: int = Field(description="after it")


class Wear(ContractModel):
    """Wear now, by the model of the machine or by a relation of level and depth."""

    k_wear_per_n: float | None = Field(description="Archard coefficient K [1/N]")
    specific_wear_rate_m2_per_n: float | None = Field(description="dimensional coefficient k [m²/N]")
    max_depth_um: Depths
    profile: Profile | None = Field(description="depth along both flanks; null where only a growth is known")
    method: str = Field(description="what set the depth")
    dwell_time_s: float | None = None
    dwell_time_at_hz: float | None = None
    methods: Methods | None = Field(default=None, description="both methods of updating, side by side")
    validity: Validity | None = None
    relation: Relation | None = None
    levels: dict[str, LevelReading] | None = None
    reason: str | None = Field(
        default=None, description="why no upper bound of the depth is known, or the lower one is zero"
    )
    preliminary: Preliminary | None = Field(default=None, description="null where the depth is established")
    growth: WearGrowth | None = Field(
        default=None, description="since the first window, where no window has seen the gears new"
    )
    inspections: Inspections | None = Field(default=None, description="measured depths that are part of the estimate")
    rate_change: RateChange | None = Field(
        default=None, description="absent where the wear rate has not changed by more than a factor of three"
    )

    @classmethod
    def of(cls, wear: assessment.Wear | assessment.LevelWear) -> Wear:
        from twin.assessment import LevelWear  # loads the types of the twin, which a start does without

        return cls._of_level(wear) if isinstance(wear, LevelWear) else cls._of_model(wear)

    @classmethod
    def _of_model(cls, wear: assessment.Wear) -> Wear:
        parts: dict[str, Any] = {} if wear.inspected is None else {"inspections": Inspections.of(wear.inspected)}
        parts |= {} if wear.growth is None else {"growth": WearGrowth.of(wear.growth)}
        if wear.rate_change is not None:
            own = wear.rate_change
            parts["rate_change"] = RateChange(factor=own.factor, revolutions=own.revolutions, windows=own.windows)
        return cls(
            k_wear_per_n=wear.wear_coefficient,
            dwell_time_s=wear.dwell_time,
            dwell_time_at_hz=wear.dwell_time_speed,
            specific_wear_rate_m2_per_n=wear.specific_wear_rate,
            max_depth_um=Depths(**{flank: Band.of(wear.depth[flank], MICROMETRE) for flank in Depths.model_fields}),
            profile=None if wear.profile is None else Profile.of(wear.profile),
            method=wear.method,
            validity=Validity(
                contact_loss_from_um=in_unit(wear.validity.contact_loss_from, MICROMETRE),
                steady_state_to_um=wear.validity.steady_state_to / MICROMETRE,
                valid=wear.validity.valid,
            ),
            methods=Methods.of(wear.methods),
            reason=None if wear.depth["combined"].median is not None else UNKNOWN_AGE,
            preliminary=preliminary_of(wear.preliminary),
            **parts,
        )

    @classmethod
    def _of_level(cls, wear: assessment.LevelWear) -> Wear:
        missing = NotAvailable.model_validate(not_available(wear.flank_reason))
        origin = wear.relation
        return cls(
            k_wear_per_n=None,
            specific_wear_rate_m2_per_n=None,
            max_depth_um=Depths(combined=Band.of(wear.depth, MICROMETRE), pinion=missing, gear=missing),
            profile=None,
            method="level",
            relation=Relation(
                asset=origin.asset,
                curve=origin.curve,
                causes=list(origin.causes),
                sensor=origin.sensor,
                band_hz=None if origin.band is None else list(origin.band),
                note=origin.note,
            ),
            levels={name: LevelReading(level=r.level, window=r.window) for name, r in wear.levels.items()},
            reason=wear.reason,
            preliminary=None,
        )


class LifeDistribution(ContractModel):
    """Quantiles of a remaining life: with each probability, no more than this is left."""

    probability: list[float]
    revolutions: list[float | None] = Field(description="null where no bound is known")
    hours: list[float | None]

    @classmethod
    def of(cls, life: assessment.Life) -> LifeDistribution:
        left = [revolutions for _, revolutions in life.distribution]
        return cls(
            probability=[p for p, _ in life.distribution],
            revolutions=left,
            hours=[in_unit(n, HOUR * life.speed) for n in left],
        )


class LifeDate(ContractModel):
    """When the remaining life ends, at a running time per day; null where no bound is known within a hundred years."""

    median: str | None = Field(description="ISO 8601, by the recordings' clock")
    p05: str | None
    p95: str | None
    since: str = Field(description="start of the window from which it is counted")
    hours_per_day: float
    source: str = Field(description="of the running time per day: `rig file` or `observed`")

    @classmethod
    def of(cls, date: assessment.LifeDate) -> LifeDate:
        median, p05, p95 = (
            None if time is None else iso_time(time) for time in (date.median_ns, date.p05_ns, date.p95_ns)
        )
        return cls(
            median=median, p05=p05, p95=p95, since=iso_time(date.since_ns), hours_per_day=24 * date.running_share,
            source=date.source,
        )  # fmt: skip


class Rul(ContractModel):
    """Remaining useful life at the present operating condition."""

    criterion: str
    max_depth_um: float = Field(description="depth at the end of life")
    reached: bool
    revolutions: Band
    hours: Band
    speed_hz: float
    torque_nm: float
    reason: str | None = Field(default=None, description="why only the lower bound is known")
    distribution: LifeDistribution | None = Field(default=None, description="the life as a distribution")
    date: LifeDate | NotAvailable | None = Field(default=None, description="when it ends")
    preliminary: Preliminary | None = Field(default=None, description="null where the life is established")
    of_wear_alone: bool | None = Field(
        default=None, description="true where damage of another kind is found, which the life does not count"
    )

    @classmethod
    def of(cls, life: assessment.Life) -> Rul:
        from twin.assessment import Unavailable

        parts: dict[str, Any] = {}
        if life.distribution:
            parts["distribution"] = LifeDistribution.of(life)
        if life.date is not None:
            date = life.date
            parts["date"] = NotAvailable.of(date) if isinstance(date, Unavailable) else LifeDate.of(date)
        return cls(
            criterion=life.criterion,
            max_depth_um=life.limit / MICROMETRE,
            reached=life.reached,
            revolutions=Band.of(life.revolutions),
            hours=Band.of(life.time, HOUR),
            speed_hz=life.speed,
            torque_nm=life.torque,
            reason=life.reason,
            preliminary=preliminary_of(life.preliminary),
            **parts,
        )


def part_of(value: Any, model: Any) -> dict[str, Any]:
    """A part of the answer as JSON data: by its model, or as not available."""
    from twin.assessment import Unavailable

    if isinstance(value, Unavailable):
        return NotAvailable.of(value).as_json()
    return model.of(value).as_json()
