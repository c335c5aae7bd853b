"""Pitch errors: every tooth stands a little before or behind its place.

    e_p = f1[tooth of the pinion] + f2[tooth of the gear]

f1, f2  displacement of each tooth along the line of action, positive towards closing the drive flanks  [m]

Teeth that protrude wear faster where two pairs share the load, until their flanks have adapted
(twin/effects/tooth_wear.py).

Order    whole orders of the pinion's rotation for f1, multiples of z1/z2 for f2
Source   index deviations of ISO 1328-1:2013, clause 3; kinematic effect as in D. B. Welbourn, Proc. IMechE
         Noise and Vibrations of Engines and Transmissions (1979) 9–14
Holds    errors constant along a flank and across the face
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twin.effects.facts import Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup, common_period
from twin.effects.signature import Signature
from twin.errors import ParameterError
from twin.wear.differing_teeth import ToothDifferences


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchError:
    """Displacements of the teeth; an empty tuple is a gear without errors."""

    pinion: tuple[float, ...] = ()  # f1 (z1,) [m]
    gear: tuple[float, ...] = ()  # f2 (z2,) [m]
    onset_depth: float = 0.0  # of the mean flank from which the teeth are displaced, and wear differently [m]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="pinion", unit="m", low=-100e-6, high=100e-6, prior=5e-6, teeth=0),
        Parameter(name="gear", unit="m", low=-100e-6, high=100e-6, prior=5e-6, teeth=1),
        Parameter(name="onset_depth", unit="m", low=0.0, high=1e-2, prior=1e-2, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="all_round", shafts=("pinion", "gear"))
    facts: ClassVar[Facts] = Facts(
        label="pitch errors",
        action="Check the tooth spacing of both gears at the next stop.",
        acts_on="teeth",
        periods=("mesh", "pinion", "gear", "hunting"),
        detector="tooth_errors",
    )

    def __post_init__(self) -> None:
        check(self)

    @classmethod
    def drawn(cls, teeth: tuple[int, int], pinion_std: float, gear_std: float, seed: int) -> PitchError:
        """Normally distributed errors without mean, standard deviations in m."""
        rng = np.random.default_rng(seed)
        errors = [std * rng.standard_normal(z) for z, std in zip(teeth, (pinion_std, gear_std), strict=True)]
        return cls(pinion=tuple(errors[0] - errors[0].mean()), gear=tuple(errors[1] - errors[1].mean()))

    @property
    def period(self) -> str:
        return common_period(name for name, present in (("pinion", self.pinion), ("gear", self.gear)) if any(present))

    def differences(self, teeth: tuple[int, int]) -> ToothDifferences:
        """What sets the teeth apart as they wear."""
        return ToothDifferences(displacement=(self.pinion, self.gear), onset_depth=self.onset_depth)

    def apply(self, setup: Setup) -> Setup:
        teeth = (setup.passages.pinion_tooth, setup.passages.gear_tooth)
        for name, errors, z, tooth in zip(
            ("pinion", "gear"), (self.pinion, self.gear), setup.pair.teeth, teeth, strict=True
        ):
            if len(errors) not in (0, z):
                raise ParameterError(f"{len(errors)} pitch errors for {z} teeth of the {name}: one each")
            if any(errors):
                setup = setup.with_error(setup.passages.side * np.asarray(errors)[tooth], 0.0)
        return setup
