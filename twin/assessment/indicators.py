"""Condition indicators of one accelerometer; their definitions are in twin/features/indicators.py."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from twin.assessment.key import FILLED, GIVEN, HIDDEN, Key


@dataclass(frozen=True, slots=True, kw_only=True)
class GearIndicators:
    """Indicators of one gear from its synchronous average; null where the part of the signal is empty."""

    turns: Annotated[int, Key(meaning="turns of the gear that the average is made of")]
    fm0: Annotated[float | None, Key(meaning="peak to peak over the sum of the mesh amplitudes (Stewart 1977)")]
    fm4: Annotated[float | None, Key(meaning="kurtosis of the difference signal (Stewart 1977)")]
    na4: Annotated[
        float | None, Key(meaning="fourth moment of the residual over the squared mean variance so far (1993)")
    ] = None  # needs the windows before: twin/features/indicator_record.py
    m6a: Annotated[float | None, Key(meaning="sixth normalised moment of the difference signal (Martin 1989)")]
    m8a: Annotated[float | None, Key(meaning="eighth normalised moment of the difference signal (Martin 1989)")]
    energy_ratio: Annotated[float | None, Key(meaning="RMS of the difference signal over that of the regular signal")]
    sideband_level_factor: Annotated[float | None, Key(meaning="first sidebands of mesh harmonic 1 over the RMS")]
    residual_moments: Annotated[tuple[float, float], HIDDEN]  # second and fourth [(m/s²)²], [(m/s²)⁴]


_UNIT = Key(
    meaning="`unknown` where `rms` is of raw values, whose unit is not known", shown=GIVEN, after="not_available"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorIndicators:
    """Indicators of one accelerometer."""

    rms: Annotated[float, Key(meaning="of all samples, without their mean [m/s²]", null=True)]
    kurtosis: float | None
    crest_factor: float | None
    gears: Annotated[Mapping[str, GearIndicators], Key(meaning="by `pinion` and `gear`", shown=FILLED)] = field(
        default_factory=dict
    )
    unavailable: Annotated[Mapping[str, str], Key("not_available", meaning="why a gear has none", shown=FILLED)] = (
        field(default_factory=dict)
    )
    calibrated: Annotated[bool, HIDDEN] = True  # whether the unit of the samples is known
    doubt: Annotated[str, Key(meaning="why those of gears may be of another speed", shown=FILLED)] = ""

    @property
    def unit(self) -> Annotated[str | None, _UNIT]:
        """The unit of the samples, where it is not known."""
        return None if self.calibrated else "unknown"
