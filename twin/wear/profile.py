"""Material worn off both flanks together, along the path of contact.

    h(s) = h1(s) + h2(s)

Both flanks lose the same depth in one passage; a pinion tooth passes once a pinion turn and a gear tooth
z1/z2 times, so the pinion's share of h is 1/(1 + z1/z2) everywhere (73.2 % for 19/52).

Source   paper, section 5 ("the combined wear of the two profiles: that of the pinion alone is about 73 %")
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from twin.errors import ParameterError
from twin.geometry import GearPair

POINTS_PER_PITCH = 256


def worn_grid(pair: GearPair, points_per_pitch: int = POINTS_PER_PITCH) -> np.ndarray:
    """Path positions (m,) [m], evenly spaced by p_b/points_per_pitch through the pitch point, over one and a
    half base pitches to either side: beyond any contact, corner contact included."""
    half = 3 * points_per_pitch // 2
    return pair.base_pitch / points_per_pitch * np.arange(-half, half + 1)


@dataclass(frozen=True, eq=False, kw_only=True)
class WornProfile:
    """Combined wear depth on an even grid of path positions."""

    positions: np.ndarray  # s (m,) [m]
    depth: np.ndarray  # h ≥ 0 (m,) [m]
    active: tuple[float, float]  # nominal path of contact [m]

    def __post_init__(self) -> None:
        if self.positions.shape != self.depth.shape:
            raise ParameterError(f"depth has shape {self.depth.shape}, positions {self.positions.shape}: one each")

    @classmethod
    def unworn(cls, pair: GearPair, points_per_pitch: int = POINTS_PER_PITCH) -> WornProfile:
        s = worn_grid(pair, points_per_pitch)
        return cls(positions=s, depth=np.zeros_like(s), active=(pair.path_start, pair.path_end))

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(self.positions, self.depth)

    def at(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depth [m] and its slope along s at any positions within the grid; C2."""
        if not self.depth.any():
            return np.zeros_like(s), np.zeros_like(s)
        return self._spline(s), self._spline(s, 1)

    @cached_property
    def on_active(self) -> np.ndarray:
        """Which grid points lie on the nominal path (m,)."""
        low, high = self.active
        return (self.positions >= low) & (self.positions <= high)

    @property
    def max_depth(self) -> float:
        """Largest combined depth on the nominal path of contact [m]."""
        return float(self.depth[self.on_active].max())

    def worn_by(self, depth: np.ndarray) -> WornProfile:
        """A profile with this much more material gone (m,) [m]."""
        return WornProfile(positions=self.positions, depth=self.depth + depth, active=self.active)
