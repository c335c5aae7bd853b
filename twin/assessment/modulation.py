"""Modulation of the mesh vibration by the turn of a shaft."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from twin.assessment.key import HIDDEN, PERCENT, Key


@dataclass(frozen=True, slots=True, kw_only=True)
class SidebandPair:
    """The two sidebands of one mesh harmonic, at ± n shaft orders about it."""

    harmonic: Annotated[int, Key("mesh_harmonic")]
    mesh: Annotated[float, Key("mesh_amplitude", meaning="peak [m/s²]")]
    lower: Annotated[float, Key("lower_amplitude", meaning="peak of the line below the mesh line [m/s²]")]
    upper: Annotated[float, Key("upper_amplitude", meaning="peak of the line above it [m/s²]")]
    depth: Annotated[float, Key("depth_percent", PERCENT, "sum of both over the mesh line")]
    std: Annotated[float, Key("depth_std_percent", PERCENT, "from the noise between the lines")]


_compared = partial(Key, shown=lambda found: found.healthy is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Modulation:
    """How deep a multiple of one shaft's turn modulates the mesh vibration in one accelerometer.

    A description, not a fault: healthy gears have sidebands, too. Only a healthy baseline shows whether they are new.
    """

    sensor: Annotated[str, HIDDEN]
    shaft: Annotated[str, Key(meaning="pinion or gear")]
    multiple: Annotated[int, Key("per_turn", meaning="so many times per turn of the shaft")]
    frequency: Annotated[float, Key("frequency_hz", meaning="distance of the sidebands from the mesh lines")]
    depth: Annotated[
        float, Key("depth_percent", PERCENT, "over all mesh harmonics that were read, weighted by their power")
    ]
    std: Annotated[float, Key("depth_std_percent", PERCENT)]
    amplitude_share: Annotated[float, HIDDEN]  # of the modulation's power: 1 amplitude modulation, 0 phase modulation
    pairs: Annotated[
        tuple[SidebandPair, ...], Key("sidebands", meaning="of mesh harmonics whose sidebands are above the noise")
    ]
    healthy: Annotated[
        tuple[float, float] | None,
        _compared("healthy_percent", PERCENT, "least and largest depth in the recordings of the healthy baseline"),
    ] = None
    new: Annotated[bool | None, _compared(meaning="whether it is clearly deeper than in the healthy baseline")] = None
