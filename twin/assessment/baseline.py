"""Comparison with a healthy baseline, and lines that no known shaft makes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from twin.assessment.key import DEFAULT, GIVEN, OPTIONAL, PERCENT, Key

_given = partial(Key, shown=GIVEN)
_or_null = partial(Key, null=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Lowest and highest value of one axis of the operating points."""

    low: Annotated[float, _or_null("from")]
    high: Annotated[float, _or_null("to")]


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineWindow:
    """One window compared with a healthy baseline."""

    index: int
    name: str
    start_time_ns: int
    speed: Annotated[float, _or_null("speed_hz")]
    speed_std: Annotated[float | None, Key("speed_std_hz")]
    speed_source: Annotated[str, Key("speed_from")]
    torque: Annotated[float | None, Key("torque_nm")]
    between: Annotated[tuple[str, ...], Key(meaning="recordings of the baseline that it was compared with")]
    interpolated: bool
    pattern_correlation: float | None
    same_teeth: Annotated[bool, Key(meaning="true where the tooth pattern is not compared, too")]
    pattern_compared: Annotated[
        bool, Key(meaning="whether healthy recordings repeat their tooth pattern", shown=DEFAULT)
    ] = True


@dataclass(frozen=True, slots=True, kw_only=True)
class RawMeasure:
    """Raw RMS or kurtosis of one accelerometer with its limits."""

    channel: str
    name: Annotated[str, Key(meaning="rms, in the channel's unit, or kurtosis (3 for Gaussian noise)")]
    value: Annotated[float, _or_null(meaning="median of the windows")]
    low: Annotated[float, _or_null("from")]
    high: Annotated[float, _or_null("to")]
    beyond: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RawLimit:
    """A limit on raw RMS and kurtosis, given with the verdict."""

    decides_alone: Annotated[bool, Key(meaning="whether nothing else has called the recording changed")] = False
    false_alarms: Annotated[float, Key("false_alarms_percent", PERCENT, "that the limit is set for")]
    not_compared: Annotated[str, _or_null(meaning="why there is no limit")] = ""
    measures: tuple[RawMeasure, ...]

    @property
    def exceeded(self) -> tuple[RawMeasure, ...]:
        """Measures beyond their limits."""
        return tuple(m for m in self.measures if m.beyond)


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One kind of comparison with the baseline."""

    what: str
    channel: Annotated[str, _or_null(meaning="null for all together")]
    factor: Annotated[
        float | None,
        Key(
            "limit_factor",
            meaning="by how much healthy recordings left out have raised its limits; null where it is not compared",
        ),
    ]
    reason: Annotated[str, _or_null(meaning="why it is not compared")] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """What leaving each healthy recording out in turn has shown."""

    recordings: Annotated[int, Key(meaning="left out in turn, or parts of them; 0 where there are too few")]
    false_alarms: Annotated[int, Key(meaning="of these, called changed by limits of the others alone")]
    raw_false_alarms: Annotated[int, Key(meaning="of these, beyond the limit on raw RMS and kurtosis")]
    meant: Annotated[float, Key("meant_percent", PERCENT, "false alarms that are meant of a verdict")]
    compared: tuple[Compared, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class NotJudged:
    """A kind of change that cannot be judged with the baseline yet."""

    what: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineSufficiency:
    """What a healthy baseline suffices for."""

    recordings: int
    recordings_needed: Annotated[int, Key(meaning="to judge single teeth")]
    load: Annotated[
        tuple[float, float] | None,
        Key("load_percent", PERCENT, "least and largest load learned, of the rated one; null where it is not known"),
    ]
    not_judged: Annotated[tuple[NotJudged, ...], Key(meaning="empty where the baseline suffices")]
    windows: Annotated[int, Key(meaning="those of one source, day and load are one recording", shown=OPTIONAL)] = 0
    days: Annotated[int, Key(shown=OPTIONAL)] = 0
    loads: Annotated[int, Key(meaning="operating points apart from one another", shown=OPTIONAL)] = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineAssessment:
    """What a healthy baseline was learned from, and the window that was compared with it."""

    recordings: tuple[str, ...]
    operating_points: Mapping[str, Range]  # by axis, SI
    shafts: Annotated[tuple[float, ...], Key(meaning="orders of the pinion")]
    channels: tuple[str, ...]
    days: Annotated[int, Key(meaning="on which the windows were recorded, UTC", shown=OPTIONAL)] = 0
    loads: Annotated[int, Key(meaning="operating conditions at which they were", shown=OPTIONAL)] = 0
    window: Annotated[BaselineWindow | None, _given()] = None
    sufficiency: Annotated[BaselineSufficiency | None, _given()] = None
    left_out: Annotated[LeftOut | None, _given(meaning="what is compared, what not, and false alarms")] = None
    raw_limit: Annotated[RawLimit | None, _given(meaning="of the window or recording that was compared")] = None
    not_learned: Annotated[
        tuple[str, ...], Key(meaning="recordings' channels left out, and copies", shown=DEFAULT)
    ] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSideband:
    """Lines at multiples of a spacing on both sides of a mesh harmonic in one channel."""

    channel: str
    harmonic: int  # 0: the multiples themselves
    multiple: int
    amplitude: Annotated[float, _or_null(meaning="peak [m/s²]")]
    depth: Annotated[float | None, Key(meaning="relative to the mesh line")]  # None for harmonic 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectrumExcerpt:
    """The spectrum of one channel round a mesh harmonic: the highest line of every step."""

    channel: str
    harmonic: int
    start: Annotated[float, Key("from_hz")]
    step: Annotated[float, Key("step_hz")]
    amplitude: Annotated[tuple[float, ...], _or_null(meaning="peak [m/s²]")]  # (n,)


@dataclass(frozen=True, slots=True, kw_only=True)
class PossibleCause:
    """One cause that was tried on a spacing of lines."""

    name: str
    possible: bool
    detail: str


@dataclass(frozen=True, slots=True, kw_only=True)
class UnattributedLines:
    """A spacing of lines that no known shaft makes."""

    window: str
    order: Annotated[float, _or_null(meaning="of pinion rotation")]
    order_std: Annotated[float, _or_null()]
    frequency: Annotated[float, _or_null("frequency_hz")]
    frequency_std: Annotated[float, _or_null("frequency_std_hz")]
    part: int
    geared: Annotated[str | None, Key(meaning="ratio to the pinion, where it is one of small tooth counts")]
    clearness: Annotated[float, _or_null(meaning="-ln of the probability that the search finds one as clear by chance")]
    next_clearness: Annotated[float, _or_null(meaning="the same of the best spacing that is not related to this one")]
    channels: Annotated[
        tuple[str, ...], Key(meaning="on which both sidebands stand out of their neighbourhood", shown=DEFAULT)
    ] = ()
    healthy: Annotated[
        tuple[str, ...] | None,
        Key(meaning="healthy recordings that show it, too; null without a baseline", shown=OPTIONAL),
    ] = None
    new: Annotated[
        bool,
        Key(meaning="false where the healthy recordings show it, or as clear ones of their own", shown=DEFAULT),
    ] = True
    sidebands: tuple[LineSideband, ...] = ()
    spectrum: tuple[SpectrumExcerpt, ...] = ()
    causes: tuple[PossibleCause, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class SidebandLimit:
    """The amplitude of which half of the sidebands at one mesh harmonic alone are found in one channel."""

    channel: str
    harmonic: int
    amplitude: Annotated[float, _or_null(meaning="peak of the weaker side, in the channel's unit")]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnattributedSearch:
    """What lines of no known shaft were searched for in a window: pairs of sidebands about mesh harmonics."""

    window: str
    smallest: Annotated[float, _or_null("from_hz", meaning="smallest distance from a mesh line")]
    largest: Annotated[float, _or_null("to_hz", meaning="largest distance from a mesh line")]
    found: Annotated[int, Key(meaning="spacings")]
    limits: Annotated[tuple[SidebandLimit, ...], Key("detection_limits")]
