"""Archard's law: the depth lost is proportional to the sliding work, whatever was lost before.

    dh/dx = w

h   combined depth [m];   w   sliding work, see twin.wear.laws.law [N·m];   x = K·τ·ω1·N [rad/N]

Source   J. F. Archard, J. Appl. Phys. 24 (1953) 981–988; of gears: A. Flodin, S. Andersson, Wear 207 (1997) 16–23
Holds    mild wear of surfaces that have run in
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import ClassVar, Self

import numpy as np

from twin.wear.laws.law import LawParameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Archard:
    """One wear coefficient for all flank points at all times."""

    name: ClassVar[str] = "archard"
    parameters: ClassVar[tuple[LawParameter, ...]] = ()

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Self:
        return cls()

    def rate(self, work: np.ndarray, worn: np.ndarray) -> np.ndarray:
        """dh/dx = w [m·N/rad]; `worn` does not matter."""
        return work

    def longest_step(self, depth: float) -> float:
        return inf
