"""What a rig file states twice and only nearly alike: estimates that are compared, not refused.

Each note says which value is used, what the other values of the file would make of it, and what to do. A file without
notes agrees with itself within the limits of `NoteLimits`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi

import numpy as np

from twin.dynamics.harmonic_balance import SteadyState
from twin.dynamics.mesh import PairMesh
from twin.errors import NotConverged, TwinError
from twin.levels.wear import quasi_static_state
from twin.mesh.stiffness import PairStiffness
from twin.model import mesh_of
from twin.rig import Rig
from twin.rig_derived import SHAFT_HALVES, bending_stiffness, half_stiffness_of_segments, wheel_inertia, wheel_mass
from twin.thresholds import deciding
from twin.wear.evolution import evolve
from twin.wear.profile import WornProfile

REFERENCE_REVOLUTIONS = 6000  # those of the key wear.max_depth_at_6000
SAMPLES = 256  # a mesh period: one a point of the worn profile
CORNER_REACH = 1.9e-3  # overshoot up to which the corner gap's polynomials hold, as the reference rig file says [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class NoteLimits:
    """Relative differences up to which two statements of a rig file count as one."""

    derived: float = deciding(
        0.02, meaning="stiffness, mass and inertia against the dimensions they follow from",
        source="not derived: the reference rig file's own agree within 0.0003, dimensions are known to about 1 %",
    )  # fmt: skip
    joint_softest: float = deciding(
        0.25, meaning="least stiffness of a shaft half with its joint, as a share of the shaft alone",
        source="the reference rig file bounds its joint factors by 0.3 and 1",
    )  # fmt: skip
    mesh_stiffness: float = deciding(
        0.05, meaning="mean mesh stiffness and pair stiffness against the potential-energy method",
        source="the reference rig file's table departs by at most 0.024, tests/validation/test_mesh_rig_table.py",
    )  # fmt: skip
    corner_gap: float = deciding(
        0.1, meaning="gap of the corner contact against that of the involutes",
        source="the reference rig file's polynomial departs by at most 0.06, tests/validation/test_mesh_rig_table.py",
    )  # fmt: skip
    wear_depth: float = deciding(
        0.1, meaning="depth at 6000 revolutions against the wear coefficient with quasi-static forces",
        source="quasi-static forces give 0.036 less than the dynamic model on the reference rig",
    )  # fmt: skip
    least_measurements: float = deciding(
        3.0, meaning="measurements before the end of life that a trend needs",
        source="derivation: two give a rate, the third its scatter",
    )  # fmt: skip


DEFAULT_LIMITS = NoteLimits()


def rig_notes(rig: Rig, limits: NoteLimits = DEFAULT_LIMITS) -> tuple[str, ...]:
    """Sentences on what a rig file states twice and differently; none where it agrees with itself."""
    notes = [*_shafts(rig, limits), *_wheels(rig, limits)]
    try:
        mesh = mesh_of(rig, SAMPLES)
    except TwinError:  # the model's own error names what is missing
        return tuple(notes)
    return tuple([*notes, *_mesh(rig, mesh, limits), *_corners(rig, mesh, limits), *_wear(rig, mesh, limits)])


def _differ(a: float | None, b: float | None, limit: float) -> bool:
    return a is not None and b is not None and abs(a - b) > limit * max(abs(a), abs(b))


def _shafts(rig: Rig, limits: NoteLimits) -> Iterator[str]:
    for shaft in ("input", "output"):
        name = f"shafts.bending_stiffness_{shaft}"
        given, derived = rig.get(name), bending_stiffness(rig.get, shaft)
        if _differ(given, derived, limits.derived):
            yield (
                f"{name} = {given:g} N/m is used; bearing span, gear position, bending diameter and Young's modulus "
                f"make it {derived:g} N/m"
            )
    half, segments = rig.get("shafts.torsional_stiffness_half"), half_stiffness_of_segments(rig.get)
    if _differ(half, segments, limits.derived):
        yield f"shafts.torsional_stiffness_half = {half:g} N·m/rad; its torsion_segments make it {segments:g} N·m/rad"
    shaft_alone = segments if half is None else half
    for spring in SHAFT_HALVES:
        k = rig.get(f"torsional_stiffness.{spring}")
        if None in (k, shaft_alone):
            continue
        if not limits.joint_softest <= k / shaft_alone <= 1 + limits.derived:
            yield (
                f"torsional_stiffness.{spring} = {k:g} N·m/rad is used; it is {k / shaft_alone:.2f} times that of its "
                f"shaft alone, {shaft_alone:g} N·m/rad, and a joint can only soften a shaft"
            )
    yield from _dimensions(rig, limits)


def _dimensions(rig: Rig, limits: NoteLimits) -> Iterator[str]:
    segments, length = rig.get("shafts.torsion_segments"), rig.get("shafts.length")
    span = rig.get("shafts.bearing_span")
    if length is not None and span is not None and span >= length:
        yield f"shafts.bearing_span = {span:g} m is not shorter than shafts.length = {length:g} m"
    if segments is None:
        return
    both = 2 * sum(part for part, _ in segments)
    if _differ(length, both, limits.derived):
        yield f"shafts.length = {length:g} m; both halves of torsion_segments are {both:g} m long"
    for name, extreme in (("diameter_min", min), ("diameter_max", max)):
        given, there = rig.get(f"shafts.{name}"), extreme(d for _, d in segments)
        if _differ(given, there, limits.derived):
            yield f"shafts.{name} = {given:g} m; torsion_segments have {there:g} m"


def _wheels(rig: Rig, limits: NoteLimits) -> Iterator[str]:
    for wheel, node in (("pinion", 5), ("gear", 10)):
        inertia, mass = rig.get(f"inertias.J{node}"), rig.get(f"masses.m{node}")
        from_disc, of_disc = wheel_inertia(rig.get, wheel), wheel_mass(rig.get, wheel)
        if _differ(inertia, from_disc, limits.derived):
            yield (
                f"inertias.J{node} = {inertia:g} kg·m² is used; density and dimensions of {wheel} and shaft make it "
                f"{from_disc:g} kg·m²"
            )
        if _differ(mass, of_disc, limits.derived):
            yield (
                f"masses.m{node} = {mass:g} kg is used; density and dimensions of {wheel} and shaft make it "
                f"{of_disc:g} kg"
            )


def _mesh(rig: Rig, mesh: PairMesh, limits: NoteLimits) -> Iterator[str]:
    scale, stated = rig.get("mesh.stiffness_scale", 1.0), rig.get("mesh.mean_stiffness")
    mean = scale * mesh.stiffness.mesh_mean
    if _differ(stated, mean, limits.mesh_stiffness):
        yield (
            f"mesh.mean_stiffness = {stated:g} N/m; the mesh stiffness in use ({rig.mesh_stiffness_source}) has a "
            f"mean of {mean:g} N/m"
        )
    τ, c = rig.get("mesh.relative_damping_time"), rig.get("mesh.damping")
    if τ is not None and c is not None and stated is not None and _differ(c, τ * stated, limits.derived):
        yield (
            f"mesh.relative_damping_time = {τ:g} s is used; mesh.damping over mesh.mean_stiffness makes it "
            f"{c / stated:g} s"
        )
    s, k = rig.get("mesh.pair_s"), rig.get("mesh.pair_stiffness")
    if s is None:
        return
    method = PairStiffness.of(mesh.pair)(np.array(s))
    departure = np.array(k) / method - 1
    worst = float(departure[np.abs(departure).argmax()])
    if abs(worst) > limits.mesh_stiffness:
        used = rig.given_pair_stiffness is not None
        yield (
            f"mesh.pair_stiffness departs by up to {100 * worst:+.0f} % from the potential-energy method and is "
            + ("used" if used else 'not used: set mesh.stiffness_source = "given" to use it')
        )


def _corners(rig: Rig, mesh: PairMesh, limits: NoteLimits) -> Iterator[str]:
    x = np.linspace(0.2, 1.0, 9) * CORNER_REACH
    for side, s in (("start", mesh.pair.path_start - x), ("end", mesh.pair.path_end + x)):
        given = rig.get(f"mesh.corner_gap_{side}")
        if given is None:
            continue
        gap, _ = mesh.corner(s)
        polynomial = x**2 * np.polynomial.polynomial.polyval(x, np.array(given))
        worst = float(np.abs(polynomial / gap - 1).max())
        if worst > limits.corner_gap:
            yield (
                f"mesh.corner_gap_{side} departs by up to {100 * worst:.0f} % from the gap between tip corner and "
                "flank, which follows from the gears' dimensions and is used"
            )


def _wear(rig: Rig, mesh: PairMesh, limits: NoteLimits) -> Iterator[str]:
    """Depth and life by the file's wear coefficient under its rated condition, with quasi-static forces."""
    needed = ("wear.K", "wear.dwell_time", "wear.contact_half_width", "operating.pinion_speed_hz")
    torque, stated = rig.get("operating.input_torque"), rig.get("wear.max_depth_at_6000")
    end, planned = rig.get("end_of_life.max_depth"), rig.get("operating.end_revs")
    if not rig.has(*needed) or torque is None or not torque > 0 or (stated is None and end is None):
        return
    try:
        work, depth = _quasi_static_wear(rig, mesh, torque, max(1.3 * (stated or 0.0), end or 0.0))
    except NotConverged:
        return
    K, τ, _, speed = rig.require("the wear coefficient", *needed)
    turns = work / (K * τ * 2 * pi * speed)
    at_reference = float(np.interp(REFERENCE_REVOLUTIONS, turns, depth))
    if _differ(stated, at_reference, limits.wear_depth):
        yield (
            f"wear.max_depth_at_6000 = {stated:g} m; wear.K with wear.dwell_time makes it about "
            f"{at_reference:.3g} m, and is what predictions begin with"
        )
    if end is None:
        return
    life, interval = float(np.interp(end, depth, turns)), rig.get("operating.measurement_interval_revs")
    if planned is not None and planned > life:
        yield (
            f"operating.end_revs = {planned:.0f} revolutions lie beyond the end of life, which wear.K reaches after "
            f"about {life:.0f}"
        )
    if interval is not None and limits.least_measurements * interval > life:
        yield (
            f"operating.measurement_interval_revs = {interval:.0f} leaves fewer than {limits.least_measurements:.0f} "
            f"measurements before the end of life, which wear.K reaches after about {life:.0f} revolutions"
        )


def _quasi_static_wear(rig: Rig, mesh: PairMesh, torque: float, until: float) -> tuple[np.ndarray, np.ndarray]:
    """Work [rad/N] and largest depth [m] from new flanks on, (m,) each."""
    speed, half_width = rig.require("wear", "operating.pinion_speed_hz", "wear.contact_half_width")
    scale, force = rig.get("mesh.stiffness_scale", 1.0), torque / mesh.pair.base_radius[0]

    def solver(profile: WornProfile, _: SteadyState | None) -> SteadyState:
        return quasi_static_state(mesh.contacts(profile, speed, stiffness_scale=scale), force)

    points = list(evolve(mesh, solver, WornProfile.unworn(mesh.pair), half_width, until))
    return np.array([p.work for p in points]), np.array([p.profile.max_depth for p in points])
