"""Loss of mesh stiffness: every pair is softer by the same share.

    k_p = (1 − q)·k(s_p)

q  loss of stiffness; a share that grows makes all mesh orders move

Order    mesh orders only
Source   the paper's calibrated stiffness factor, Feng et al., Wear 426–427 (2019), section 3.3
Holds    uniform loss (rim, hub, a wrong modulus), the same on all teeth
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.effects.facts import DetectionThresholds, Facts, FittedNumber
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshStiffnessLossDetection(DetectionThresholds):
    """Softening that a rig file's tolerance does not explain."""

    least_size: float = deciding(
        0.7,
        of="0.15 of the mesh stiffness",
        meaning="loss of mesh stiffness from which it is reported",
        source="tuned on T01–T58; not derived",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshStiffnessLoss:
    """A softer mesh."""

    loss: float  # q

    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter(name="loss", unit="", low=-0.5, high=0.9, prior=0.15),)
    period: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        check(self)

    def apply(self, setup: Setup) -> Setup:
        return setup.with_stiffness(1 - self.loss)

    signature: ClassVar[Signature] = Signature(shape="alike")
    facts: ClassVar[Facts] = Facts(
        label="loss of mesh stiffness",
        action="Inspect the teeth and the seats of the gears at the next stop.",
        acts_on="mesh",
        periods=("mesh",),
        detector="mesh",
        fitted=(FittedNumber(parameter=parameters[0], scale=0.15, start=1.0, low=0.0, high=5.0),),
        detection=MeshStiffnessLossDetection(),
    )
