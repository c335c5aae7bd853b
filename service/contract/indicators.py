"""`windows[].indicators`: condition indicators of each accelerometer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pydantic import Field

from service.contract.base import ContractModel

if TYPE_CHECKING:  # a start of the service loads no part of the twin that computes
    from twin import assessment


class GearIndicators(ContractModel):
    """Indicators of one gear from its synchronous average; null where the part of the signal is empty."""

    turns: int = Field(description="turns of the gear that the average is made of")
    fm0: float | None = Field(description="peak to peak over the sum of the mesh amplitudes (Stewart 1977)")
    fm4: float | None = Field(description="kurtosis of the difference signal (Stewart 1977)")
    na4: float | None = Field(description="fourth moment of the residual over the squared mean variance so far (1993)")
    m6a: float | None = Field(description="sixth normalised moment of the difference signal (Martin 1989)")
    m8a: float | None = Field(description="eighth normalised moment of the difference signal (Martin 1989)")
    energy_ratio: float | None = Field(description="RMS of the difference signal over that of the regular signal")
    sideband_level_factor: float | None = Field(description="first sidebands of mesh harmonic 1 over the RMS")

    @classmethod
    def of(cls, gear: assessment.GearIndicators) -> GearIndicators:
        return cls(
            turns=gear.turns,
            fm0=gear.fm0,
            fm4=gear.fm4,
            na4=gear.na4,
            m6a=gear.m6a,
            m8a=gear.m8a,
            energy_ratio=gear.energy_ratio,
            sideband_level_factor=gear.sideband_level_factor,
        )


class SensorIndicators(ContractModel):
    """Indicators of one accelerometer."""

    rms: float | None = Field(description="of all samples, without their mean [m/s²]")
    kurtosis: float | None
    crest_factor: float | None
    gears: dict[str, GearIndicators] | None = Field(default=None, description="by `pinion` and `gear`")
    not_available: dict[str, str] | None = Field(default=None, description="why a gear has none")
    unit: str | None = Field(
        default=None, description="`unknown` where `rms` is of raw values, whose unit is not known"
    )
    doubt: str | None = Field(default=None, description="why those of gears may be of another speed")

    @classmethod
    def of(cls, sensor: assessment.SensorIndicators) -> SensorIndicators:
        parts: dict[str, Any] = {}
        if sensor.gears:
            parts["gears"] = {name: GearIndicators.of(gear) for name, gear in sensor.gears.items()}
        if sensor.unavailable:
            parts["not_available"] = dict(sensor.unavailable)
        if not sensor.calibrated:
            parts["unit"] = "unknown"
        if sensor.doubt:
            parts["doubt"] = sensor.doubt
        return cls(rms=sensor.rms, kurtosis=sensor.kurtosis, crest_factor=sensor.crest_factor, **parts)
