"""Harmonic balance against time integration at equal accuracy, in one run.

    python -m benchmarks.bench_dynamics

One worn state of the reference rig (10 Hz, 10 N·m, 50 µm); accuracy is the largest error of the first ten harmonics
of y6's acceleration, of the largest harmonic, against a harmonic balance with 16,384 samples a mesh period. Every
method runs at the coarsest of its settings that reaches 1e-4; times are processor times, the shortest of a few runs.
LSODA integrates a stretch from rest; its time to the steady state is extrapolated from the machine time that the
compiled integrator needs.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from twin.dynamics.harmonic_balance import Contacts, SteadyState, quasi_static_deflection, solve
from twin.dynamics.hunting import HuntingPeriod
from twin.dynamics.integrator import integrate, modal_start
from twin.dynamics.structure import RIGID_HZ, direction
from twin.model import Calibration, Condition, Model
from twin.rig import Rig
from twin.wear.evolution import evolve
from twin.wear.profile import WornProfile

RIG_FILE = Path(__file__).parents[1] / "recordings/rigs/unsw.toml"
CONDITION = Condition(speed_hz=10.0, torque=10.0)
ACCURACY = 1e-4
DEPARTURE = 1e-10  # of a modal coordinate, for a finite difference [m·√kg]
SHOTS = 60  # periods at most that Newton's method on the period map takes
SETTLED = 1e-5  # change of the lines from one period to the next when a motion counts as steady


def reference_model(samples: int) -> Model:
    rig = Rig.from_mapping(tomllib.loads(RIG_FILE.read_text(encoding="utf-8")))
    return Model.of(rig, Calibration.prior(rig), samples=samples)


def shortest(run, times: int = 3) -> float:
    """Shortest processor time of a few runs [s]: what it takes on a core of its own, however busy the machine."""
    best = np.inf
    for _ in range(times):
        start = process_time()
        run()
        best = min(best, process_time() - start)
    return best


def master_curve(model: Model, until_depth: float) -> list:
    return list(
        evolve(
            model.mesh,
            lambda profile, near: model.steady(profile, CONDITION, near),
            model.unworn,
            model.calibration.contact_half_width,
            until_depth,
        )
    )


def contacts(model: Model, profile: WornProfile):
    return model.mesh.contacts(profile, CONDITION.speed_hz, damping_time=model.calibration.damping_time)


def torques(model: Model) -> np.ndarray:
    """Constant torques at motor and brake in balance; (21,)."""
    z1, z2 = model.rig.teeth
    return direction({"th1": CONDITION.torque, "th13": -CONDITION.torque * z2 / z1})


def error(lines: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(lines - reference).max() / np.abs(reference).max())


def harmonic_balance(profile: WornProfile, near: WornProfile, reference: np.ndarray) -> dict[str, float]:
    """Samples, error, and time of a solution from nothing and from that of a neighbouring profile."""
    for n in (256, 512, 1024, 2048, 4096):
        model = reference_model(n)
        force = model.mean_force(CONDITION)
        table = contacts(model, profile)
        found = solve(model.structure, table, force)
        achieved = error(model.acceleration_lines(found)[:10], reference)
        if achieved <= ACCURACY:
            break
    start = solve(model.structure, contacts(model, near), force)
    return {
        "samples": n,
        "error": achieved,
        "cold": shortest(lambda: solve(model.structure, table, force), 20),
        "warm": shortest(lambda: solve(model.structure, table, force, start=start), 20),
    }


def last_lines(acceleration: np.ndarray, steps: int) -> np.ndarray:
    return 2 * np.fft.rfft(acceleration[-steps - 1 : -1])[1:11] / steps


def compiled_integration(profile: WornProfile, reference: np.ndarray) -> dict[str, float]:
    """Samples, error and time from rest until the lines stay as they are, and the machine time that takes."""
    for n in (256, 512, 1024, 2048):
        model = reference_model(n)
        table = contacts(model, profile)
        load = torques(model)
        seconds = 0.0
        state, before = None, np.full(10, np.inf)
        for _ in range(120):  # a quarter of a second at a time
            chunk = 48 * table.period
            motion = integrate(model.structure, table, load, chunk, model.accelerometer[None, :], start=state)
            state, lines = motion.modal, last_lines(motion.acceleration[:, 0], n // 2)
            seconds += chunk
            if error(lines, reference) <= ACCURACY and error(lines, before) < SETTLED:
                break
            before = lines
        achieved = error(lines, reference)
        if achieved <= ACCURACY:
            break

    def whole():
        return integrate(model.structure, table, load, seconds, model.accelerometer[None, :], keep=table.samples // 2)

    return {"samples": n, "error": achieved, "machine_seconds": seconds, "time": shortest(whole)}


@dataclass(slots=True)
class PeriodMap:
    """Where a motion is one mesh period later, by the compiled integrator; modal coordinates and rates (42,)."""

    model: Model
    table: Contacts
    load: np.ndarray
    integrations: int = 0
    acceleration: np.ndarray = field(default_factory=lambda: np.empty(0))  # of y6 over the period passed last

    def __call__(self, state: np.ndarray) -> np.ndarray:
        """(42,) → (42,)."""
        y6, start = self.model.accelerometer[None, :], (state[:21], state[21:])
        motion = integrate(self.model.structure, self.table, self.load, self.table.period, y6, start=start)
        self.integrations += 1
        self.acceleration = motion.acceleration[:, 0]
        return np.concatenate(motion.modal)

    def slope(self, state: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Its derivative by finite differences (42, 42)."""
        ω = self.model.structure.modes[0]
        steps = DEPARTURE * np.concatenate((np.ones_like(ω), np.maximum(ω, 2 * np.pi)))
        return np.stack([(self(state + h * unit) - end) / h for h, unit in zip(steps, np.eye(42), strict=True)], axis=1)


