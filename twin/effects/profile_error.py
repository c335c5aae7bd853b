"""Profile error: tip relief of both gears and a slope of the profile, the same on all teeth.

    e_p(s) = −C1·r((s − s_E)/l + 1) − C2·r((s_A − s)/l + 1) − f·(s − s_A)/(s_E − s_A),   r(x) = max(0, x)²

C1, C2    tip relief of pinion and gear at their tips                   [m]
l         length over which it begins, along the path of contact        [m]
f         profile slope, missing at the path's end more than at its start; may be negative [m]
s_A, s_E  start (gear's tip) and end (pinion's tip) of the path         [m]

Order    mesh orders only
Source   ISO 21771-1:2024 (tip relief) and ISO 1328-1:2013 (profile slope f_Hα); parabolic relief as in
         D. R. Houser, "Gear noise", Dudley's Gear Handbook, 2nd ed. 1991
Holds    reliefs below a tenth of the module
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twin.effects.facts import DetectionThresholds, Facts, FittedNumber
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileErrorDetection(DetectionThresholds):
    """A profile that sound teeth do not have."""

    least_size: float = deciding(
        0.3,
        of="10 µm of relief, 5 µm of slope",
        meaning="largest of both reliefs and the slope from which profile errors are reported",
        source="tuned on T01–T58; not derived",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileError:
    """Relieved tips and a sloping profile."""

    pinion_relief: float = 0.0  # C1 [m]
    gear_relief: float = 0.0  # C2 [m]
    slope: float = 0.0  # f [m]
    relief_length: float = 2e-3  # l [m]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="pinion_relief", unit="m", low=0.0, high=200e-6, prior=20e-6),
        Parameter(name="gear_relief", unit="m", low=0.0, high=200e-6, prior=20e-6),
        Parameter(name="slope", unit="m", low=-100e-6, high=100e-6, prior=10e-6),
        Parameter(name="relief_length", unit="m", low=1e-4, high=2e-2, prior=1e-3, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="alike")
    facts: ClassVar[Facts] = Facts(
        label="profile errors",
        action="Check the tooth profile of both gears at the next stop.",
        acts_on="mesh",
        periods=("mesh",),
        detector="mesh",
        shapes_wear=True,
        fitted=(
            FittedNumber(parameter=parameters[0], scale=10e-6, start=0.3, low=0.0, high=15.0),
            FittedNumber(parameter=parameters[1], scale=10e-6, start=0.3, low=0.0, high=15.0),
            FittedNumber(parameter=parameters[2], scale=5e-6, start=0.0, low=-15.0, high=15.0),
            FittedNumber(
                parameter=parameters[3],
                scale=0.5,
                centre=2e-3,
                logarithmic=True,
                start=0.0,
                low=-2.0,
                high=2.0,
                sizes=False,
            ),
        ),
        detection=ProfileErrorDetection(),
    )
    period: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        check(self)

    def missing(self, s: np.ndarray, path_start: float, path_end: float) -> tuple[np.ndarray, np.ndarray]:
        """Missing material −e [m] and its slope along s at path positions; any shape → the same."""
        length, whole = self.relief_length, path_end - path_start
        at_end = np.maximum(0.0, (s - path_end) / length + 1)
        at_start = np.maximum(0.0, (path_start - s) / length + 1)
        missing = self.pinion_relief * at_end**2 + self.gear_relief * at_start**2
        along = 2 * (self.pinion_relief * at_end - self.gear_relief * at_start) / length
        return missing + self.slope * (s - path_start) / whole, along + self.slope / whole

    def apply(self, setup: Setup) -> Setup:
        passages, pair = setup.passages, setup.pair
        missing, along = self.missing(passages.position, pair.path_start, pair.path_end)
        return setup.with_error(-missing, -passages.side * pair.base_radius[0] * along)
