"""What every wear law is.

    dh/dx = law(w, h)          w = (1 + z1/z2)²·smoothed(F·|s|)          x = K·τ·ω1·N

h   combined depth of a flank point                                              [m]
w   sliding work at that point per pinion revolution and unit of K·τ·ω1          [N·m]
x   the master curve's variable, in which every law's rate is proportional to K  [rad/N]

A law sees the sliding work of one revolution at every flank point and what that point has lost before. So a wear
coefficient that depends on the history of a point is a law; one that depends on speed, temperature or lubrication from
window to window is not: that is for the track of K (twin.updating.tracker).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class LawParameter:
    """A number that a law needs: key `[wear.<law>] <key>` of the rig file."""

    key: str
    meaning: str
    unit: str
    low: float  # exclusive
    high: float  # inclusive
    hint: str = ""  # what is probably wrong with a value outside


class WearLaw(Protocol):
    """One law of the family; a frozen dataclass."""

    name: ClassVar[str]  # key of the table, and of `[wear] law`
    parameters: ClassVar[tuple[LawParameter, ...]]

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Self:
        """The law with its parameters by key."""

    def rate(self, work: np.ndarray, worn: np.ndarray) -> np.ndarray:
        """dh/dx [m·N/rad] by the sliding work w [N·m] and the depth lost before [m]; all of the same shape."""

    def longest_step(self, depth: float) -> float:
        """Longest step of the largest depth [m] that resolves the law where this depth [m] is worn off."""