def loaded(period_map: PeriodMap) -> np.ndarray:
    """Shafts and mesh at rest under the mean force; modal coordinates and rates (42,)."""
    structure, force = period_map.model.structure, period_map.model.mean_force(CONDITION)
    ω, Φ = structure.modes
    η = np.zeros_like(ω)
    vibrating = ω > 2 * np.pi * RIGID_HZ
    η[vibrating] = (Φ.T @ (period_map.load - structure.mesh * force))[vibrating] / ω[vibrating] ** 2
    deflection = float(quasi_static_deflection(period_map.table, force)[0])
    closing, still = modal_start(structure, deflection - float(structure.mesh @ Φ @ η))
    return np.concatenate((η + closing, still))


def shot(period_map: PeriodMap, always: bool) -> np.ndarray:
    """Lines of y6 after Newton's method on the period map, from the state at rest under load.

    always  a new derivative at every step; else only where a step does not bring the motion twice as close
    """
    state = loaded(period_map)
    slope, gap, before = None, np.inf, np.zeros(10)
    for _ in range(SHOTS):
        end = period_map(state)
        lines = last_lines(period_map.acceleration, period_map.acceleration.size - 1)
        if error(before, lines) < SETTLED:
            break
        left = end - state
        if slope is None or always or np.abs(left).max() > 0.5 * gap:
            slope = period_map.slope(state, end)
        gap, before = float(np.abs(left).max()), lines
        # the free rotation of all shafts together is as periodic at any angle and speed: the shortest step leaves it
        state = state - np.linalg.lstsq(slope - np.eye(42), left, rcond=1e-9)[0]
    return lines


def shooting(profile: WornProfile, reference: np.ndarray, always: bool) -> dict[str, float]:
    """Samples, error, time and integrations of a period for Newton's method on the period map."""
    for n in (256, 512, 1024, 2048):
        model = reference_model(n)
        table, load = contacts(model, profile), torques(model)
        period_map = PeriodMap(model, table, load)
        achieved = error(shot(period_map, always), reference)
        if achieved <= ACCURACY:
            break
    return {
        "samples": n,
        "error": achieved,
        "integrations": period_map.integrations,
        "time": shortest(lambda: shot(PeriodMap(model, table, load), always), 5),
    }


