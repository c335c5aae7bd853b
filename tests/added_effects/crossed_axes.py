"""Crossed axes: the flanks touch at one end of the face first.

    e(z) = λ·z − |λ|/2,    z = −½ … ½

λ  opening of the flanks from end to end of the face, along the line of action    [m]
z  place across the face, of its width

Order    mesh orders only
Source   ISO 6336-1:2019, clause 7 (linear gap across the face)
Holds    gaps that stay linear; worn flanks wear at the end that carries
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.effects.facts import Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature

SLICES = 13


@dataclass(frozen=True, slots=True, kw_only=True)
class CrossedAxes:
    """One end of the face carries."""

    opening: float  # λ [m]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="opening", unit="m", low=0.0, high=200e-6, prior=30e-6),
    )
    signature: ClassVar[Signature] = Signature(shape="alike")
    facts: ClassVar[Facts] = Facts(
        label="crossed axes",
        action="Check the alignment of the shafts.",
        acts_on="mesh",
        periods=("mesh",),
        detector="mesh",
        shapes_wear=True,
        tilts_shaft=True,
        slices=SLICES,
    )
    period: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        check(self)

    def apply(self, setup: Setup) -> Setup:
        if self.opening == 0:
            return setup
        setup = setup.sliced(SLICES)
        return setup.with_error(setup.drive * self.opening * (setup.face_position - 0.5), 0.0)
