"""The hunting-tooth period: until the same tooth of the pinion meets the same tooth of the gear again.

    mesh periods  lcm(z1, z2)          pinion turns  lcm(z1, z2)/z1          (19/52: 988 and 52)

Every pinion tooth meets gear teeth in turn, so what differs from tooth to tooth or over a turn of a shaft
repeats no earlier. The contacts of one mesh period are laid end to end over the whole record, each knows which teeth
it joins, and errors of any kind add to its separation; the same `solve` gives the steady state.

    e_p(t) = −h(s_p) − gap(s_p) + Σ errors(s_p, θ1, θ2, tooth of the pinion, tooth of the gear)

Counting  mesh period j is centred on the passage of pair j through the pitch point: pinion tooth j mod z1 on gear
          tooth j mod z2. The back flank of pinion tooth j touches the gear tooth behind, j + 1.
Angles    θ1 = 2π·j/z1 and θ2 = 2π·j/z2 grow with the rotation and are zero when pair 0 passes the pitch point
Source    the name and the count: D. W. Dudley, Gear Handbook, McGraw-Hill 1962, ch. 5
Holds     steady operation; the shaft orders that repeat over the record
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import lcm, pi

import numpy as np

from twin.dynamics.harmonic_balance import Contacts
from twin.dynamics.mesh import ROWS, PairMesh
from twin.mesh.back_flank import back_flank_position
from twin.wear.profile import WornProfile

SAMPLES = 64  # a mesh period: 63,232 over the record of the 19/52 pair


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Passages:
    """Where every contact of the record is and which teeth it joins; drive flanks first, then back flanks."""

    position: np.ndarray  # s_p or s_b (p, n) [m]
    side: np.ndarray  # +1 drive, −1 back (p, 1)
    pinion_angle: np.ndarray  # θ1 (n,) [rad]
    gear_angle: np.ndarray  # θ2 (n,) [rad]
    pinion_tooth: np.ndarray  # 0 … z1 − 1 (p, n)
    gear_tooth: np.ndarray  # 0 … z2 − 1 (p, n)


#: Added separation [m], positive where there is more material, and its slope along θ1 [m/rad]; to broadcast to (p, n).
Error = Callable[[Passages], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False, kw_only=True)
class HuntingPeriod:
    """The contacts of one pair over its hunting-tooth period."""

    mesh: PairMesh  # of one mesh period

    @classmethod
    def of(cls, mesh: PairMesh, samples: int = SAMPLES) -> HuntingPeriod:
        """Over the hunting-tooth period of a mesh, with `samples` a mesh period."""
        coarse = PairMesh(pair=mesh.pair, stiffness=mesh.stiffness, corner=mesh.corner, samples=samples)
        return cls(mesh=coarse)

    @property
    def mesh_periods(self) -> int:
        """lcm(z1, z2)."""
        return lcm(*self.mesh.pair.teeth)

    @property
    def pinion_turns(self) -> int:
        return self.mesh_periods // self.mesh.pair.teeth[0]

    @property
    def samples(self) -> int:
        """Of the whole record."""
        return self.mesh_periods * self.mesh.samples

    @cached_property
    def passages(self) -> Passages:
        """Which tooth is where, over the record."""
        return self.first_passages(self.mesh_periods)

    def first_passages(self, periods: int) -> Passages:
        """The beginning of the record, so many mesh periods long."""
        z1, z2 = self.mesh.pair.teeth
        n = self.mesh.samples
        turned = np.arange(periods * n) / n  # mesh periods since pair 0 passed the pitch point
        nearest = np.repeat(np.arange(periods), n) + np.tile(np.arange(n) >= n / 2, periods)
        drive = nearest - np.array(ROWS)[:, None]  # a pair ahead on the path came earlier
        ahead = (
            back_flank_position(self.mesh.pair, self.mesh.back_positions) - self.mesh.phase
        ) / self.mesh.pair.base_pitch
        back = nearest - np.tile(np.rint(ahead).astype(int), periods)
        return Passages(
            position=np.tile(np.concatenate((self.mesh.positions, self.mesh.back_positions)), periods),
            side=np.array([1.0] * len(ROWS) + [-1.0] * len(ROWS))[:, None],
            pinion_angle=2 * pi / z1 * turned,
            gear_angle=2 * pi / z2 * turned,
            pinion_tooth=np.concatenate((drive, back)) % z1,
            gear_tooth=np.concatenate((drive, back + 1)) % z2,
        )

    def contacts(
        self,
        profile: WornProfile,
        pinion_speed_hz: float,
        errors: tuple[Error, ...] = (),
        *,
        stiffness_scale: float = 1.0,
        damping_time: float = 0.0,
    ) -> Contacts:
        """All contacts of the record, worn as the profile says on every tooth, with errors added.

        pinion_speed_hz [Hz], stiffness_scale on every pair, damping_time τ [s].
        """
        one = self.mesh.contacts(profile, pinion_speed_hz, stiffness_scale=stiffness_scale, damping_time=damping_time)
        separation = np.tile(one.separation, self.mesh_periods)
        rate = np.tile(one.separation_rate, self.mesh_periods)
        for error in errors:
            added, slope = error(self.passages)
            separation += added
            rate += 2 * pi * pinion_speed_hz * np.asarray(slope)
        return Contacts(
            stiffness=np.tile(one.stiffness, self.mesh_periods),
            separation=separation,
            separation_rate=rate,
            side=one.side,
            damping_time=damping_time,
            period=one.period * self.mesh_periods,
        )