@njit(cache=True)
def _derivative(t, state, per_state, mesh, push, driven, k, separation, rate, period, τ):
    """q' and q'' (42,) of the state (42,) in physical coordinates; everything that can be is compiled.

    per_state −M⁻¹[K C] (21, 42), mesh g, push M⁻¹g, driven M⁻¹f_ext (21,); fine tables of the contacts (p, n)
    """
    half, n = mesh.size, k.shape[1]
    d, d_rate = 0.0, 0.0
    for i in range(half):
        d += mesh[i] * state[i]
        d_rate += mesh[i] * state[half + i]
    u = t / period * n
    part = u - np.floor(u)
    i0 = int(np.floor(u)) % n
    i1 = (i0 + 1) % n
    force = 0.0
    for p in range(k.shape[0]):
        w = part if abs(separation[p, i1] - separation[p, i0]) < 1e-6 else 0.0  # a row passes on to the next pair
        e = separation[p, i0] + w * (separation[p, i1] - separation[p, i0])
        x = d + e + τ * (d_rate + rate[p, i0] + w * (rate[p, i1] - rate[p, i0]))
        if x > 0.0:
            force += (k[p, i0] + w * (k[p, i1] - k[p, i0])) * x
    out = np.empty_like(state)
    for i in range(half):
        out[i] = state[half + i]
        a = driven[i] - push[i] * force
        for j in range(state.size):
            a += per_state[i, j] * state[j]
        out[half + i] = a
    return out


def lsoda(profile: WornProfile, machine_seconds: float, periods: int = 10) -> dict[str, float]:
    """Time for a stretch from rest at the loosest tolerance that reaches the accuracy in its last mesh period, and
    what the way to the steady state would take at that pace."""
    model = reference_model(8192)
    structure, τ = model.structure, model.calibration.damping_time
    table, fine = contacts(model, profile), contacts(reference_model(65536), profile)
    inverse = 1 / np.diag(structure.mass)
    load = torques(model)
    fixed = (
        -inverse[:, None] * np.hstack((structure.stiffness, structure.damping)),
        structure.mesh,
        inverse * structure.mesh,
        inverse * load,
        fine.stiffness[:3].copy(),
        fine.separation[:3].copy(),
        fine.separation_rate[:3].copy(),
        table.period,
        τ,
    )

    rest = modal_start(structure, 2e-6)
    start = np.concatenate((structure.modes[1] @ rest[0], structure.modes[1] @ rest[1]))
    stretch = periods * table.period
    y6 = model.accelerometer
    exact = integrate(structure, table, load, stretch, y6[None, :], keep=16, start=rest)
    times, expected = exact.time[:-1][-256:], last_lines(exact.acceleration[:, 0], 256)

    def run(tolerance: float):
        return solve_ivp(
            _derivative, (0, stretch), start, "LSODA", times, args=fixed, rtol=tolerance, atol=tolerance * 1e-6
        )

    _derivative(0.0, start, *fixed)  # compiles
    for tolerance in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8):
        began = process_time()
        states = run(tolerance).y
        pace = (process_time() - began) / stretch
        acceleration = np.array([y6 @ _derivative(t, x, *fixed)[21:] for t, x in zip(times, states.T, strict=True)])
        achieved = error(last_lines(np.append(acceleration, 0.0), 256), expected)
        if achieved <= ACCURACY:
            break
    return {
        "error": achieved,
        "tolerance": tolerance,
        "per_machine_second": pace,
        "extrapolated": pace * machine_seconds,
    }


