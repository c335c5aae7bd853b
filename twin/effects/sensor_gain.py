"""Sensor gain: the accelerometer reports g times what it feels.

    a_reported = g·a

Order    all orders alike; transmission error and torque unmoved
Source   ISO 16063-1 (sensitivity of a transducer)
Holds    linear sensors
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twin.effects.facts import Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorGain:
    """A wrong sensitivity."""

    gain: float  # g

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="gain", unit="", low=0.01, high=100.0, prior=0.15, neutral=1.0),
    )
    signature: ClassVar[Signature] = Signature(shape="path", channels=("acceleration",))
    facts: ClassVar[Facts] = Facts(
        label="a wrong gain of the accelerometer",
        action="Check the gain and the calibration of the accelerometer.",
        acts_on="sensor",
        periods=("mesh",),
        detector="sensor",
        ended_by=("sensor_moved",),
    )
    period: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        check(self)

    def response(self, frequency: np.ndarray) -> np.ndarray:
        """Complex gain at each frequency [Hz]; (m,) → (m,)."""
        return np.full(np.shape(frequency), self.gain)

    def apply(self, setup: Setup) -> Setup:
        return setup.with_sensor(self.response)
