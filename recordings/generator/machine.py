"""The machine behind a campaign: one structure, one pair, its flanks, and how it is run for a while."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from recordings.generator import integrate
from recordings.generator.contact import Mesh, static_approach, work_space
from recordings.generator.drive import blows, wander
from recordings.generator.errors import SimulationError
from recordings.generator.flanks import CORNER_SPACING, SPACING, Pair
from recordings.generator.knobs import Knobs
from recordings.generator.structure import Structure
from recordings.generator.sweep import sweep
from recordings.generator.turning import BINS, Turning

SPEED_BANDWIDTH = 4.0  # of the motor's speed control [rad/s]
FORCE_BINS = 64  # of a mesh period, for the force that wears
FORCE_SECONDS = (0.12, 0.25)  # that the machine settles, and is then looked at for that force [s]
LEAST_RATIO = 0.02  # of the force that wears to its mean, where contact is lost


@dataclass(frozen=True, slots=True)
class Condition:
    """How the machine is run: mean speed and torque, their wander, all SI."""

    speed: float  # of the pinion [rad/s]
    torque: float  # on the pinion's shaft [N·m]
    speed_wander: float = 0.0  # relative standard deviation
    torque_wander: float = 0.0
    wander_seconds: float = 1.5
    speed_rise: float = 0.0  # from start to end of a run, relative, evenly about the mean
    torque_rise: float = 0.0


@dataclass(slots=True)
class Motion:
    """Where the machine is: modal displacements and velocities, and the speed control's memory."""

    u: np.ndarray  # (21,)
    v: np.ndarray  # (21,)
    control: np.ndarray  # (1,) integral of the speed's error [rad]


