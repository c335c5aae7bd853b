"""Cracked tooth: one tooth keeps only part of its pair's stiffness.

    k_p = (1 − q)·k(s_p)      where the contact joins the cracked tooth

q  loss of the pair's stiffness

A soft tooth carries less and wears less where two pairs share the load: twin/effects/tooth_wear.py.

Order    all whole orders of the pinion's rotation (a cracked gear tooth: multiples of z1/z2), within two pitches
         of the tooth's passage
Source   a root crack as loss of the tooth's bending and shear stiffness: F. Chaari, T. Fakhfakh, M. Haddar,
         Eur. J. Mech. A 28 (2009) 461–468; here lumped into one factor on the pair
Holds    shallow cracks, on either flank alike
Ignores  the growth of the loss towards the tip; a tooth that lags permanently
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twin.effects.facts import Facts
from twin.effects.parameter import Parameter, check
from twin.effects.setup import Setup
from twin.effects.signature import Signature
from twin.errors import ParameterError
from twin.wear.differing_teeth import ToothDifferences


@dataclass(frozen=True, slots=True, kw_only=True)
class ToothCrack:
    """One soft tooth of pinion or gear."""

    stiffness_loss: float  # q
    tooth: int = 0  # counted as the passages count
    on: str = "pinion"  # or "gear"
    onset_depth: float = 0.0  # of the mean flank when it set in: from then on the teeth wear differently [m]

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(name="stiffness_loss", unit="", low=0.0, high=0.95, prior=0.3),
        Parameter(name="tooth", unit="", low=0, high=10_000, prior=10_000, shape=True),
        Parameter(name="onset_depth", unit="m", low=0.0, high=1e-2, prior=1e-2, shape=True),
    )
    signature: ClassVar[Signature] = Signature(shape="local", shafts=("pinion", "gear", "other"), load="rises")
    facts: ClassVar[Facts] = Facts(
        label="a cracked tooth",
        action="Stop the machine as soon as that is safe and inspect the teeth for a crack.",
        stated=("tooth",),
        acts_on="teeth",
        periods=("pinion", "gear"),
        detector="crack",
        alarm_class="alarm",
    )

    def __post_init__(self) -> None:
        check(self)
        if self.on not in ("pinion", "gear"):
            raise ParameterError(f'on = "{self.on}" must be "pinion" or "gear"')

    @property
    def period(self) -> str:
        return self.on

    def differences(self, teeth: tuple[int, int]) -> ToothDifferences:
        """What sets the teeth apart as they wear."""
        gear = self.on == "gear"
        loss = tuple(self.stiffness_loss if k == self.tooth else 0.0 for k in range(teeth[gear]))
        return ToothDifferences(stiffness_loss=((), loss) if gear else (loss, ()), onset_depth=self.onset_depth)

    def apply(self, setup: Setup) -> Setup:
        gear = self.on == "gear"
        z = setup.pair.teeth[gear]
        if not self.tooth < z:
            raise ParameterError(f"tooth = {self.tooth} must be below the {self.on}'s {z} teeth, counted from 0")
        tooth = setup.passages.gear_tooth if gear else setup.passages.pinion_tooth
        return setup.with_stiffness(np.where(tooth == self.tooth, 1 - self.stiffness_loss, 1.0))
