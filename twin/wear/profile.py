"""Material worn off both flanks together, along the path of contact.

    h(s) = h1(s) + h2(s)

It may differ across the face, where the load does (misaligned shafts): then it is kept slice by slice, and its depth
is that of the mean over the face.

Both flanks lose the same depth in one passage; a pinion tooth passes once a pinion turn and a gear tooth
z1/z2 times, so the pinion's share of h is 1/(1 + z1/z2) everywhere (73.2 % for 19/52).

Source   paper, section 5 ("the combined wear of the two profiles: that of the pinion alone is about 73 %")
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin.compiled import spline
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
    """Combined wear depth on an even grid of path positions, of the whole face or of every slice across it."""

    positions: np.ndarray  # s (m,) [m]
    depth: np.ndarray  # h ≥ 0 (m,) or (slices, m) [m]
    active: tuple[float, float]  # nominal path of contact [m]

    def __post_init__(self) -> None:
        if self.positions.shape != self.depth.shape[-1:] or self.depth.ndim > 2:
            raise ParameterError(f"depth has shape {self.depth.shape}, positions {self.positions.shape}: one each")

    @classmethod
    def unworn(cls, pair: GearPair, points_per_pitch: int = POINTS_PER_PITCH) -> WornProfile:
        s = worn_grid(pair, points_per_pitch)
        return cls(positions=s, depth=np.zeros_like(s), active=(pair.path_start, pair.path_end))

    @cached_property
    def mean(self) -> np.ndarray:
        """Mean depth over the face (m,) [m]."""
        return self.depth if self.depth.ndim == 1 else self.depth.mean(axis=0)

    @cached_property
    def slices(self) -> tuple[WornProfile, ...]:
        """One profile a slice; itself where the face is worn evenly."""
        if self.depth.ndim == 1:
            return (self,)
        return tuple(WornProfile(positions=self.positions, depth=h, active=self.active) for h in self.depth)

    def across(self, slices: int) -> WornProfile:
        """The same wear, kept for so many slices across the face; of one slice the mean over the face.

        Itself where it is sliced as asked already. ParameterError where it is sliced otherwise.
        """
        have = 1 if self.depth.ndim == 1 else len(self.depth)
        if slices == have:
            return self
        if slices == 1:
            return WornProfile(positions=self.positions, depth=self.mean, active=self.active)
        if have > 1:
            raise ParameterError(f"a profile of {have} slices across the face cannot be kept for {slices} slices")
        return WornProfile(positions=self.positions, depth=np.tile(self.depth, (slices, 1)), active=self.active)

    def at(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean depth over the face [m] and its slope along s at any positions within the grid; C2."""
        if not self.depth.any():
            return np.zeros_like(s), np.zeros_like(s)
        depth, slope = spline(self.positions[0], self.spacing, self.mean[None], s.ravel())
        return depth.reshape(s.shape), slope.reshape(s.shape)

    @property
    def spacing(self) -> float:
        """Of the grid [m]."""
        return float(self.positions[-1] - self.positions[0]) / (self.positions.size - 1)

    @cached_property
    def on_active(self) -> np.ndarray:
        """Which grid points lie on the nominal path (m,)."""
        low, high = self.active
        return (self.positions >= low) & (self.positions <= high)

    @property
    def max_depth(self) -> float:
        """Largest combined depth on the nominal path of contact, of the mean over the face [m]."""
        return float(self.mean[self.on_active].max())

    def worn_by(self, depth: np.ndarray) -> WornProfile:
        """A profile with this much more material gone, (m,) or (slices, m) as it is itself [m]."""
        return WornProfile(positions=self.positions, depth=self.depth + depth, active=self.active)
