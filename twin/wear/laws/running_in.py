"""Running-in: fresh surfaces wear faster until their roughness is gone, then by Archard's law.

    h = u + d·(1 − exp(−(r − 1)·u/d)),        u = K·(sliding work per area)

is the sum of a steady part and a transient one that dies away with the sliding work, point by point of the flank. With
the sliding work put out of it by Lambert's W, the rate depends on what the point has lost:

    dh/dx = w·(1 + W((r − 1)·exp((r − 1)·(1 − h/d))))

h   combined depth that the point has lost                                           [m]
w   sliding work, see twin.wear.laws.law                                             [N·m]
x   K·τ·ω1·N, with K the coefficient of surfaces that have run in                    [rad/N]
r   wear coefficient of fresh surfaces over that of those that have run in, ≥ 1      [1]
d   combined depth that running-in takes off beyond the steady wear                  [m]

So h(x) at a point depends on K·N alone, as by Archard's law, which is the limit r → 1, or d → 0 once anything is worn.

Source   C. A. Queener, T. C. Smith, W. L. Mitchell, Wear 8 (1965) 391–400 (exponential transient and steady wear);
         R. M. Corless et al., Adv. Comput. Math. 5 (1996) 329–359 (Lambert's W)
Holds    one running-in; both flanks run in together
Ignores  running-in anew after a change of load, oil or of the other gear
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import ClassVar, Self

import numpy as np

from twin.errors import ParameterError
from twin.wear.laws.law import LawParameter

MOST_RATIO = 100.0
RESOLVED = 0.25  # step over the depth of running-in: the explicit midpoint rule is stable below 2
OVER = 20.0  # times d: the transient is then below e^-19 of its start for any r ≥ 2


@dataclass(frozen=True, slots=True, kw_only=True)
class RunningIn:
    """A wear coefficient that falls from r·K to K as a flank point loses its fresh surface."""

    initial_ratio: float  # r
    depth: float  # d [m]

    name: ClassVar[str] = "running_in"
    parameters: ClassVar[tuple[LawParameter, ...]] = (
        LawParameter(
            key="initial_ratio", unit="", low=1, high=MOST_RATIO,
            meaning="wear coefficient of fresh flanks over K, which is that of flanks that have run in",
        ),
        LawParameter(
            key="depth", unit="m", low=0, high=1e-3, hint="micrometres?",
            meaning="depth of both flanks together that running-in takes off beyond the steady wear",
        ),
    )  # fmt: skip

    def __post_init__(self) -> None:
        if not 1 <= self.initial_ratio <= MOST_RATIO:
            raise ParameterError(f"initial_ratio = {self.initial_ratio:g} is outside [1, {MOST_RATIO:g}]")
        if not self.depth > 0:
            raise ParameterError(f"depth = {self.depth:g} m of running-in must be positive")

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Self:
        return cls(**values)

    def factor(self, worn: np.ndarray) -> np.ndarray:
        """Wear coefficient over K where so much has been lost [m]; any shape → the same."""
        from scipy.special import lambertw  # loads scipy, which a start of the service does without

        a = self.initial_ratio - 1
        return 1 + lambertw(a * np.exp(a * (1 - np.asarray(worn) / self.depth))).real

    def rate(self, work: np.ndarray, worn: np.ndarray) -> np.ndarray:
        """dh/dx [m·N/rad]."""
        return self.factor(worn) * work

    def longest_step(self, depth: float) -> float:
        return RESOLVED * self.depth if depth < OVER * self.depth else inf
