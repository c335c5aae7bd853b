"""Wear that differs from tooth to tooth: how far every flank departs from the mean flank as wear goes on.

    e_p = −(h1[i] + h2[j])(s_p) − gap(s_p) + f1[i] + f2[j]        k_p = (1 − q1[i])·(1 − q2[j])·k(s_p)
    Σ_p k_p·max(0, d + e_p) = F                                   of the pairs (i, j) in contact, at rest
    dh1[i]/dx = a1·law((1 + z1/z2)²·smoothed(<F_ij>·|s|), h1[i]/a1)      mean over the teeth j that tooth i meets

    departure[i] = h1[i] − a1·h        h: the same of teeth that are alike, worn as deep

f1, f2  displacement of each tooth along the line of action                             [m]
q1, q2  loss of stiffness of each tooth
h1, h2  depth of each flank                                                             [m]
x       work, K·τ·ω1·revolutions                                                        [rad/N]
a1, a2  shares of pinion and gear in the combined depth, 1/(1 + z1/z2) and 1/(1 + z2/z1)

A tooth that protrudes, or that is stiffer than its neighbours, carries more where two pairs touch, and wears faster
there, until its flank has adapted: with stiffness κ of both pairs, a difference e between them that only one gear has
dies out as

    e ∝ exp(−h̄/λ),    λ = F/(2κ)        h̄ depth of that gear's mean flank; λ the deflection of two pairs in contact

Where one pair touches alone it carries everything whatever its place: nothing adapts there, and the pattern remains.
Each tooth of one gear meets every z-th of the other, z the greatest common divisor of the numbers of teeth: all of them
where the numbers are relatively prime, always the same in a ratio that is a whole number.

Source   law and smoothing: twin/wear/archard.py; load sharing: twin/dynamics; A. Flodin, S. Andersson, Wear 207 (1997)
Holds    teeth that differ by up to some tens of micrometres; either torque of a machine that runs under a few
Ignores  dynamic forces in what differs from tooth to tooth; differences of the load across the face
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import gcd, lcm

import numpy as np

from twin.compiled import averages
from twin.compiled.load_sharing import share_load
from twin.dynamics.mesh import PairMesh
from twin.errors import ParameterError
from twin.wear.archard import elliptic_twice, pinion_share
from twin.wear.chebyshev import scheme, stages_for
from twin.wear.evolution import StepSizes, sharing_rate
from twin.wear.laws.law import WearLaw

POINTS = 64  # a base pitch: pattern lines within 1 % of those with 128 (reference rig)
STEPS = StepSizes(first=0.3e-6, share=0.15, largest=6e-6)
ALIKE_STEPS = StepSizes(first=0.1e-6, share=0.05, largest=3e-6)  # cheap: a single tooth of each gear
Flanks = tuple[np.ndarray, np.ndarray]  # of pinion and gear (teeth, m) each


@dataclass(frozen=True, slots=True, kw_only=True)
class ToothDifferences:
    """What sets the teeth of pinion and gear apart from a depth on; an empty tuple is a gear whose teeth are alike."""

    displacement: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())  # f1 (z1,), f2 (z2,), more material > 0 [m]
    stiffness_loss: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())  # q1 (z1,), q2 (z2,), below 1
    onset_depth: float = 0.0  # largest combined depth of the mean flank from which they are there [m]

    def on(self, gear: int) -> bool:
        """Whether the teeth of the pinion (0) or the gear (1) differ."""
        return any(self.displacement[gear]) or any(self.stiffness_loss[gear])


@dataclass(frozen=True, kw_only=True)
class Sharing:
    """A mesh under load, at rest."""

    mesh: PairMesh
    stiffness_scale: float
    force: float  # [N]
    half_width: float  # of the contact [m]
    law: WearLaw

    @property
    def positions(self) -> np.ndarray:
        """Points of the flanks along the path (3·POINTS,) [m], from one and a half base pitches before the pitch
        point on."""
        return self.mesh.pair.base_pitch / POINTS * (np.arange(3 * POINTS) - 3 * POINTS // 2)

    @property
    def decay(self) -> float:
        """How fast differences between pairs in contact die out with depth, at most [1/m]."""
        return self.stiffness_scale * sharing_rate(self.mesh, self.force)

    def classes(self, differences: Sequence[ToothDifferences]) -> tuple[int, int]:
        """Teeth of pinion and gear that wear differently; the others repeat them."""
        teeth = self.mesh.pair.teeth
        for gear in (0, 1):
            for d in differences:
                for values in (d.displacement[gear], d.stiffness_loss[gear]):
                    if len(values) not in (0, teeth[gear]):
                        raise ParameterError(f"{len(values)} values for {teeth[gear]} teeth: one each")
        differ = [any(d.on(gear) for d in differences) for gear in (0, 1)]
        if not any(differ):
            return 1, 1
        common = gcd(*teeth)
        return (teeth[0] if differ[0] else common), (teeth[1] if differ[1] else common)


class DifferingFlanks:
    """Flanks of all teeth by the largest depth of their mean, computed as far as somebody asks."""

    def __init__(self, sharing: Sharing, differences: Sequence[ToothDifferences], steps: StepSizes = STEPS) -> None:
        pair, s = sharing.mesh.pair, sharing.positions
        self.sharing, self._steps = sharing, steps
        self._differences = sorted(differences, key=lambda d: d.onset_depth)
        self.classes = sharing.classes(differences)
        self.shares = pinion_share(pair), 1 - pinion_share(pair)
        self._periods = lcm(*self.classes)
        self._stiffness = sharing.stiffness_scale * sharing.mesh.stiffness(s)
        self._gap = sharing.mesh.corner(s)[0]
        self._active = (s >= pair.path_start) & (s <= pair.path_end)
        self._arm = (1 + pair.teeth[0] / pair.teeth[1]) ** 2 * np.abs(s)
        self._weights = elliptic_twice(sharing.half_width, pair.base_pitch / POINTS)
        first = (np.zeros((self.classes[0], s.size)), np.zeros((self.classes[1], s.size)))
        self._depths, self._flanks = [0.0], [first]

    def at(self, depth: float) -> Flanks:
        """Flanks (classes, 3·POINTS) [m] whose mean is worn to a largest combined depth [m]."""
        while self._depths[-1] < depth:
            self._advance()
        if depth <= 0.0:
            return self._flanks[0]
        i = int(np.searchsorted(self._depths, depth))
        t = (depth - self._depths[i - 1]) / (self._depths[i] - self._depths[i - 1])
        before, after = self._flanks[i - 1], self._flanks[i]
        return before[0] + t * (after[0] - before[0]), before[1] + t * (after[1] - before[1])

    @property
    def nbytes(self) -> int:
        return len(self._depths) * sum(flank.nbytes for flank in self._flanks[0])

    def rates(self, flanks: Flanks, depth: float) -> Flanks:
        """dh/dx of every flank [m·N/rad], with the differences that are there at a largest depth [m]."""
        acting = [d for d in self._differences if d.onset_depth <= depth]
        missing, share, force = [], [], self.sharing.force
        for gear, (flank, z) in enumerate(zip(flanks, self.classes, strict=True)):
            moved, kept = np.zeros(z), np.ones(z)
            for d in acting:
                if d.displacement[gear]:
                    moved = moved + np.array(d.displacement[gear])
                if d.stiffness_loss[gear]:
                    kept = kept * (1 - np.array(d.stiffness_loss[gear]))
            missing.append(flank - moved[:, None])
            share.append(kept)
        m1, m2 = missing
        c1, c2 = share
        loads = share_load(self._periods, self._stiffness, self._gap, (m1, m2), (c1, c2), force)
        return self._rate(loads[0], flanks[0], self.shares[0]), self._rate(loads[1], flanks[1], self.shares[1])

    def _rate(self, load: np.ndarray, flank: np.ndarray, share: float) -> np.ndarray:
        """dh/dx [m·N/rad] of flanks (classes, 3·POINTS) of one gear by what they carry [N]; its share of the depth."""
        work = averages(load * self._arm, self._weights, 1)[:, :-1]
        return share * self.sharing.law.rate(work, flank / share)

    def _advance(self) -> None:
        """One step more, of as many stages as its stability asks for."""
        depth, flanks = self._depths[-1], self._flanks[-1]
        onsets = [d.onset_depth for d in self._differences]
        since = max((o for o in onsets if o <= depth), default=0.0)
        size = self._steps.size(depth - since, self._steps.largest)
        size = min([size, *(o - depth for o in onsets if o > depth)])
        there = self.rates(flanks, depth)
        fastest = float((there[0].mean(axis=0) + there[1].mean(axis=0))[self._active].max())
        dx = size / fastest
        by = scheme(stages_for(size * self.sharing.decay))
        last, between = flanks, tuple(h + by.rate[1] * dx * r for h, r in zip(flanks, there, strict=True))
        for j in range(2, by.stages + 1):
            now = self.rates((between[0], between[1]), depth)
            last, between = (between[0], between[1]), tuple(
                (1 - by.own[j] - by.before[j]) * h + by.own[j] * b + by.before[j] * before
                + dx * (by.rate[j] * r + by.first_rate[j] * first)
                for h, b, before, r, first in zip(flanks, between, last, now, there, strict=True)
            )  # fmt: skip
        pinion, gear = (np.maximum(b, h) for b, h in zip(between, flanks, strict=True))
        reached = float((pinion.mean(axis=0) + gear.mean(axis=0))[self._active].max())
        nearest = min((o for o in onsets if o > depth), default=np.inf)
        if abs(reached - nearest) < 0.5 * self._steps.first:
            reached = nearest
        self._depths.append(max(reached, depth + 1e-12))
        self._flanks.append((pinion, gear))


@lru_cache(maxsize=16)  # some 3 MB each
def flanks_of(sharing: Sharing, differences: tuple[ToothDifferences, ...]) -> DifferingFlanks:
    """The flanks of a mesh under load, kept: later windows go on from where earlier ones ended."""
    return DifferingFlanks(sharing, differences, STEPS if any(d.on(0) or d.on(1) for d in differences) else ALIKE_STEPS)


def departures(sharing: Sharing, differences: tuple[ToothDifferences, ...], depth: float) -> Flanks:
    """What the flanks of teeth that differ have lost more than those of teeth alike, as deep in the mean.

    (teeth that differ, 3·POINTS) [m] of pinion and gear; teeth beyond these repeat them.
    """
    own, alike = flanks_of(sharing, differences), flanks_of(sharing, ()).at(depth)
    pinion, gear = (flank - same for flank, same in zip(own.at(depth), alike, strict=True))
    return pinion, gear
