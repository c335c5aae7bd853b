"""`pair`: what the two encoders of a pair say, in the names and units of the contract."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pydantic import Field

from service.contract.base import ContractModel, in_unit
from service.contract.parts import Figure
from twin.assessment.key import MICROMETRE, MICRORADIAN, MILLIMETRE

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment


class Stated(ContractModel):
    """A stated ratio compared with the measured one."""

    ratio: float
    source: str
    deviations: float = Field(description="standard deviations between the two")
    contradicted: bool

    @classmethod
    def of(cls, stated: assessment.StatedRatio) -> Stated:
        return cls(
            ratio=stated.ratio, source=stated.source, deviations=stated.deviations, contradicted=stated.contradicted
        )


class Turns(ContractModel):
    """Turns of either shaft in the window."""

    pinion: float
    gear: float


class PairSpeed(ContractModel):
    """Pinion speed [Hz]."""

    mean: float = Field(description="from the first edge to the last")
    highest: float


class PairRunOut(ContractModel):
    """Run-out of a wheel, or of its encoder's disc: one multiple of a turn."""

    shaft: str
    multiple: int
    amplitude_urad: float = Field(description="as an angle of the pinion")
    std_urad: float
    amplitude_um: float | None = Field(description="on the base radius of its wheel; null without base radii")
    std_um: float | None
    indistinguishable_from: list[str]

    @classmethod
    def of(cls, found: assessment.RunOut) -> PairRunOut:
        return cls(
            shaft=found.shaft,
            multiple=found.multiple,
            amplitude_urad=found.amplitude / MICRORADIAN,
            std_urad=found.std / MICRORADIAN,
            amplitude_um=in_unit(found.length, MICROMETRE),
            std_um=in_unit(found.length_std, MICROMETRE),
            indistinguishable_from=list(found.indistinguishable_from),
        )


class PairBaseRadii(ContractModel):
    """Base radii that angles were converted with."""

    pinion_mm: float
    gear_mm: float
    assumed: bool = Field(description="whether the rig file does not give them")


class PairRemainder(ContractModel):
    """RMS of the transmission error before and after run-out is subtracted, as an angle of the pinion."""

    before: float
    after: float


class PairMissedCount(ContractModel):
    """A count that was missed: a step that neither wheel repeats."""

    time_s: float
    pinion_turns: float
    counts: float


class PairSharpStep(ContractModel):
    """A step that a wheel repeats, or whose angle was passed only once."""

    time_s: float
    pinion_turns: float
    counts: float
    shaft: str | None
    turn: float | None
    times: int
    ratio_if_missed: float | None


class PairTransmissionError(ContractModel):
    """Transmission error over the pinion's turns, before and after run-out is subtracted."""

    pinion_turns: list[float]
    before_urad: list[float]
    after_urad: list[float]


class PairSpeeds(ContractModel):
    """Speed of either shaft against time."""

    time_s: list[float]
    pinion_hz: list[float]
    gear_hz: list[float]


class EncoderPair(ContractModel):
    """What two encoders say of a pair: ratio, run-out, missed counts."""

    window: int = Field(description="index of the window that it is of")
    ratio: Figure = Field(description="turns of the pinion for one of the gear")
    teeth_that_fit: list[str] = Field(description="tooth counts gear/pinion within two standard deviations")
    stated: Stated | None
    turns: Turns
    speed_hz: PairSpeed
    run_out: list[PairRunOut]
    base_radii: PairBaseRadii | None
    rest_urad: PairRemainder
    missed_counts: list[PairMissedCount]
    sharp_steps: list[PairSharpStep]
    transmission_error: PairTransmissionError
    speed: PairSpeeds

    @classmethod
    def of(cls, pair: assessment.EncoderPair) -> EncoderPair:
        curve, speed, radii = pair.transmission_error, pair.speed, pair.base_radii
        return cls(
            window=pair.window,
            ratio=Figure.of(pair.ratio),
            teeth_that_fit=list(pair.tooth_counts),
            stated=None if pair.stated is None else Stated.of(pair.stated),
            turns=Turns(pinion=pair.turns[0], gear=pair.turns[1]),
            speed_hz=PairSpeed(mean=pair.speed_mean, highest=pair.speed_highest),
            run_out=[PairRunOut.of(r) for r in pair.run_out],
            base_radii=None
            if radii is None
            else PairBaseRadii(
                pinion_mm=radii.pinion / MILLIMETRE, gear_mm=radii.gear / MILLIMETRE, assumed=radii.assumed
            ),
            rest_urad=PairRemainder(before=pair.rest_before / MICRORADIAN, after=pair.rest_after / MICRORADIAN),
            missed_counts=[
                PairMissedCount(time_s=m.time, pinion_turns=m.pinion_turns, counts=m.counts) for m in pair.missed_counts
            ],
            sharp_steps=[
                PairSharpStep(
                    time_s=s.time,
                    pinion_turns=s.pinion_turns,
                    counts=s.counts,
                    shaft=s.shaft,
                    turn=s.turn,
                    times=s.times,
                    ratio_if_missed=s.ratio_if_missed,
                )
                for s in pair.sharp_steps
            ],
            transmission_error=PairTransmissionError(
                pinion_turns=[round(x, 4) for x in curve.pinion_turns],
                before_urad=[round(x / MICRORADIAN, 1) for x in curve.before],
                after_urad=[round(x / MICRORADIAN, 1) for x in curve.after],
            ),
            speed=PairSpeeds(
                time_s=[round(x, 4) for x in speed.time],
                pinion_hz=[round(x, 5) for x in speed.pinion],
                gear_hz=[round(x, 5) for x in speed.gear],
            ),
        )


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
        stated = Stated.of(stated_ratio(radii[1] / radii[0], source, ratio["value"], ratio["std"])).as_json()
    known = PairBaseRadii(pinion_mm=radii[0] / MILLIMETRE, gear_mm=radii[1] / MILLIMETRE, assumed=True).as_json()
    return {**section, "run_out": run_out, "base_radii": known, "stated": stated}
