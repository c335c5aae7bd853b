"""Wear and vibration driving each other: the master curve.

    dh/dN = (K·τ·ω1)·law(w[h], h),        w = (1 + z1/z2)²·smoothed(F·|s|)

law   one of twin.wear.laws; Archard's is law(w, h) = w

At constant operating conditions only the product x = K·τ·ω1·N appears (N pinion revolutions), so one curve
h(x) serves every wear coefficient: a change of K is a rescale of N. A change of the operating condition starts a
new curve from the present profile.

The steps are set by depth, not by revolutions, and taken by the midpoint rule: second order, and nothing that wore
off ever grows back, since every step adds a rate that was evaluated, not extrapolated.

The steps have an upper limit, too. Pairs in contact together share the force through their gaps: a pair ahead by
F/k carries everything, its mate nothing, so differences between them die out within about F/2k of wear. Explicit steps
longer than twice that make the load jump from one pair to the other and back with every step, which imprints waves on
the flanks. `stable_step` keeps below.

Source   E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., ch. II.1 (midpoint);
         E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., ch. IV.2 (stability)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from twin.dynamics.harmonic_balance import SteadyState
from twin.dynamics.mesh import PairMesh
from twin.errors import ParameterError
from twin.wear.archard import wear_per_revolution
from twin.wear.laws.archard import Archard
from twin.wear.laws.law import WearLaw
from twin.wear.profile import WornProfile

ARCHARD = Archard()
Solver = Callable[[WornProfile, SteadyState | None], SteadyState]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WearPoint:
    """One state on the way from new to worn."""

    work: float  # x = K·τ·ω1·N [rad/N]
    profile: WornProfile
    steady: SteadyState


def step_size(depth: float, largest: float) -> float:
    """Depth of the next step [m]: 0.2 µm at first, a tenth of what is worn later, never above `largest`."""
    return min(max(0.2e-6, 0.1 * depth), largest)


def _further(before: SteadyState, now: SteadyState, ratio: float) -> SteadyState:
    """The present state with the motion to which the change since an earlier one leads, so many times as far on."""
    changed = (now.deflection - now.quasi_static) - (before.deflection - before.quasi_static)
    return replace(now, deflection=now.deflection + ratio * changed)


def stable_step(mesh: PairMesh, mean_force: float) -> float:
    """Longest step [m] at which the pairs go on sharing the force: 0.75 F/k, k of the stiffest pair.

    The limit is about 1.15 F/k; the rest allows for a calibrated stiffness of up to 1.5 times the nominal.
    """
    return 0.75 * mean_force / float(mesh.stiffness.values.max())


def evolve(
    mesh: PairMesh,
    solver: Solver,
    start: WornProfile,
    half_width: float,
    until_depth: float,
    *,
    largest_step: float = 4e-6,
    step: Callable[[float, float], float] = step_size,
    law: WearLaw = ARCHARD,
) -> Iterator[WearPoint]:
    """Points from the start profile until the largest combined depth reaches `until_depth` [m].

    solver        gives the steady state of a profile, starting from that of an earlier one
    start         worn flanks, across the face in slices where the solver's contacts are
    law           by which the flanks wear
    largest_step  [m]; steps are never longer than `stable_step`, whatever it says; of the slice that wears fastest
    Raises NotConverged where a steady state does not exist; what was yielded before stays valid.
    """
    if not 0 < largest_step < 1e-4:
        raise ParameterError(f"largest_step = {largest_step:g} m is outside (0, 1e-4); micrometres?")
    work, profile, slices = 0.0, start, len(start.slices)
    steady = solver(profile, None).require_converged()
    before: SteadyState | None = None
    taken = 0.0
    largest = min(largest_step, stable_step(mesh, float(steady.force_lines[0].real)))
    while True:
        yield WearPoint(work=work, profile=profile, steady=steady)
        if profile.max_depth >= until_depth:
            return
        rate = law.rate(wear_per_revolution(mesh, steady.contact_forces, half_width, slices), profile.depth)
        longest = min(largest, law.longest_step(profile.max_depth))
        dx = min(step(profile.max_depth, longest), longest) / float(rate[..., profile.on_active].max())
        between = profile.worn_by(0.5 * dx * rate)
        near = steady if before is None else _further(before, steady, dx / taken)
        halfway = solver(between, near).require_converged()
        work_there = wear_per_revolution(mesh, halfway.contact_forces, half_width, slices)
        grown = dx * law.rate(work_there, between.depth)
        work, profile = work + dx, profile.worn_by(grown)
        steady, before, taken = solver(profile, _further(steady, halfway, 1.0)).require_converged(), halfway, dx