@dataclass(slots=True, kw_only=True)
class Machine:
    """One individual machine. Wear is the only thing of it that changes."""

    structure: Structure
    pair: Pair
    slices: int
    stiffness_scale: float  # of the mesh
    damping_time: float  # τ of the mesh [s]
    rated_torque: float  # at which the pair stiffness holds [N·m]
    phase: float  # s of tooth 0 at pinion angle 0 [m]
    accelerometer: str
    dt: float
    pinion_worn: np.ndarray  # (z1, points, slices) [m]
    gear_worn: np.ndarray  # (z2, points, slices) [m]
    bearing_span: float = 0.15  # of the pinion's shaft [m]

    def mesh(self, knobs: Knobs) -> Mesh:
        """The contact as it is now, with the present wear and the effects' knobs."""
        pair = self.pair
        teeth = tuple(np.ones(z) for z in pair.teeth)
        for shares, cracked in zip(teeth, (knobs.tooth_stiffness, knobs.gear_tooth_stiffness), strict=True):
            for tooth, share in cracked.items():
                shares[tooth] = share
        form1, form2 = (np.atleast_2d(form) for form in (knobs.pinion_form, knobs.gear_form))
        rb, α = pair.base_radius, pair.pressure_angle
        κ = pair.pair_stiffness * self.stiffness_scale * knobs.stiffness
        z = (np.arange(self.slices) + 0.5) / self.slices - 0.5
        return Mesh(
            base_radius=rb,
            base_pitch=pair.base_pitch,
            start=pair.start,
            end=pair.end,
            first=float(pair.points[0]),
            spacing=SPACING,
            phase=self.phase,
            centre=1 / np.sin(α),
            κ=κ,
            δ0=self.rated_torque / rb[0] / 2 / κ.mean(),
            τ=self.damping_time * knobs.damping,
            gap_start=pair.gap_start,
            gap_end=pair.gap_end,
            gap_spacing=CORNER_SPACING,
            pinion=self.pinion_worn + form1[:, :, None],
            gear=self.gear_worn + form2[:, :, None],
            lead=knobs.lead * z,
            tooth_stiffness=teeth[0],
            gear_tooth_stiffness=teeth[1],
            friction=knobs.friction,
            backlash=pair.backlash + knobs.backlash,
            ρ1=rb[0] * np.tan(α),
            ρ2=rb[1] * np.tan(α),
        )

    def linear(self, knobs: Knobs) -> integrate.Linear:
        """The structure's rows for the integrator."""
        S = self.structure
        loose = 6 if knobs.play is None else knobs.play[0]
        return integrate.Linear(
            ω2=S.frequency**2,
            c=2 * S.damping_ratio * S.frequency,
            mesh=S.modes.T @ S.mesh_direction,
            back=S.modes.T @ S.back_direction,
            tangent=S.modes.T @ S.tangent,
            **{name: S.row(name) for name in ("th1", "th5", "th7", "th8", "th10", "th13", "x5", "y5", "x10", "y10")},
            bearing=S.row(self.accelerometer),
            loose_x=S.row(f"x{loose}"),
            loose_y=S.row(f"y{loose}"),
            accelerometer=S.row(self.accelerometer),
            torque_meter=S.modes.T @ S.torque_meter,
        )

    def drive(self, condition: Condition, knobs: Knobs, steps: int, rng: np.random.Generator) -> integrate.Drive:
        """Set speed and load over `steps` steps."""
        z1, z2 = self.pair.teeth
        n, dt, S = steps + 1, self.dt, self.structure
        t = dt * np.arange(n)
        speed = condition.speed * (1 + wander(rng, n, dt, condition.speed_wander, condition.wander_seconds))
        load = condition.torque * (1 + wander(rng, n, dt, condition.torque_wander, condition.wander_seconds))
        if condition.speed_rise or condition.torque_rise:
            rising = np.linspace(-0.5, 0.5, n)
            speed, load = speed * (1 + condition.speed_rise * rising), load * (1 + condition.torque_rise * rising)
        load = load + knobs.load_ripple[0] * np.sin(knobs.load_ripple[1] * condition.speed * t)
        M = np.diag(S.mass)
        inertia = M[:5].sum() + M[5:9].sum() * (z1 / z2) ** 2
        force, order, slip = knobs.bearing
        return integrate.Drive(
            speed=speed,
            brake=load * z2 / z1,
            bearing=blows(rng, n, dt, force, order * condition.speed / (2 * pi), slip, condition.speed_rise),
            feed_forward=condition.torque,
            proportional=SPEED_BANDWIDTH * inertia,
            integral=SPEED_BANDWIDTH**2 / 4 * inertia,
            ripple=np.array(knobs.ripple),
            eccentricity=np.array(knobs.pinion_eccentricity + knobs.gear_eccentricity),
            unbalance=np.array(knobs.pinion_unbalance + knobs.gear_unbalance),
            loose=self._loose(knobs),
            turn=self._turning_modes(self._turning(condition, knobs)),
            rough=self._rough(condition, knobs, n, rng),
            sin=np.sin(self.pair.pressure_angle),
            cos=np.cos(self.pair.pressure_angle),
        )

    def _loose(self, knobs: Knobs) -> np.ndarray:
        """`Drive.loose`; δ0 is how far half of the rated mesh force moves the sound bearing."""
        if knobs.play is None:
            return np.array([0.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        bearing, play, exponent, share = knobs.play
        kx, ky = (self.structure.bearings[f"{axis}{bearing}"] for axis in "xy")
        δ0 = self.rated_torque / self.pair.base_radius[0] / 2 / ky
        return np.array([kx, ky, play, δ0, exponent - 1, share])

    def _turning(self, condition: Condition, knobs: Knobs) -> list[Turning]:
        return [force.turning(condition.torque, self.bearing_span) for force in knobs.turning]

    def _turning_modes(self, turning: list[Turning]) -> np.ndarray:
        """Modal forces over a turn (BINS + 1, n), or (0, n) where there are none."""
        S = self.structure
        if not turning:
            return np.zeros((0, S.frequency.size))
        out = np.zeros((BINS + 1, S.frequency.size))
        for each in turning:
            for name, force in each.forces.items():
                out += force[:, None] * S.row(name)[None, :]
            if each.twist is not None:  # the coupling between 2 and 3 is as much longer
                out += self._meter_stiffness() * each.twist[:, None] * (S.row("th2") - S.row("th3"))[None, :]
        return out

    def _meter_stiffness(self) -> float:
        return float(self.structure.torque_meter.max())

    def _rough(self, condition: Condition, knobs: Knobs, n: int, rng: np.random.Generator) -> np.ndarray:
        """Quick changes of the forces over a turn, white; (n,)."""
        roughness = max((each.roughness for each in self._turning(condition, knobs)), default=0.0)
        return np.ones(n) if roughness == 0 else 1 + roughness * rng.normal(0, 1, n)

    def _twisted(self, record: np.ndarray, condition: Condition, knobs: Knobs) -> None:
        """Takes from the sensed torque of a record (steps, 8) what the coupling's twist makes of it."""
        for each in self._turning(condition, knobs):
            if each.twist is not None:
                at = record[:, 2] / (2 * pi) % 1.0 * BINS
                record[:, 1] -= self._meter_stiffness() * np.interp(at, np.arange(BINS + 1), each.twist)

    def at_rest(self, condition: Condition, knobs: Knobs, angle: float) -> Motion:
        """Wound up by the load and turning evenly at pinion angle [rad], as no vibration were excited yet."""
        S, (z1, z2) = self.structure, self.pair.teeth
        mesh = self.mesh(knobs)
        force = condition.torque / mesh.base_radius[0]
        f = S.modes.T @ (-force * S.mesh_direction)
        f += condition.torque * (S.row("th1") - z2 / z1 * S.row("th13"))
        u = np.zeros(f.size)
        u[2:] = f[2:] / S.frequency[2:] ** 2
        rigid = (S.row("th5")[0], S.row("th10")[1])
        u[0] = (angle - S.row("th5")[2:] @ u[2:]) / rigid[0]
        missing = static_approach(mesh, angle, force) - S.mesh_direction @ S.modes @ u
        u[1] -= missing / mesh.base_radius[1] / rigid[1]
        v = np.zeros(f.size)
        v[0], v[1] = condition.speed / rigid[0], condition.speed * z1 / z2 / rigid[1]
        return Motion(u, v, np.zeros(1))

    def run(self, motion: Motion, condition: Condition, knobs: Knobs, seconds: float, rng) -> np.ndarray:
        """Runs on for a while, changing `motion`; the record of `integrate.run`, (steps, 8)."""
        steps = round(seconds / self.dt)
        record = np.zeros((steps, 8))
        self._run(motion, condition, knobs, steps, rng, record)
        self._twisted(record, condition, knobs)
        return record

    def settle(self, motion: Motion, condition: Condition, knobs: Knobs, seconds: float, rng) -> None:
        """Runs on without recording."""
        self._run(motion, condition, knobs, round(seconds / self.dt), rng, np.zeros((0, 8)))

    def force_ratio(self, condition: Condition, knobs: Knobs) -> np.ndarray:
        """The mesh force of the turning machine over the mesh period, over its mean; (FORCE_BINS,)."""
        steady, rng = replace(condition, speed_wander=0.0, torque_wander=0.0), np.random.default_rng(0)
        motion = self.at_rest(steady, knobs, 0.0)
        self.settle(motion, steady, knobs, FORCE_SECONDS[0], rng)
        record = self.run(motion, steady, knobs, FORCE_SECONDS[1], rng)
        passed = (self.pair.base_radius[0] * record[:, 2] + self.phase) / self.pair.base_pitch
        at = np.minimum(((passed - np.floor(passed)) * FORCE_BINS).astype(int), FORCE_BINS - 1)
        force = np.bincount(at, record[:, 4], FORCE_BINS) / np.bincount(at, minlength=FORCE_BINS)
        return np.maximum(force / force.mean(), LEAST_RATIO)

    def carried(self, condition: Condition, knobs: Knobs, start: float, turns: float, ratio: np.ndarray | None = None):
        """Mean of slice force × distance from the pitch point [N·m] of one passage, over `turns`.

        From pinion angle `start` [rad] on. For pinion (z1, points, slices) and gear (z2, points, slices).
        `ratio` (bins,) is the load over the mesh period against its mean; even where there is none.
        """
        shape1, shape2 = self.pinion_worn.shape, self.gear_worn.shape
        worn1, worn2, passed1, passed2 = (
            np.zeros(shape1),
            np.zeros(shape2),
            np.zeros(shape1[:2]),
            np.zeros(shape2[:2]),
        )
        mesh = self.mesh(knobs)
        positions = round(turns * self.pair.teeth[0] * self.pair.base_pitch / SPACING)
        force = condition.torque / self.pair.base_radius[0]
        eccentricity = np.array(knobs.pinion_eccentricity + knobs.gear_eccentricity)
        missed = sweep(
            mesh, start, positions, force, np.ones(1) if ratio is None else ratio, eccentricity,
            work_space(mesh), worn1, worn2, passed1, passed2,
        )  # fmt: skip
        if missed:
            raise SimulationError(f"the load sharing found no balance at {missed} of {positions} positions")
        return worn1 / np.maximum(passed1, 0.25)[:, :, None], worn2 / np.maximum(passed2, 0.25)[:, :, None]

    def _run(self, motion, condition, knobs, steps, rng, record) -> None:
        mesh = self.mesh(knobs)
        drive = self.drive(condition, knobs, steps, rng)
        integrate.run(
            self.linear(knobs), mesh, drive, motion.u, motion.v, motion.control, self.dt, steps, record,
            work_space(mesh),
        )  # fmt: skip
        if not np.all(np.isfinite(motion.u)):
            raise SimulationError(
                f"the motion grew without bound at {condition.speed / 2 / pi:g} Hz, "
                f"{condition.torque:g} N·m; "
                f"solver.step_rate_hz = {1 / self.dt:g} Hz too low?"
            )
