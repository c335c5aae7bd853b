"""Wear and remaining life."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from twin.assessment.values import Interval, Unavailable
from twin.assessment.window import MethodEstimates
from twin.serial import Numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class FlankProfile:
    """Depth along one flank; (n,) each."""

    radius: Numbers  # [m]
    roll_angle: Numbers  # [rad]
    depth: Numbers  # [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class WearProfile:
    """Depth of both flanks along the nominal path of contact."""

    path_position: Numbers  # from the pitch point (n,) [m]
    pinion: FlankProfile
    gear: FlankProfile


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelValidity:
    """The depths up to which the model holds."""

    contact_loss_from: float | None  # depth from which the teeth lose contact [m]
    steady_state_to: float  # depth up to which a steady state is known [m]
    valid: bool  # whether the present depth is below both


@dataclass(frozen=True, slots=True, kw_only=True)
class EstablishedBefore:
    """What earlier windows of the same gears had established."""

    windows: int  # worn windows with an established depth
    revolutions: float  # of the pinion at the latest of them
    depth: float  # there [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class Preliminary:
    """Why a figure is not established yet, and what would make it so."""

    reasons: tuple[str, ...]  # one sentence each, with figures
    remedies: tuple[str, ...]  # measurements that would settle it
    before: EstablishedBefore | None = None  # where earlier windows support the figure all the same


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectedDepth:
    """A measured depth and what the windows alone say of it."""

    revolutions: float
    flank: str
    depth: float  # [m]
    std: float  # of the measurement [m]
    by_windows: Interval  # of the same flank at the same count [m]
    difference_in_std: float  # windows less inspection, in joint standard deviations
    contradicts: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionResult:
    """What inspections were weighed against."""

    depth_by_windows: Interval  # combined, now [m]
    coefficient_by_windows: float  # K [1/N]
    windows_wrong: float  # probability that the windows' depths are off by more than they state
    compared: tuple[InspectedDepth, ...]  # in the order of their revolutions
    depth_preliminary: Preliminary | None = None  # as without inspections
    life_preliminary: Preliminary | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WearGrowth:
    """What the combined depth has grown by since the first window that measured it."""

    since_revolutions: float  # of the pinion at that window
    windows: int  # that have measured it
    depth: Interval  # [m]
    by_model: Interval | None = None  # depth without regard to what is not known of it, which inspections settle [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class RateChange:
    """A change of the wear rate that is surely larger than its limit."""

    factor: float  # rate since the change over the rate before
    revolutions: float  # of the pinion at the change
    windows: int  # after it


@dataclass(frozen=True, slots=True, kw_only=True)
class Wear:
    """Wear by the model of the machine."""

    wear_coefficient: float  # K [1/N]
    specific_wear_rate: float  # k [m²/N]
    dwell_time: float  # of the contact at the rig file's speed [s]
    dwell_time_speed: float  # that speed [Hz]
    depth: Mapping[str, Interval]  # largest, by flank: combined, pinion, gear [m]
    profile: WearProfile | None  # None where only a growth is known
    method: str  # what set the depth
    methods: MethodEstimates
    validity: ModelValidity
    preliminary: Preliminary | None = None  # None where the depth is established
    growth: WearGrowth | None = None  # where no window has seen the gears new
    inspected: InspectionResult | None = None  # where inspections are part of the estimate
    rate_change: RateChange | None = None  # None where the wear rate has not changed by a large factor


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelReading:
    """The latest level under one operating condition."""

    level: float  # RMS [m/s²]
    window: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RelationOrigin:
    """What a relation of level and depth was learned from."""

    asset: str | None
    curve: str  # what gives the level by depth: the model, or the cases alone
    causes: tuple[str, ...]
    sensor: str | None
    band: tuple[float, float] | None  # of the level [Hz]
    note: str | None  # what the relation does not state


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelWear:
    """Wear by a calibrated relation of level and depth, without a model of the machine."""

    depth: Interval  # combined [m]
    relation: RelationOrigin
    levels: Mapping[str, LevelReading]  # by operating condition
    reason: str | None  # why no upper bound is known, or the lower one is zero
    flank_reason: str  # why the depth of a single flank is not available


@dataclass(frozen=True, slots=True, kw_only=True)
class LifeDate:
    """When a remaining life ends; None where no bound is known, or it lies further ahead than a date is stated for."""

    since_ns: int  # start of the window from which it is counted [Unix ns]
    running_share: float  # of the time
    source: str  # of the running share: "rig file" or "observed"
    median_ns: int | None
    p05_ns: int | None
    p95_ns: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Life:
    """Remaining useful life at the present operating condition."""

    criterion: str
    limit: float  # depth at the end of life [m]
    reached: bool
    revolutions: Interval  # of the pinion, left
    time: Interval  # left [s]
    speed: float  # of the condition [Hz]
    torque: float  # [N·m]
    reason: str | None = None  # why only the lower bound of the life is known
    distribution: tuple[tuple[float, float | None], ...] = ()  # probability, revolutions left at most; None: no bound
    date: LifeDate | Unavailable | None = None
    preliminary: Preliminary | None = None  # None where the life is established
