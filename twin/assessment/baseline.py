"""Comparison with a healthy baseline, and lines that no known shaft makes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineWindow:
    """One window compared with a healthy baseline."""

    index: int
    name: str
    start_time_ns: int
    speed: float  # [Hz]
    speed_std: float | None  # [Hz]
    speed_source: str
    torque: float | None  # [N·m]
    between: tuple[str, ...]  # recordings of the baseline that it was compared with
    interpolated: bool
    pattern_correlation: float | None
    same_teeth: bool
    pattern_compared: bool = True  # False where the healthy recordings do not repeat their tooth pattern


@dataclass(frozen=True, slots=True, kw_only=True)
class RawMeasure:
    """Raw RMS or kurtosis of one accelerometer beside its limits."""

    channel: str
    name: str  # rms [unit of the channel] or kurtosis
    value: float  # median of the windows
    low: float
    high: float
    beyond: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RawLimit:
    """Raw RMS and kurtosis of a recording beside the limits that healthy recordings give."""

    measures: tuple[RawMeasure, ...]
    false_alarms: float  # that are meant, of healthy recordings
    not_compared: str = ""  # why there is no limit
    decides_alone: bool = False  # whether nothing else has called the recording changed

    @property
    def exceeded(self) -> tuple[RawMeasure, ...]:
        """Measures beyond their limits."""
        return tuple(m for m in self.measures if m.beyond)


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One kind of comparison with a baseline, and by how much its limits are raised."""

    what: str
    channel: str  # "" for all together
    factor: float | None  # of the limits; None where it is not compared
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """What leaving each healthy recording out in turn has shown."""

    recordings: int  # left out; 0: too few
    false_alarms: int  # of these
    raw_false_alarms: int  # of these, of the limit on raw RMS and kurtosis alone
    meant: float  # share of false alarms that limits are set for
    compared: tuple[Compared, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class NotJudged:
    """A kind of change that a baseline does not suffice to judge yet."""

    what: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineSufficiency:
    """What a healthy baseline suffices for."""

    recordings: int
    recordings_needed: int  # to judge single teeth
    load: tuple[float, float] | None  # least and largest, over the rated one; None where it is not known
    not_judged: tuple[NotJudged, ...]
    windows: int = 0
    days: int = 0
    loads: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineAssessment:
    """What a healthy baseline was learned from, and the window compared with it."""

    recordings: tuple[str, ...]
    operating_points: Mapping[str, tuple[float, float]]  # axis → lowest and highest, SI
    shafts: tuple[float, ...]  # orders of the pinion
    channels: tuple[str, ...]
    window: BaselineWindow | None = None
    left_out: LeftOut | None = None
    raw_limit: RawLimit | None = None  # of the window or recording that was compared
    not_learned: tuple[str, ...] = ()  # channels of recordings that could not be used, and copies
    sufficiency: BaselineSufficiency | None = None
    days: int = 0  # on which the windows were recorded
    loads: int = 0  # operating conditions at which they were


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSideband:
    """Lines at multiples of a spacing on both sides of a mesh harmonic in one channel."""

    channel: str
    harmonic: int  # 0: the multiples themselves
    multiple: int
    amplitude: float  # peak [m/s²]
    depth: float | None  # relative to the mesh line; None for harmonic 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SpectrumExcerpt:
    """The spectrum of one channel round a mesh harmonic: the highest line of every step."""

    channel: str
    harmonic: int
    start: float  # [Hz]
    step: float  # [Hz]
    amplitude: tuple[float, ...]  # peak (n,) [m/s²]


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
    order: float  # of pinion rotation
    order_std: float
    frequency: float  # [Hz]
    frequency_std: float  # [Hz]
    part: int
    geared: str | None  # ratio to the pinion, where it is one of small tooth counts
    clearness: float  # −ln of the probability that the search finds one as clear by chance [nat]
    next_clearness: float  # the same of the best unrelated spacing
    sidebands: tuple[LineSideband, ...] = ()
    spectrum: tuple[SpectrumExcerpt, ...] = ()
    causes: tuple[PossibleCause, ...] = ()
    healthy: tuple[str, ...] | None = None  # healthy recordings that show it, too; None without a baseline
    new: bool = True  # False where healthy recordings show it, or as clear ones of their own
    channels: tuple[str, ...] = ()  # on which both sidebands stand out of their neighbourhood


@dataclass(frozen=True, slots=True, kw_only=True)
class SidebandLimit:
    """The amplitude of which half of the pairs of sidebands at one mesh harmonic alone are found in one channel."""

    channel: str
    harmonic: int
    amplitude: float  # peak, of the weaker side [unit of the channel]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnattributedSearch:
    """What lines of no known shaft were sought in a window, and from which size they would have been found."""

    window: str
    smallest: float  # distance from a mesh line [Hz]
    largest: float  # [Hz]
    found: int  # spacings
    limits: tuple[SidebandLimit, ...]
