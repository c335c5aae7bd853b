"""Misaligned shafts: the gap between the flanks opens linearly across the face.

    e(z) = −|λ|/2 + λ·z,    z = −½ … ½        F = Σ_slices (k/m)·max(0, d + e(z))

λ  lead gap from end to end of the face, along the line of action; its sign says which end touches first  [m]
z  place across the face, of its width
m  slices

The end that touches first carries the load: the mesh is softer, follows the load by a square root while part of the
face is open, and what closes varies with the pairs in contact. The flanks' force leaves the middle of the face; its
moment (`Response.face_moment`) goes to the bearings as a couple. On worn teeth that end wears in: give one worn
profile for every slice and the slices are kept.

Order    mesh orders only
Source   thin slices across the face: C. Weber, K. Banaschek, Formänderung und Profilrücknahme bei gerad- und
         schrägverzahnten Rädern, Vieweg 1953; the linear gap: ISO 6336-1:2019, clause 7 (face load factor)
Holds    gaps that stay linear; m at least 2F/(k·λ) resolved, some 3 slices in contact
Ignores  coupling between slices through the tooth and the rim; the tilt's change under load; back flanks by slices
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from twin.effects.facts import DetectionThresholds, Facts, FittedNumber
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature
from twin.thresholds import deciding

SLICES = 13


def face_separation(lead_gap, face_position):
    """e(z) [m] for a lead gap [m] at places across the face, −½ … ½; 0 where the flanks touch first.

    Either may be an array; they broadcast. Plain arithmetic, so that it can be compiled.
    """
    return lead_gap * face_position - abs(lead_gap) / 2


@dataclass(frozen=True, slots=True, kw_only=True)
class MisalignmentDetection(DetectionThresholds):
    """A lead gap that an accurate gear does not have."""

    least_size: float = deciding(
        0.27,
        of="30 µm, the prior spread of the lead gap",
        meaning="lead gap from which misalignment is reported: 8 µm",
        source="ISO 1328-1:2013, class 6: helix slope deviation of gears of the reference rig's size",
    )
    largest_size: float = deciding(
        1.0,
        of="backlash",
        meaning="largest lead gap that is possible; the model is given no more",
        source="derivation: a wider gap brings the back flanks of the other end of the face into contact",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Misalignment:
    """A gap across the face."""

    lead_gap: float  # λ [m]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="lead_gap", unit="m", low=-200e-6, high=200e-6, prior=30e-6),
    )
    signature: ClassVar[Signature] = Signature(shape="alike")
    facts: ClassVar[Facts] = Facts(
        label="misalignment of the shafts",
        action="Check the alignment of the shafts and the contact pattern of the teeth at the next stop.",
        acts_on="mesh",
        periods=("mesh",),
        detector="mesh",
        ended_by=("gears_replaced", "reassembled"),
        shapes_wear=True,
        tilts_shaft=True,
        slices=SLICES,
        fitted=(FittedNumber(parameter=parameters[0], scale=30e-6, start=0.7, low=0.0, high=6.0),),
        detection=MisalignmentDetection(),
    )
    period: ClassVar[str] = "mesh"

    def __post_init__(self) -> None:
        check(self)

    def apply(self, setup: Setup) -> Setup:
        λ = self.lead_gap
        if λ == 0:
            return setup
        setup = setup.sliced(SLICES)
        return setup.with_error(setup.drive * face_separation(λ, setup.face_position), 0.0)
