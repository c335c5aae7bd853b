"""The kinds of measurement channels: one line of `CHANNEL_KINDS` each, and nothing else names them one by one.

A kind says which segment of the topic carries it, which message its frames are, the unit and limits of its values, and
what becomes of them in a `twin.windows.Window`:

    SAMPLES   evenly sampled record of the whole window, `window_field` names the mapping by sensor or shaft
    EDGES     times of a shaft encoder's edges, likewise
    SLOW      one value a window (`summary` of the values in it, else the last known one with its age), by label, in SI

The values of a sample frame that lie outside `values` are errors of transmission, whatever the machine: they are left
out and counted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from math import inf

import numpy as np

STANDARD_GRAVITY = 9.80665  # [m/s²]
SHAFTS = ("pinion", "gear")


class Layout(Enum):
    """What the frames of a channel become in a window; the value is the message of `gearbox.v1` that carries them."""

    SAMPLES = "SampleFrame", "samples"
    EDGES = "EncoderFrame", "edges"
    SLOW = "SampleFrame", "slow"

    @property
    def schema(self) -> str:
        return f"gearbox.v1.{self.value[0]}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Conversion:
    """From the values of an imported column to the contract's unit: factor · value + offset."""

    factor: float = 1.0
    offset: float = 0.0
    per_volt: bool = False  # the factor is 1/sensitivity, which the mapping file gives
    left_out: str = ""  # why a column of this unit is checked and not imported


AS_IT_IS = Conversion()
VOLTS = Conversion(per_volt=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelKind:
    """One kind of channel."""

    segment: str  # of the topic `gearbox/{asset}/{segment}/{name}`
    layout: Layout
    quantity: str
    unit: str  # of the values, by the contract
    named_by: str  # what the name is of: sensor, shaft, place
    names: tuple[str, ...] = ()  # that are allowed; any where empty
    rate: tuple[float, float] = (0.0, inf)  # (above, up to]: of samples [Hz], of an encoder [edges a turn]
    values: tuple[float, float] = (-inf, inf)  # beyond what any sensor of this kind can measure, in `unit`
    import_units: Mapping[str, Conversion] = field(default_factory=dict)
    window_field: str = ""  # of twin.windows.Window that holds it by name
    usable_alone: bool = False  # whether a window that holds nothing else can be used
    vibration: bool = False  # whether it alternates about zero, so that extreme values which repeat are clipped
    loads: bool = False  # whether it may hold a level: clipped only where it reaches its largest value again and again
    summary: Callable[[np.ndarray], float] = np.mean  # of the values of a slow channel in a window
    si_offset: float = 0.0  # what a slow channel's value needs to be in SI
    record_key: str = ""  # of the window record that shows a slow channel's values by name

    @property
    def schema(self) -> str:
        """Name of the message."""
        return self.layout.schema

    @property
    def slow(self) -> bool:
        return self.layout is Layout.SLOW


CHANNEL_KINDS = {
    kind.segment: kind
    for kind in (
        ChannelKind(
            segment="accel", layout=Layout.SAMPLES, quantity="acceleration", unit="m/s²", named_by="sensor",
            rate=(0.0, 1e6), values=(-1e6, 1e6), window_field="accelerations", usable_alone=True, vibration=True,
            import_units={"m/s2": AS_IT_IS, "g": Conversion(factor=STANDARD_GRAVITY), "V": VOLTS,
                          "Pa": Conversion(left_out="not an acceleration (Pa)"), "unknown": AS_IT_IS},
        ),
        ChannelKind(
            segment="torque", layout=Layout.SAMPLES, quantity="torque", unit="N·m", named_by="shaft", names=SHAFTS,
            rate=(0.0, 1e5), values=(-1e7, 1e7), window_field="torques", loads=True,
            import_units={"Nm": AS_IT_IS, "V": VOLTS, "unknown": AS_IT_IS},
        ),
        ChannelKind(
            segment="encoder", layout=Layout.EDGES, quantity="shaft angle", unit="edges", named_by="shaft",
            names=SHAFTS, rate=(0.0, 1e7), window_field="encoders", usable_alone=True,
            import_units={"s": AS_IT_IS, "quadrature": AS_IT_IS, "counts": AS_IT_IS, "pulses": AS_IT_IS},
        ),
        ChannelKind(
            segment="temperature", layout=Layout.SLOW, quantity="temperature", unit="°C", named_by="place",
            rate=(0.0, 1e5), values=(-273.15, 3000.0), summary=np.mean, si_offset=273.15, record_key="temperatures",
            import_units={"degC": AS_IT_IS, "K": Conversion(offset=-273.15),
                          "degF": Conversion(factor=5 / 9, offset=-160 / 9), "V": VOLTS},
        ),
        ChannelKind(
            segment="load", layout=Layout.SLOW, quantity="load", unit="%", named_by="place",
            rate=(0.0, 1e5), values=(-1000.0, 1000.0), summary=np.mean, record_key="loads",
            import_units={"percent": AS_IT_IS, "fraction": Conversion(factor=100.0), "V": VOLTS},
        ),
    )
}  # fmt: skip
"""By segment. Limits of rate and of values are not derived: they are chosen to lie beyond every sensor on sale, so that
only errors of transmission and hostile input meet them. A rig file narrows the values (`[sensors.ranges]`)."""


def kind_of(label: str) -> ChannelKind:
    """The kind of a channel's label, such as `accel/y6`."""
    return CHANNEL_KINDS[label.partition("/")[0]]
