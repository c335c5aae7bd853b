"""Wear and vibration driving each other: the master curve.

    dh/dN = (K·τ·ω1)·law(w[h], h),        w = (1 + z1/z2)²·smoothed(F·|s|)

law   one of twin.wear.laws; Archard's is law(w, h) = w

At constant operating conditions only the product x = K·τ·ω1·N appears (N pinion revolutions), so one curve
h(x) serves every wear coefficient: a change of K is a rescale of N. A change of the operating condition starts a
new curve from the present profile.

The steps are set by depth, not by revolutions, and taken by a Runge–Kutta–Chebyshev method (twin.wear.chebyshev), which
is of second order. What has worn off does not grow back: each profile is at least as deep everywhere as the one before.

Stability counts because pairs in contact together share the force through their gaps: a pair ahead by F/k carries
everything, its mate nothing, so differences between them die out within about F/2k of wear. Steps that are too long for
that make the load jump from one pair to the other and back with every step, which imprints waves on the flanks.
`sharing_rate` says how fast they die out, and each step has as many stages as that needs.

Source   B. P. Sommeijer, L. F. Shampine, J. G. Verwer, J. Comput. Appl. Math. 88 (1998) 315–326
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from twin.dynamics.harmonic_balance import SteadyState
from twin.dynamics.mesh import PairMesh
from twin.errors import NotConverged, ParameterError
from twin.wear.archard import wear_per_revolution
from twin.wear.chebyshev import MOST_STAGES, scheme, stable_to, stages_for
from twin.wear.laws.archard import Archard
from twin.wear.laws.law import WearLaw
from twin.wear.profile import WornProfile

ARCHARD = Archard()
LAST_STEPS = 2e-6  # of steps towards the depth from which there is no steady state [m]
Solver = Callable[[WornProfile, SteadyState | None], SteadyState]
Rate = Callable[[WornProfile, SteadyState], np.ndarray]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WearPoint:
    """One state on the way from new to worn."""

    work: float  # x = K·τ·ω1·N [rad/N]
    profile: WornProfile
    steady: SteadyState
    rate: np.ndarray  # dh/dx of the profile [m·N/rad], of its shape


@dataclass(frozen=True, slots=True, kw_only=True)
class StepSizes:
    """Depths of the steps: the first ones, later a share of what is worn, and the largest."""

    first: float = 0.2e-6  # [m]
    share: float = 0.1
    largest: float = 4e-6  # [m]; of the slice that wears fastest
    by_slice: bool = False  # whether what is worn is that of the deepest slice; else of the mean over the face

    def size(self, depth: float, largest: float) -> float:
        """Depth of the next step [m], never above `largest`."""
        return min(max(self.first, self.share * depth), largest)


FINE = StepSizes()  # lines of acceleration within 3e-4 in the median of depths, 3e-3 at most (reference rig)
# within 1e-3 in the median; 1e-2 where some micrometres are worn, 3e-2 where one end of the face has worn alone
COARSE = StepSizes(first=0.3e-6, share=0.15, largest=6e-6, by_slice=True)


def sharing_rate(mesh: PairMesh, mean_force: float) -> float:
    """How fast differences between pairs in contact together die out with depth, at most [1/m]: 2.6 k/F.

    k is that of the stiffest pair. The midpoint rule, stable up to 1.97 over this rate, fails from steps of about
    1.15 F/k on: a rate of 1.7 k/F. The rest allows for a calibrated stiffness of up to 1.5 times the nominal.
    """
    return 2.6 * float(mesh.stiffness.values.max()) / mean_force


class _Course:
    """Solves steady states one after the other, each from where the two before it lead."""

    def __init__(self, solver: Solver, work: float, steady: SteadyState) -> None:
        self._solver, self._newest = solver, (work, steady)
        self._older: tuple[float, SteadyState] | None = None

    def solved(self, profile: WornProfile, work: float) -> SteadyState:
        """The steady state of a profile that is reached at a work [rad/N]; NotConverged where there is none."""
        found = self._solver(profile, self._towards(work)).require_converged()
        self._newest, self._older = (work, found), self._newest
        return found

    def _towards(self, work: float) -> SteadyState:
        """The newest state with the motion to which the change since the one before leads."""
        at, now = self._newest
        if self._older is None:
            return now
        then, before = self._older
        changed = (now.deflection - now.quasi_static) - (before.deflection - before.quasi_static)
        return replace(now, deflection=now.deflection + (work - at) / (at - then) * changed)


def _stepped(point: WearPoint, dx: float, stages: int, course: _Course, rate_of: Rate) -> WearPoint:
    """The point after one step of so much work [rad/N]."""
    by, profile = scheme(stages), point.profile
    between, last = profile.worn_by(by.rate[1] * dx * point.rate), profile
    for j in range(2, stages + 1):
        there = rate_of(between, course.solved(between, point.work + by.at[j - 1] * dx))
        depth = (
            (1 - by.own[j] - by.before[j]) * profile.depth + by.own[j] * between.depth + by.before[j] * last.depth
            + dx * (by.rate[j] * there + by.first_rate[j] * point.rate)
        )  # fmt: skip
        between, last = replace(profile, depth=depth), between
    work, profile = point.work + dx, replace(profile, depth=np.maximum(between.depth, profile.depth))
    steady = course.solved(profile, work)
    return WearPoint(work=work, profile=profile, steady=steady, rate=rate_of(profile, steady))


def evolve(
    mesh: PairMesh,
    solver: Solver,
    start: WornProfile,
    half_width: float,
    until_depth: float,
    *,
    largest_step: float = FINE.largest,
    step: Callable[[float, float], float] = FINE.size,
    by_slice: bool = FINE.by_slice,
    law: WearLaw = ARCHARD,
) -> Iterator[WearPoint]:
    """Points from the start profile until the largest combined depth reaches `until_depth` [m].

    solver        gives the steady state of a profile, starting from that of an earlier one
    start         worn flanks, across the face in slices where the solver's contacts are
    law           by which the flanks wear
    largest_step  [m]; of the slice that wears fastest
    step          the next step after a depth, of the deepest slice or of the mean over the face (`by_slice`) [m]
    Raises NotConverged where, approached in LAST_STEPS, a steady state does not exist; what was yielded stays valid.
    """
    if not 0 < largest_step < 1e-4:
        raise ParameterError(f"largest_step = {largest_step:g} m is outside (0, 1e-4); micrometres?")
    slices = len(start.slices)

    def rate_of(worn: WornProfile, under: SteadyState) -> np.ndarray:
        return law.rate(wear_per_revolution(mesh, under.contact_forces, half_width, slices), worn.depth)

    steady = solver(start, None).require_converged()
    point = WearPoint(work=0.0, profile=start, steady=steady, rate=rate_of(start, steady))
    decay = sharing_rate(mesh, float(steady.force_lines[0].real))
    largest, course = min(largest_step, stable_to(MOST_STAGES) / decay), _Course(solver, 0.0, steady)
    yield point
    while point.profile.max_depth < until_depth:
        depth = point.profile.max_depth
        longest = min(largest, law.longest_step(depth))
        worn = float(point.profile.depth[..., start.on_active].max()) if by_slice else depth
        size = min(step(worn, longest), longest)
        dx = size / float(point.rate[..., start.on_active].max())
        try:
            point = _stepped(point, dx, stages_for(size * decay), course, rate_of)
        except NotConverged:
            if size <= LAST_STEPS:
                raise
            largest, course = LAST_STEPS, _Course(solver, point.work, point.steady)
        else:
            yield point
