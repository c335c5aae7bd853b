"""`modulation`: how deep the turn of a shaft modulates the mesh vibration, by the sidebands of the mesh lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field

from service.contract.base import ContractModel
from twin.assessment.key import PERCENT

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment

CAUSES = {
    1: "run-out or eccentricity of the {shaft}, a bent shaft, or a load that varies once per turn of the {shaft}",
    2: "an out-of-round {shaft}, misalignment of its coupling, or a load that varies twice per turn of the {shaft}",
    3: "a form error of the {shaft} with three waves, or a load that varies three times per turn of the {shaft}",
}

AMPLITUDE, PHASE = 0.8, 0.2  # share of amplitude modulation from which, or up to which, it is called by one name alone


def causes_of(shaft: str, multiple: int) -> str:
    """What can modulate the mesh vibration so many times per turn of a shaft."""
    return CAUSES[multiple].format(shaft=shaft)


class SidebandPair(ContractModel):
    """The two sidebands of one mesh harmonic."""

    mesh_harmonic: int
    mesh_amplitude: float = Field(description="peak [m/s²]")
    lower_amplitude: float = Field(description="peak of the line below the mesh line [m/s²]")
    upper_amplitude: float = Field(description="peak of the line above it [m/s²]")
    depth_percent: float = Field(description="sum of both over the mesh line")
    depth_std_percent: float

    @classmethod
    def of(cls, pair: assessment.SidebandPair) -> SidebandPair:
        return cls(
            mesh_harmonic=pair.harmonic,
            mesh_amplitude=pair.mesh,
            lower_amplitude=pair.lower,
            upper_amplitude=pair.upper,
            depth_percent=pair.depth / PERCENT,
            depth_std_percent=pair.std / PERCENT,
        )


class Modulation(ContractModel):
    """How deep a multiple of one shaft's turn modulates the mesh vibration in one accelerometer.

    A description, not a fault: healthy gears have sidebands, too. Only a healthy baseline shows whether they are new.
    """

    channel: str
    shaft: str = Field(description="pinion or gear")
    per_turn: int = Field(description="so many times per turn of the shaft")
    frequency_hz: float = Field(description="distance of the sidebands from the mesh lines")
    depth_percent: float = Field(description="over all mesh harmonics that were read, weighted by their power")
    depth_std_percent: float
    kind: str = Field(description="amplitude, phase, or amplitude and phase")
    possible_causes: str = Field(description="which the accelerometers cannot distinguish")
    sidebands: list[SidebandPair]
    healthy_percent: list[float] | None = Field(
        default=None, description="least and largest depth in the recordings of the healthy baseline"
    )
    new: bool | None = Field(default=None, description="whether it is clearly deeper than in the healthy baseline")

    @classmethod
    def of(cls, found: assessment.Modulation) -> Modulation:
        compared: dict[str, Any] = {}
        if found.healthy is not None:
            compared = {"healthy_percent": [depth / PERCENT for depth in found.healthy], "new": found.new}
        share = found.amplitude_share
        kind = "amplitude" if share > AMPLITUDE else "phase" if share < PHASE else "amplitude and phase"
        return cls(
            channel=f"accel/{found.sensor}",
            shaft=found.shaft,
            per_turn=found.multiple,
            frequency_hz=found.frequency,
            depth_percent=found.depth / PERCENT,
            depth_std_percent=found.std / PERCENT,
            kind=kind,
            possible_causes=causes_of(found.shaft, found.multiple),
            sidebands=[SidebandPair.of(pair) for pair in found.pairs],
            **compared,
        )
