"""How deep wear lies over the flank, by its largest depth, where only that depth was measured.

    load sharing   the rig's wear law with the forces of the quasi-static mesh, from new flanks on (twin.wear)
    sliding        h(s) ∝ sqrt(s² + a²): every pair carries the same force all the way, a the contact's half-width
    even part      h = q·depth everywhere + (1 − q) of another shape

The quasi-static mesh wears the same at any speed; where a machine was worn otherwise than by running, the shape
is an assumption, and what it does is tried.

Source   as twin.wear.archard and twin.wear.evolution
Ignores  the corners that deep wear moves inwards
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.dynamics.harmonic_balance import Contacts, SteadyState, quasi_static_deflection
from twin.errors import ParameterError
from twin.model import Condition, Model
from twin.wear.evolution import evolve
from twin.wear.law_of_rig import law_of
from twin.wear.profile import WornProfile

Wear = Callable[[float], WornProfile]  # largest combined depth [m] → worn flanks

KEPT = 5e-6  # between the profiles that are kept [m]
SAMPLES = 256  # a mesh period: one a point of the worn profile


@dataclass(frozen=True, eq=False, kw_only=True)
class WearHistory:
    """Profiles by their largest depth."""

    start: WornProfile
    depth: np.ndarray  # (m,) [m], rising from 0
    profiles: np.ndarray  # (m, p) [m]

    def __call__(self, depth: float) -> WornProfile:
        """The profile of a largest depth [m]; ParameterError beyond the last."""
        if not 0 <= depth <= self.depth[-1]:
            raise ParameterError(
                f"depth = {depth:g} m is outside 0 … {self.depth[-1]:g} m, for which wear was computed"
            )
        i = min(max(int(np.searchsorted(self.depth, depth)) - 1, 0), self.depth.size - 2)
        t = (depth - self.depth[i]) / (self.depth[i + 1] - self.depth[i])
        profile = self.start.worn_by((1 - t) * self.profiles[i] + t * self.profiles[i + 1])
        between = profile.max_depth  # a little less than asked for where the deepest place moves
        return self.start.worn_by(profile.depth * (depth / between)) if between > 0 else profile


def quasi_static_state(contacts: Contacts, mean_force: float) -> SteadyState:
    """The mesh without inertia as a steady state: at every instant the drive flanks carry the mean force [N]."""
    d = quasi_static_deflection(contacts, mean_force)
    drive = contacts.side > 0
    pressed = np.where(drive[:, None], np.maximum(d + contacts.separation, 0.0), 0.0)
    forces = contacts.stiffness * pressed
    lines = np.zeros(contacts.samples // 2 + 1, dtype=complex)
    lines[0] = mean_force
    return SteadyState(
        deflection=d,
        quasi_static=d,
        contact_forces=forces,
        mesh_force=forces.sum(axis=0),
        force_lines=lines,
        action_lines=(),
        omega=contacts.omega,
        residual=0.0,
        iterations=0,
        converged=True,
    )


def by_load_sharing(model: Model, condition: Condition, until: float) -> WearHistory:
    """The rig's wear law with quasi-static forces until a largest depth [m]."""
    coarse = Model.of(model.rig, model.calibration, samples=SAMPLES)
    force, c = coarse.mean_force(condition), coarse.calibration

    def solver(profile: WornProfile, _: SteadyState | None) -> SteadyState:
        contacts = coarse.mesh.contacts(profile, condition.speed_hz, stiffness_scale=c.stiffness_scale)
        return quasi_static_state(contacts, force)

    depth, profiles = [0.0], [coarse.unworn.depth]
    for point in evolve(coarse.mesh, solver, coarse.unworn, c.contact_half_width, until, law=law_of(model.rig)):
        worn = point.profile.max_depth
        if worn >= depth[-1] + KEPT or worn >= until:
            depth.append(worn)
            profiles.append(point.profile.depth)
    return WearHistory(start=coarse.unworn, depth=np.array(depth), profiles=np.array(profiles))


def by_sliding(model: Model) -> Wear:
    """Depth in proportion to the sliding distance, the mesh's load spread evenly over the path."""
    unworn, a = model.unworn, model.calibration.contact_half_width
    shape = np.sqrt(unworn.positions**2 + a**2)
    shape = shape / shape[unworn.on_active].max()
    return lambda depth: unworn.worn_by(depth * shape)


def with_even_part(wear: Wear, share: float) -> Wear:
    """A share of the depth lies evenly over the whole flank, the rest as `wear` has it."""
    if not 0 <= share < 1:
        raise ParameterError(f"share = {share:g} of even wear is outside [0, 1)")

    def profile(depth: float) -> WornProfile:
        part = wear((1 - share) * depth)
        return part.worn_by(np.full_like(part.depth, share * depth))

    return profile
