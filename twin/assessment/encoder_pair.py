"""What two encoders alone say of a pair."""

from __future__ import annotations

from dataclasses import dataclass

from twin.assessment.values import ParameterValue


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedRatio:
    """A stated ratio compared with the measured one."""

    ratio: float
    source: str
    deviations: float  # standard deviations between the two
    contradicted: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOut:
    """What comes once, or so many times, a turn of one wheel."""

    shaft: str
    multiple: int
    amplitude: float  # as an angle of the pinion [rad]
    std: float  # [rad]
    indistinguishable_from: tuple[str, ...]
    length: float | None = None  # on the wheel's base radius [m]
    length_std: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MissedCount:
    """A sharp step that no wheel repeats."""

    time: float  # in the window [s]
    pinion_turns: float
    counts: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SharpStep:
    """A sharp step that a wheel repeats, or that was passed once only."""

    time: float  # [s]
    pinion_turns: float
    counts: float
    shaft: str | None
    turn: float | None
    times: int
    ratio_if_missed: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PairCurve:
    """Transmission error of a pair over the pinion's turns, before and after run-out is taken out; (n,) each."""

    pinion_turns: tuple[float, ...]
    before: tuple[float, ...]  # as an angle of the pinion [rad]
    after: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PairSpeeds:
    """Speed of either shaft against time; (n,) each."""

    time: tuple[float, ...]  # [s]
    pinion: tuple[float, ...]  # [Hz]
    gear: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseRadii:
    """Base radii that angles were converted to lengths with [m]."""

    pinion: float
    gear: float
    assumed: bool  # whether the rig file does not give them


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderPair:
    """What two encoders alone say of a pair."""

    window: int
    ratio: ParameterValue  # turns of the pinion for one of the gear
    tooth_counts: tuple[str, ...]  # gear/pinion, within two standard deviations
    stated: StatedRatio | None
    turns: tuple[float, float]  # covered, of pinion and gear
    speed_mean: float  # of the pinion [Hz]
    speed_highest: float  # [Hz]
    run_out: tuple[RunOut, ...]
    base_radii: BaseRadii | None
    rest_before: float  # rms of the transmission error, as an angle of the pinion [rad]
    rest_after: float  # the same after run-out is taken out [rad]
    missed_counts: tuple[MissedCount, ...]
    sharp_steps: tuple[SharpStep, ...]
    transmission_error: PairCurve
    speed: PairSpeeds
