"""`baseline` and `unattributed_lines`: comparison with a healthy baseline, and lines that no known shaft makes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field

from service.contract.base import AnswerModel, ContractModel
from twin.assessment.key import PERCENT

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment


class Range(ContractModel):
    """Lowest and highest value of one axis of the operating points."""

    from_: float | None = Field(alias="from")
    to: float | None


class BaselineWindow(ContractModel):
    """One window compared with a healthy baseline."""

    index: int
    name: str
    start_time_ns: int
    speed_hz: float | None
    speed_std_hz: float | None
    speed_from: str
    torque_nm: float | None
    between: list[str] = Field(description="recordings of the baseline that it was compared with")
    interpolated: bool
    pattern_correlation: float | None
    same_teeth: bool = Field(description="true where the tooth pattern is not compared, too")
    pattern_compared: bool = Field(True, description="whether healthy recordings repeat their tooth pattern")

    @classmethod
    def of(cls, window: assessment.BaselineWindow) -> BaselineWindow:
        return cls(
            index=window.index,
            name=window.name,
            start_time_ns=window.start_time_ns,
            speed_hz=window.speed,
            speed_std_hz=window.speed_std,
            speed_from=window.speed_source,
            torque_nm=window.torque,
            between=list(window.between),
            interpolated=window.interpolated,
            pattern_correlation=window.pattern_correlation,
            same_teeth=window.same_teeth,
            pattern_compared=window.pattern_compared,
        )


class NotJudged(ContractModel):
    """A kind of change that cannot be judged with the baseline yet."""

    what: str
    reason: str


class Sufficiency(ContractModel):
    """What a healthy baseline suffices for."""

    recordings: int
    recordings_needed: int = Field(description="to judge single teeth")
    load_percent: list[float] | None = Field(
        description="least and largest load learned, of the rated one; null where it is not known"
    )
    not_judged: list[NotJudged] = Field(description="empty where the baseline suffices")
    windows: int | None = Field(None, description="those of one source, day and load are one recording")
    days: int | None = None
    loads: int | None = Field(None, description="operating points apart from one another")

    @classmethod
    def of(cls, found: assessment.BaselineSufficiency) -> Sufficiency:
        return cls(
            recordings=found.recordings,
            recordings_needed=found.recordings_needed,
            load_percent=None if found.load is None else [load / PERCENT for load in found.load],
            not_judged=[NotJudged(what=kind.what, reason=kind.reason) for kind in found.not_judged],
            windows=found.windows,
            days=found.days,
            loads=found.loads,
        )


class Compared(ContractModel):
    """One kind of comparison with the baseline."""

    what: str
    channel: str | None = Field(description="null for all together")
    limit_factor: float | None = Field(
        description="by how much healthy recordings left out have raised its limits; null where it is not compared"
    )
    reason: str | None = Field(description="why it is not compared")


class LeavingOut(ContractModel):
    """What leaving each healthy recording out in turn has shown."""

    recordings: int = Field(description="left out in turn, or parts of them; 0 where there are too few")
    false_alarms: int = Field(description="of these, called changed by limits of the others alone")
    raw_false_alarms: int = Field(description="of these, beyond the limit on raw RMS and kurtosis")
    meant_percent: float = Field(description="false alarms that are meant of a verdict")
    compared: list[Compared]

    @classmethod
    def of(cls, found: assessment.LeftOut) -> LeavingOut:
        return cls(
            recordings=found.recordings,
            false_alarms=found.false_alarms,
            raw_false_alarms=found.raw_false_alarms,
            meant_percent=found.meant / PERCENT,
            compared=[
                Compared(what=c.what, channel=c.channel or None, limit_factor=c.factor, reason=c.reason or None)
                for c in found.compared
            ],
        )


class RawMeasure(ContractModel):
    """Raw RMS or kurtosis of one accelerometer with its limits."""

    channel: str
    name: str = Field(description="rms, in the channel's unit, or kurtosis (3 for Gaussian noise)")
    value: float | None
    from_: float | None = Field(alias="from")
    to: float | None
    beyond: bool


class RawLimit(ContractModel):
    """A limit on raw RMS and kurtosis, given with the verdict."""

    exceeded: bool
    decides_alone: bool = Field(description="whether nothing else has called the recording changed")
    false_alarms_percent: float = Field(description="that the limit is set for")
    not_compared: str | None = Field(description="why there is no limit")
    measures: list[RawMeasure]

    @classmethod
    def of(cls, found: assessment.RawLimit) -> RawLimit:
        return cls(
            exceeded=bool(found.exceeded),
            decides_alone=found.decides_alone,
            false_alarms_percent=found.false_alarms / PERCENT,
            not_compared=found.not_compared or None,
            measures=[
                RawMeasure.model_validate(
                    {"channel": m.channel, "name": m.name, "value": m.value, "from": m.low, "to": m.high,
                     "beyond": m.beyond}
                )
                for m in found.measures
            ],
        )  # fmt: skip


class Baseline(ContractModel):
    """What a healthy baseline was learned from, and the window that was compared with it."""

    recordings: list[str]
    operating_points: dict[str, Range]
    shafts: list[float] = Field(description="orders of the pinion")
    channels: list[str]
    days: int | None = Field(default=None, description="on which the windows were recorded, UTC")
    loads: int | None = Field(default=None, description="operating conditions at which they were")
    window: BaselineWindow | None = None
    sufficiency: Sufficiency | None = None
    left_out: LeavingOut | None = Field(None, description="what is compared, what not, and false alarms")
    raw_limit: RawLimit | None = Field(None, description="of the window or recording that was compared")
    not_learned: list[str] = Field(default_factory=list, description="recordings' channels left out, and copies")

    @classmethod
    def of(cls, baseline: assessment.BaselineAssessment) -> Baseline:
        parts: dict[str, Any] = {}
        if baseline.window is not None:
            parts["window"] = BaselineWindow.of(baseline.window)
        if baseline.sufficiency is not None:
            parts["sufficiency"] = Sufficiency.of(baseline.sufficiency)
        if baseline.left_out is not None:
            parts["left_out"] = LeavingOut.of(baseline.left_out)
        if baseline.raw_limit is not None:
            parts["raw_limit"] = RawLimit.of(baseline.raw_limit)
        return cls(
            recordings=list(baseline.recordings),
            operating_points={
                axis: Range.model_validate({"from": low, "to": high})
                for axis, (low, high) in baseline.operating_points.items()
            },
            shafts=list(baseline.shafts),
            channels=list(baseline.channels),
            not_learned=list(baseline.not_learned),
            days=baseline.days,
            loads=baseline.loads,
            **parts,
        )


class Sideband(ContractModel):
    """Lines at multiples of a spacing on both sides of a mesh harmonic in one channel."""

    channel: str
    harmonic: int
    multiple: int
    amplitude: float | None = Field(description="peak [m/s²]")
    depth: float | None = Field(description="relative to the mesh line")


class Excerpt(ContractModel):
    """The spectrum of one channel round a mesh harmonic: the highest line of every step."""

    channel: str
    harmonic: int
    from_hz: float
    step_hz: float
    amplitude: list[float | None]


class Cause(ContractModel):
    """One cause that was tried on a spacing of lines."""

    name: str
    possible: bool
    detail: str


class UnattributedLines(ContractModel):
    """A spacing of lines that no known shaft makes."""

    window: str
    order: float | None
    order_std: float | None
    frequency_hz: float | None
    frequency_std_hz: float | None
    part: int
    geared: str | None = Field(description="ratio to the pinion, where it is one of small tooth counts")
    clearness: float | None = Field(description="-ln of the probability that the search finds one as clear by chance")
    next_clearness: float | None = Field(description="the same of the best spacing that is not related to this one")
    channels: list[str] = Field(
        default_factory=list, description="on which both sidebands stand out of their neighbourhood"
    )
    healthy: list[str] | None = Field(None, description="healthy recordings that show it, too; null without a baseline")
    new: bool = Field(True, description="false where the healthy recordings show it, or as clear ones of their own")
    sidebands: list[Sideband]
    spectrum: list[Excerpt]
    causes: list[Cause]

    @classmethod
    def of(cls, lines: assessment.UnattributedLines) -> UnattributedLines:
        return cls(
            window=lines.window,
            order=lines.order,
            order_std=lines.order_std,
            frequency_hz=lines.frequency,
            frequency_std_hz=lines.frequency_std,
            part=lines.part,
            geared=lines.geared,
            clearness=lines.clearness,
            next_clearness=lines.next_clearness,
            sidebands=[
                Sideband(
                    channel=s.channel, harmonic=s.harmonic, multiple=s.multiple, amplitude=s.amplitude, depth=s.depth
                )
                for s in lines.sidebands
            ],
            spectrum=[
                Excerpt(
                    channel=e.channel,
                    harmonic=e.harmonic,
                    from_hz=e.start,
                    step_hz=e.step,
                    amplitude=list(e.amplitude),
                )
                for e in lines.spectrum
            ],
            healthy=None if lines.healthy is None else list(lines.healthy),
            new=lines.new,
            causes=[Cause(name=c.name, possible=c.possible, detail=c.detail) for c in lines.causes],
            channels=list(lines.channels),
        )


class SidebandLimit(ContractModel):
    """The amplitude of which half of the sidebands at one mesh harmonic alone are found in one channel."""

    channel: str
    harmonic: int
    amplitude: float | None = Field(description="peak of the weaker side, in the channel's unit")


class UnattributedSearch(ContractModel):
    """What lines of no known shaft were searched for in a window: pairs of sidebands about mesh harmonics."""

    window: str
    from_hz: float | None = Field(description="smallest distance from a mesh line")
    to_hz: float | None = Field(description="largest distance from a mesh line")
    found: int = Field(description="spacings")
    detection_limits: list[SidebandLimit]

    @classmethod
    def of(cls, search: assessment.UnattributedSearch) -> UnattributedSearch:
        return cls(
            window=search.window,
            from_hz=search.smallest,
            to_hz=search.largest,
            found=search.found,
            detection_limits=[
                SidebandLimit(channel=x.channel, harmonic=x.harmonic, amplitude=x.amplitude) for x in search.limits
            ],
        )


class AssetBaseline(AnswerModel):
    """The healthy baseline of an asset."""

    own: bool = Field(description="false where the asset has none of its own, and that of the settings may hold")
    by: str | None = None
    note: str | None = None
    at: str | None = Field(None, description="when it came into use, ISO 8601")
    windows: list[int] | None = Field(None, description="windows of the asset that it was learned from")
    added: bool | None = Field(None, description="whether recordings of an earlier baseline take part, too")
    baseline: Baseline | None = Field(None, description="what it was learned from, and what it suffices for")
