"""Wear and remaining life."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from twin.assessment.key import (
    DEGREE,
    GIVEN,
    HIDDEN,
    HOUR,
    ISO_TIME,
    MICROMETRE,
    MILLIMETRE,
    OPTIONAL,
    PERCENT,
    Key,
)
from twin.assessment.values import Interval, Unavailable
from twin.assessment.window import MethodEstimates
from twin.serial import Numbers

_given = partial(Key, shown=GIVEN)
_also_given = partial(Key, shown=OPTIONAL)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlankProfile:
    """Depth along one flank."""

    radius: Annotated[Numbers, Key("radius_mm", MILLIMETRE)]  # (n,), as all of them
    roll_angle: Annotated[Numbers, Key("roll_angle_deg", DEGREE)]
    depth: Annotated[Numbers, Key("depth_um", MICROMETRE)]


@dataclass(frozen=True, slots=True, kw_only=True)
class WearProfile:
    """Depth along both flanks, over the nominal path of contact."""

    path_position: Annotated[Numbers, Key("path_position_mm", MILLIMETRE, "from the pitch point")]
    pinion: FlankProfile
    gear: FlankProfile


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelValidity:
    """The depths up to which the model holds."""

    contact_loss_from: Annotated[
        float | None, Key("contact_loss_from_um", MICROMETRE, "depth from which the teeth lose contact")
    ]
    steady_state_to: Annotated[
        float, Key("steady_state_to_um", MICROMETRE, "depth up to which a steady state is known", null=True)
    ]
    valid: Annotated[bool, Key(meaning="whether the present depth is below both")]


@dataclass(frozen=True, slots=True, kw_only=True)
class EstablishedBefore:
    """What earlier windows of the same gears had established."""

    windows: Annotated[int, Key(meaning="worn windows with an established depth")]
    revolutions: Annotated[float, Key(meaning="of the pinion at the latest of them")]
    depth: Annotated[float, Key("max_depth_um", MICROMETRE, "depth there")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Preliminary:
    """Why a figure is not established: its band is wider, and it raises no alarm unless earlier windows support it."""

    reasons: Annotated[tuple[str, ...], Key(meaning="one sentence each, with figures")]
    remedies: Annotated[tuple[str, ...], Key(meaning="measurements that would settle it")]
    before: Annotated[
        EstablishedBefore | None,
        _also_given(
            "established_before",
            meaning="where earlier windows support the figure, so that it raises alarms all the same",
        ),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectedDepth:
    """A measured depth, and what the windows alone say of it."""

    revolutions: float
    flank: str
    depth: Annotated[float, Key("max_depth_um", MICROMETRE)]
    std: Annotated[float, Key("std_um", MICROMETRE, "of the measurement")]
    by_windows: Annotated[Interval, Key("by_windows_um", MICROMETRE, "of the same flank at the same revolutions")]
    difference_in_std: Annotated[float, Key(meaning="windows less inspection, in joint standard deviations")]
    contradicts: Annotated[bool, Key(meaning="whether they differ by more than their uncertainties allow")]


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionResult:
    """Inspections that are part of the estimate."""

    depth_by_windows: Annotated[
        Interval, Key("depth_by_windows_um", MICROMETRE, "combined depth now, without the inspections")
    ]
    coefficient_by_windows: Annotated[
        float, Key("k_by_windows_per_n", meaning="Archard coefficient K without the inspections [1/N]", null=True)
    ]
    windows_wrong: Annotated[
        float,
        Key(
            "windows_wrong_percent",
            PERCENT,
            "probability that the windows' depths are off by more than their band says",
        ),
    ]
    compared: tuple[InspectedDepth, ...]  # in the order of their revolutions
    depth_preliminary: Annotated[Preliminary | None, HIDDEN] = None  # as without inspections
    life_preliminary: Annotated[Preliminary | None, HIDDEN] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class WearGrowth:
    """What the combined depth has grown by since the first window that measured it."""

    since_revolutions: Annotated[float, Key(meaning="of the pinion at that window")]
    windows: Annotated[int, Key(meaning="that have measured the depth")]
    depth: Annotated[Interval, Key("max_depth_um", MICROMETRE, "growth of the combined depth [µm]")]
    by_model: Annotated[Interval | None, HIDDEN] = None  # without regard to what is not known, and inspections settle


@dataclass(frozen=True, slots=True, kw_only=True)
class RateChange:
    """A change of the wear rate by more than a factor of three."""

    factor: Annotated[float, Key(meaning="rate since the change over the rate before")]
    revolutions: Annotated[float, Key(meaning="of the pinion at the change")]
    windows: Annotated[int, Key(meaning="after it")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wear:
    """Wear by the model of the machine."""

    wear_coefficient: Annotated[float, Key("k_wear_per_n", meaning="Archard coefficient K [1/N]", null=True)]
    specific_wear_rate: Annotated[
        float, Key("specific_wear_rate_m2_per_n", meaning="dimensional coefficient k [m²/N]", null=True)
    ]
    depth: Annotated[Mapping[str, Interval], Key("max_depth_um", MICROMETRE)]  # by flank: combined, pinion, gear
    profile: Annotated[WearProfile | None, Key(meaning="depth along both flanks; null where only a growth is known")]
    method: Annotated[str, Key(meaning="what set the depth")]
    dwell_time: Annotated[float, _also_given("dwell_time_s", meaning="of the contact at the rig file's speed")]
    dwell_time_speed: Annotated[float, _also_given("dwell_time_at_hz", meaning="that speed")]
    methods: Annotated[MethodEstimates, _also_given(meaning="both methods of updating, side by side")]
    validity: Annotated[ModelValidity, _also_given()]
    preliminary: Annotated[Preliminary | None, _also_given(meaning="null where the depth is established")] = None
    growth: Annotated[
        WearGrowth | None, _given(meaning="since the first window, where no window has seen the gears new")
    ] = None
    inspected: Annotated[
        InspectionResult | None, _given("inspections", meaning="measured depths that are part of the estimate")
    ] = None
    rate_change: Annotated[
        RateChange | None,
        _given(meaning="absent where the wear rate has not changed by more than a factor of three"),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelReading:
    """The latest level under one operating condition."""

    level: Annotated[float, Key(meaning="RMS [m/s²]", null=True)]
    window: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RelationOrigin:
    """What a relation of level and depth was learned from."""

    asset: str | None
    curve: Annotated[str, Key(meaning="what gives the level by depth: `model`, or `monotone cubic` through the cases")]
    causes: tuple[str, ...]
    sensor: str | None
    band: Annotated[tuple[float, float] | None, Key("band_hz", meaning="of the level")]
    note: Annotated[str | None, Key(meaning="what the relation does not state")]


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
    """When the remaining life ends, at a running time per day; null where no bound is known within a hundred years."""

    median_ns: Annotated[int | None, Key("median", ISO_TIME, "ISO 8601, by the recordings' clock")]
    p05_ns: Annotated[int | None, Key("p05", ISO_TIME)]
    p95_ns: Annotated[int | None, Key("p95", ISO_TIME)]
    since_ns: Annotated[int, Key("since", ISO_TIME, "start of the window from which it is counted")]
    running_share: Annotated[float, HIDDEN]  # of the time
    source: Annotated[str, Key(meaning="of the running time per day: `rig file` or `observed`")]

    @property
    def hours_per_day(self) -> Annotated[float, Key(after="since")]:
        """The running time of a day [h]."""
        return 24 * self.running_share


@dataclass(frozen=True, slots=True, kw_only=True)
class Life:
    """Remaining useful life at the present operating condition."""

    criterion: str
    limit: Annotated[float, Key("max_depth_um", MICROMETRE, "depth at the end of life")]
    reached: bool
    revolutions: Interval  # of the pinion, left
    time: Annotated[Interval, Key("hours", HOUR)]  # left
    speed: Annotated[float, Key("speed_hz")]  # of the condition
    torque: Annotated[float, Key("torque_nm")]
    reason: Annotated[str | None, _also_given(meaning="why only the lower bound is known")] = None
    distribution: Annotated[tuple[tuple[float, float | None], ...], HIDDEN] = ()  # probability, revolutions at most
    date: Annotated[LifeDate | Unavailable | None, _given(meaning="when it ends")] = None
    preliminary: Annotated[Preliminary | None, _also_given(meaning="null where the life is established")] = None
