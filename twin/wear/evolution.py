"""Wear and vibration driving each other: the master curve.

    dh/dN = (K·τ·ω1)·(1 + z1/z2)²·smoothed(F·|s|)[h]

At constant operating conditions only the product x = K·τ·ω1·N appears (N pinion revolutions), so one curve
h(x) serves every wear coefficient: a change of K is a rescale of N. A change of the operating condition starts a
new curve from the present profile.

The steps are set by depth, not by revolutions. Second order: Adams–Bashforth with variable steps, after a
first midpoint step; every step solves the steady state once.

Source   E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., ch. III.1 and III.5
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from twin.dynamics.harmonic_balance import SteadyState
from twin.dynamics.mesh import PairMesh
from twin.errors import ParameterError
from twin.wear.archard import wear_per_revolution
from twin.wear.profile import WornProfile

Solver = Callable[[WornProfile, SteadyState | None], SteadyState]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WearPoint:
    """One state on the way from new to worn."""

    work: float  # x = K·τ·ω1·N [rad/N]
    profile: WornProfile
    steady: SteadyState


def step_size(depth: float, largest: float) -> float:
    """Depth of the next step [m]: 0.5 µm at first, 2 % of what is worn later, never above `largest`."""
    return min(max(0.5e-6, 0.02 * depth), largest)


def evolve(
    mesh: PairMesh,
    solver: Solver,
    start: WornProfile,
    half_width: float,
    until_depth: float,
    *,
    largest_step: float = 4e-6,
    step: Callable[[float, float], float] = step_size,
) -> Iterator[WearPoint]:
    """Points from the start profile until the largest combined depth reaches `until_depth` [m].

    solver  gives the steady state of a profile, starting from that of an earlier one
    Raises NotConverged where a steady state does not exist; what was yielded before stays valid.
    """
    if not 0 < largest_step < 1e-4:
        raise ParameterError(f"largest_step = {largest_step:g} m is outside (0, 1e-4); micrometres?")
    work, profile = 0.0, start
    steady = solver(profile, None).require_converged()
    before: tuple[float, np.ndarray] | None = None
    while True:
        yield WearPoint(work=work, profile=profile, steady=steady)
        if profile.max_depth >= until_depth:
            return
        rate = wear_per_revolution(mesh, steady.contact_forces, half_width)
        dx = step(profile.max_depth, largest_step) / float(rate[profile.on_active].max())
        if before is None:
            half = solver(profile.worn_by(0.5 * dx * rate), steady).require_converged()
            grown = dx * wear_per_revolution(mesh, half.contact_forces, half_width)
        else:
            last_dx, last_rate = before
            grown = dx * (rate + dx / (2 * last_dx) * (rate - last_rate))
        before = (dx, rate)
        work, profile = work + dx, profile.worn_by(grown)
        steady = solver(profile, steady).require_converged()
