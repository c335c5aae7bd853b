"""What two encoders alone say of a pair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from twin.assessment.key import MICROMETRE, MICRORADIAN, MILLIMETRE, Key
from twin.assessment.values import ParameterValue


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedRatio:
    """A stated ratio compared with the measured one."""

    ratio: float
    source: str
    deviations: Annotated[float, Key(meaning="standard deviations between the two")]
    contradicted: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Turns:
    """Turns of either shaft in the window."""

    pinion: float
    gear: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PairSpeed:
    """Pinion speed [Hz]."""

    mean: Annotated[float, Key(meaning="from the first edge to the last")]
    highest: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOut:
    """Run-out of a wheel, or of its encoder's disc: one multiple of a turn."""

    shaft: str
    multiple: int
    amplitude: Annotated[float, Key("amplitude_urad", MICRORADIAN, "as an angle of the pinion")]
    std: Annotated[float, Key("std_urad", MICRORADIAN)]
    length: Annotated[
        float | None, Key("amplitude_um", MICROMETRE, "on the base radius of its wheel; null without base radii")
    ] = None
    length_std: Annotated[float | None, Key("std_um", MICROMETRE)] = None
    indistinguishable_from: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseRadii:
    """Base radii that angles were converted with."""

    pinion: Annotated[float, Key("pinion_mm", MILLIMETRE)]
    gear: Annotated[float, Key("gear_mm", MILLIMETRE)]
    assumed: Annotated[bool, Key(meaning="whether the rig file does not give them")]


@dataclass(frozen=True, slots=True, kw_only=True)
class PairRemainder:
    """RMS of the transmission error before and after run-out is subtracted, as an angle of the pinion."""

    before: float
    after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MissedCount:
    """A count that was missed: a step that neither wheel repeats."""

    time: Annotated[float, Key("time_s")]  # in the window
    pinion_turns: float
    counts: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SharpStep:
    """A step that a wheel repeats, or whose angle was passed only once."""

    time: Annotated[float, Key("time_s")]
    pinion_turns: float
    counts: float
    shaft: str | None
    turn: float | None
    times: int
    ratio_if_missed: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PairCurve:
    """Transmission error over the pinion's turns, before and after run-out is subtracted."""

    pinion_turns: Annotated[tuple[float, ...], Key(digits=4)]  # (n,), as all of them
    before: Annotated[tuple[float, ...], Key("before_urad", MICRORADIAN, digits=1)]
    after: Annotated[tuple[float, ...], Key("after_urad", MICRORADIAN, digits=1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class PairSpeeds:
    """Speed of either shaft against time."""

    time: Annotated[tuple[float, ...], Key("time_s", digits=4)]  # (n,), as all of them
    pinion: Annotated[tuple[float, ...], Key("pinion_hz", digits=5)]
    gear: Annotated[tuple[float, ...], Key("gear_hz", digits=5)]


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderPair:
    """What two encoders say of a pair: ratio, run-out, missed counts."""

    window: Annotated[int, Key(meaning="index of the window that it is of")]
    ratio: Annotated[ParameterValue, Key(meaning="turns of the pinion for one of the gear")]
    tooth_counts: Annotated[
        tuple[str, ...], Key("teeth_that_fit", meaning="tooth counts gear/pinion within two standard deviations")
    ]
    stated: StatedRatio | None
    turns: Turns
    pinion_speed: Annotated[PairSpeed, Key("speed_hz")]
    run_out: tuple[RunOut, ...]
    base_radii: BaseRadii | None
    rest: Annotated[PairRemainder, Key("rest_urad", MICRORADIAN)]
    missed_counts: tuple[MissedCount, ...]
    sharp_steps: tuple[SharpStep, ...]
    transmission_error: PairCurve
    speed: PairSpeeds
