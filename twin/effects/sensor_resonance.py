"""Sensor-mount resonance: the accelerometer stands on a spring.

    a_reported/a = (1 + 2iζr)/(1 − r² + 2iζr),     r = f/f_0

f_0  natural frequency of the sensor on its mount, infinite for a rigid one   [Hz]
ζ    damping ratio of the mount

Order    acceleration alone, amplified about f_0 and turned in phase beyond; transmission error and torque unmoved
Source   motion of a mass on a moving base: J. P. Den Hartog, Mechanical Vibrations, 4th ed. 1956, ch. 2;
         mounts: ISO 5348:2021
Holds    one degree of freedom; a sensor much lighter than its base
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import ClassVar

import numpy as np

from twin.effects.facts import Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature


def transmitted(r: np.ndarray, ζ: np.ndarray | float) -> np.ndarray:
    """a_reported/a; arrays of one shape, or that go together."""
    return np.asarray((1 + 2j * ζ * r) / (1 - r**2 + 2j * ζ * r))


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorResonance:
    """A soft mount."""

    frequency: float  # f_0 [Hz]
    damping_ratio: float = 0.05  # ζ

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="frequency", unit="Hz", low=50.0, high=1e5, prior=2000.0, neutral=inf),
        Parameter(name="damping_ratio", unit="", low=0.001, high=0.7, prior=0.05, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="path", channels=("acceleration",))
    facts: ClassVar[Facts] = Facts(
        label="a resonance of the accelerometer's mount",
        action="Check the mount of the accelerometer.",
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
        return transmitted(np.asarray(frequency) / self.frequency, self.damping_ratio)

    def apply(self, setup: Setup) -> Setup:
        return setup.with_sensor(self.response)
