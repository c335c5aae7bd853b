"""Changed damping of the mesh.

    F_p = k_p·max(0, δ + f·τ·δ')

f  factor on the contact's relative damping time

Order    mesh orders only
Source   the paper's calibrated mesh damping, Feng et al., Wear 426–427 (2019), section 3.3
Holds    damping in proportion to stiffness
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from twin.effects.facts import DetectionThresholds, Facts, FittedNumber
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshDampingDetection(DetectionThresholds):
    """A change of damping that can be seen at all."""

    least_size: float = deciding(
        0.7,
        of="0.8 of the logarithm of the damping time",
        meaning="change of the mesh damping from which it is reported",
        source="tuned on T01–T58; not derived",
    )
    least_gain: float = deciding(
        15.0,
        unit="nat",
        meaning="evidence that changed damping must add: hardly visible, it is imitated by errors of the structure",
        source="tuned on T01–T58; not derived",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshDamping:
    """More or less damping in the contacts."""

    factor: float  # f

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="factor", unit="", low=0.0, high=20.0, prior=1.0, neutral=1.0),
    )
    signature: ClassVar[Signature] = Signature(shape="alike")
    facts: ClassVar[Facts] = Facts(
        label="changed mesh damping",
        action="Check oil level, oil and temperature of the gears.",
        acts_on="mesh",
        periods=("mesh",),
        detector="mesh",
        fitted=(FittedNumber(parameter=parameters[0], scale=0.8, centre=1.0, logarithmic=True, low=-4.0, high=4.0),),
        detection=MeshDampingDetection(),
    )
    period: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        check(self)

    def apply(self, setup: Setup) -> Setup:
        return replace(setup, damping_time=setup.damping_time * self.factor)