def hunting_period(profile: WornProfile) -> dict[str, float]:
    """Time of the whole hunting-tooth period, from nothing, with an eccentric gear."""
    model = reference_model(1024)
    hunting = HuntingPeriod.of(model.mesh)
    z1, z2 = model.rig.teeth

    def eccentric_gear(passages):
        e, θ = 20e-6, passages.gear_angle
        return passages.side * e * np.cos(θ), -passages.side * e * np.sin(θ) * z1 / z2

    def run() -> SteadyState:
        table = hunting.contacts(
            profile, CONDITION.speed_hz, (eccentric_gear,), damping_time=model.calibration.damping_time
        )
        return solve(model.structure, table, model.mean_force(CONDITION)).require_converged()

    run()
    return {"samples": hunting.samples, "time": shortest(run, 5)}


def wear_campaign() -> dict[str, float]:
    """Time of the master curve through 18,000 revolutions at the rig file's wear coefficient."""
    model = reference_model(1024)
    start = process_time()
    path = master_curve(model, 475e-6)
    seconds = process_time() - start
    K, τ = model.rig.require("the wear coefficient", "wear.K", "wear.dwell_time")
    revolutions = path[-1].work / (K * τ * 2 * np.pi * CONDITION.speed_hz)
    return {"time": seconds, "revolutions": revolutions, "points": len(path)}


def main() -> dict[str, dict[str, float]]:
    path = master_curve(reference_model(1024), 50e-6)
    profile, near = path[-1].profile, path[-2].profile
    finest = reference_model(16384)
    reference = finest.acceleration_lines(
        solve(finest.structure, contacts(finest, profile), finest.mean_force(CONDITION)).require_converged()
    )[:10]
    balance = harmonic_balance(profile, near, reference)
    compiled = compiled_integration(profile, reference)
    renewed, frozen = shooting(profile, reference, True), shooting(profile, reference, False)
    stiff = lsoda(profile, compiled["machine_seconds"])
    hunting, wear = hunting_period(profile), wear_campaign()
    print(f"steady state at 50 µm, y6 acceleration within {ACCURACY:g} of the largest of ten harmonics")
    print(f"{'method':<34}{'samples':>8}{'error':>10}{'time':>12}{'ratio':>10}")
    rows = (
        ("harmonic balance, from nothing", balance["samples"], balance["error"], balance["cold"]),
        ("harmonic balance, from a neighbour", balance["samples"], balance["error"], balance["warm"]),
        ("compiled Runge–Kutta, from rest", compiled["samples"], compiled["error"], compiled["time"]),
        ("  shooting, a derivative a step", renewed["samples"], renewed["error"], renewed["time"]),
        ("  shooting, derivative kept", frozen["samples"], frozen["error"], frozen["time"]),
        ("LSODA, from rest, extrapolated", None, stiff["error"], stiff["extrapolated"]),
    )
    for name, samples, achieved, seconds in rows:
        count = "" if samples is None else f"{samples}"
        print(f"{name:<34}{count:>8}{achieved:>10.1e}{seconds * 1e3:>9.1f} ms{seconds / balance['cold']:>10.0f}")
    print(f"machine time to the steady state   {compiled['machine_seconds']:.2f} s")
    print(f"hunting period, {hunting['samples']} samples      {hunting['time'] * 1e3:.0f} ms")
    print(f"wear through {wear['revolutions']:.0f} revolutions      {wear['time']:.2f} s in {wear['points']} points")
    return {
        "harmonic_balance": balance,
        "compiled_integration": compiled,
        "shooting": renewed,
        "shooting_frozen": frozen,
        "lsoda": stiff,
        "hunting_period": hunting,
        "wear": wear,
        "ratio": {
            "compiled_integration": compiled["time"] / balance["cold"],
            "shooting": renewed["time"] / balance["cold"],
            "shooting_frozen": frozen["time"] / balance["cold"],
            "lsoda": stiff["extrapolated"] / balance["cold"],
        },
    }


if __name__ == "__main__":
    main()
