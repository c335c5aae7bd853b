"""The mesh of one pair as the contacts that a solver sees.

Contact p of the drive side is at s_p(t) = s(t) + p·p_b on the path of contact, s' = ω1·r_b1. Its separation
is e_p = −h(s_p) − gap(s_p), with h the material worn off both flanks (positive) and gap the corner contact
outside the nominal path. On the back side a tooth of the other flank closes the mesh where the drive side
opens by the backlash.

Holds    contact ratios up to 2
Ignores  that the back flanks press along the mirrored line of action: the solvers see one coordinate d, so their
         play is off by 2 sin α·(x5 − x10), some micrometres, and they push the gears together in x instead of apart
Source   physics of the loaded spur mesh as in the paper's eqs 3–5, with e_t of the paper written per tooth pair
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import pi

import numpy as np
from scipy.interpolate import CubicSpline

from twin.dynamics.harmonic_balance import Contacts
from twin.errors import ParameterError
from twin.geometry import GearPair
from twin.mesh.back_flank import back_flank_position
from twin.mesh.corner_contact import corner_gap
from twin.mesh.stiffness import PairStiffness
from twin.wear.profile import WornProfile

ROWS = (-1, 0, 1)  # tooth pairs that can touch at one instant, counted from the one nearest the pitch point
SIDES = np.array([1.0] * len(ROWS) + [-1.0] * len(ROWS))  # of every contact: +1 drive flank, −1 back flank
APART = 1.0  # gap of a pair that is out of reach [m]
REACH = 1e-3  # corner contact farther apart than this never closes [m]


@dataclass(frozen=True, eq=False, kw_only=True)
class CornerContact:
    """Gap of the corner contact outside the nominal path, and its slope, from C2 splines of its square root.

    The gap starts with zero slope at the path's ends and grows about as the square of the overshoot.
    """

    pair: GearPair
    sides: tuple[CubicSpline, CubicSpline]  # sqrt(gap) against the overshoot, before and after the path [m]

    @classmethod
    def of(cls, pair: GearPair) -> CornerContact:
        x = np.linspace(0, 0.8 * pair.base_pitch, 801)
        sides = []
        for s in (pair.path_start - x, pair.path_end + x):
            gap = corner_gap(pair, s)
            usable = np.isfinite(gap) & (gap <= 1.1 * REACH)
            last = usable.size if usable.all() else int(np.argmin(usable))
            sides.append(CubicSpline(x[:last], np.sqrt(gap[:last])))
        return cls(pair=pair, sides=(sides[0], sides[1]))

    def __call__(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gap [m] and d(gap)/ds at path positions; a pair out of reach is `APART`, with no slope."""
        gap, slope = np.zeros_like(s), np.zeros_like(s)
        overshoots = (self.pair.path_start - s, s - self.pair.path_end)
        for sign, overshoot, side in zip((-1, 1), overshoots, self.sides, strict=True):
            outside = overshoot > 0
            x = np.minimum(overshoot[outside], side.x[-1])
            root = side(x)
            reached = (overshoot[outside] <= side.x[-1]) & (root**2 <= REACH)
            gap[outside] = np.where(reached, root**2, APART)
            slope[outside] = np.where(reached, sign * 2 * root * side(x, 1), 0.0)
        return gap, slope


@dataclass(frozen=True, eq=False, kw_only=True)
class PairMesh:
    """Stiffness and separation of every tooth pair along one mesh period."""

    pair: GearPair
    stiffness: PairStiffness
    corner: CornerContact
    samples: int  # a mesh period

    def __post_init__(self) -> None:
        if self.samples < 64 or self.samples % 2:
            raise ParameterError(f"samples = {self.samples} a mesh period must be even and at least 64")

    @classmethod
    def of(cls, pair: GearPair, samples: int = 1024, stiffness: PairStiffness | None = None) -> PairMesh:
        """The mesh of a pair, with its stiffness by the potential-energy method unless another is handed in."""
        k = PairStiffness.of(pair) if stiffness is None else stiffness
        return cls(pair=pair, stiffness=k, corner=CornerContact.of(pair), samples=samples)

    @cached_property
    def phase(self) -> np.ndarray:
        """Position of the pair nearest the pitch point (n,) [m], −p_b/2 ≤ s < p_b/2, pitch point at t = 0."""
        x = np.arange(self.samples) / self.samples
        return self.pair.base_pitch * (x - (x >= 0.5))

    @cached_property
    def positions(self) -> np.ndarray:
        """s_p of every drive contact (3, n) [m]."""
        return self.phase + self.pair.base_pitch * np.array(ROWS)[:, None]

    @cached_property
    def sliding_arm(self) -> np.ndarray:
        """|s| of every drive contact, in rising order of s, one row behind the other (3·n,) [m]."""
        return np.abs(np.sort(self.positions, axis=1).reshape(-1))

    @cached_property
    def back_positions(self) -> np.ndarray:
        """s_b of every back contact (3, n) [m]; moves against s."""
        p = self.pair.base_pitch
        nearest = (back_flank_position(self.pair, self.phase) + p / 2) % p - p / 2
        return nearest + p * np.array(ROWS)[:, None]

    @cached_property
    def drive_tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stiffness [N/m], corner gap [m] and its slope of every drive contact, each (3, n)."""
        return self.stiffness(self.positions), *self.corner(self.positions)

    @cached_property
    def back_tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same for the back flanks."""
        return self.stiffness(self.back_positions), *self.corner(self.back_positions)

    @cached_property
    def _gaps(self) -> tuple[np.ndarray, np.ndarray]:
        """Gap [m] of every contact of unworn teeth, drive flanks first, and its slope along s (6, n)."""
        (_, gap, slope), (_, gap_b, slope_b) = self.drive_tables, self.back_tables
        return np.concatenate((gap, gap_b + self.pair.backlash)), np.concatenate((slope, -slope_b))

    def contacts(
        self,
        profile: WornProfile,
        pinion_speed_hz: float,
        *,
        stiffness_scale: float = 1.0,
        damping_time: float = 0.0,
    ) -> Contacts:
        """All contacts of one mesh period, worn as the profile says.

        pinion_speed_hz [Hz], stiffness_scale on every pair, damping_time τ [s].
        """
        if not pinion_speed_hz > 0:
            raise ParameterError(f"pinion_speed_hz = {pinion_speed_hz:g} Hz must be positive")
        speed = 2 * pi * pinion_speed_hz * self.pair.base_radius[0]  # s' [m/s]
        gap, slope = (table.copy() for table in self._gaps)
        worn, worn_slope = profile.at(self.positions)
        gap[: len(ROWS)] += worn
        slope[: len(ROWS)] += worn_slope
        return Contacts(
            stiffness=_stiffness(self, stiffness_scale),
            separation=np.negative(gap, out=gap),
            separation_rate=np.multiply(slope, -speed, out=slope),
            side=SIDES,
            damping_time=damping_time,
            period=self.pair.base_pitch / speed,
        )


@lru_cache(maxsize=16)
def _stiffness(mesh: PairMesh, scale: float) -> np.ndarray:
    """Of every contact, drive flanks first (6, n) [N/m]; read-only, since the contacts of all profiles share it."""
    table = scale * np.concatenate((mesh.drive_tables[0], mesh.back_tables[0]))
    table.flags.writeable = False
    return table
