"""RMS of an accelerometer against wear depth, by time integration: also where the teeth part and nothing repeats.

At each depth the motion goes on from that of the depth before, settles, and its RMS in a band is evaluated.
A motion that does not repeat has an RMS that differs from stretch to stretch; that scatter is given with it.

    without loss of contact:   F̂_k = −k̄/(1 + k̄·G_k)·d̂0_k        d0 the quasi-static deflection, k̄ its mean stiffness

is what the same machine would do if its teeth stuck together: the linear response to the transmission error.

Source   twin.dynamics.integrator; the linear response: twin.dynamics.harmonic_balance with its contacts held closed
Holds    depths that rise slowly against the machine's own time
Ignores  jumps that occur at falling depth only
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, pi

import numpy as np
from scipy.fft import rfft
from scipy.interpolate import PchipInterpolator

from twin.dynamics.harmonic_balance import Contacts
from twin.dynamics.hunting import Error, HuntingPeriod, Passages
from twin.dynamics.integrator import integrate, steady_start
from twin.dynamics.structure import direction
from twin.errors import ParameterError
from twin.levels.wear import Wear, quasi_static_state
from twin.model import Condition, Model
from twin.wear.profile import POINTS_PER_PITCH, WornProfile

STEP = 5e-6  # longest step of the integration [s]
SETTLE = 0.3  # before anything is evaluated [s]
BLOCKS = 6  # stretches over which the scatter is evaluated
LOWEST = 5.0  # lower end of the band [Hz]: the rotation of the shafts as a whole is no vibration


@dataclass(frozen=True, eq=False, kw_only=True)
class LevelCurve:
    """Level under one condition by largest depth."""

    teeth: tuple[int, int]  # of the pair
    condition: Condition
    depth: np.ndarray  # (m,) [m], rising
    level: np.ndarray  # RMS in the band (m,) [m/s²]
    scatter: np.ndarray  # standard deviation of `level` from stretch to stretch, over its root (m,) [m/s²]
    apart: np.ndarray  # share of the time in which no tooth touches (m,)

    @cached_property
    def _log(self) -> PchipInterpolator:
        return PchipInterpolator(self.depth, np.log(self.level))

    def at(self, depth) -> np.ndarray:
        """Level [m/s²] at depths [m] within the curve; any shape → the same."""
        d = np.asarray(depth, float)
        if d.size and not (self.depth[0] <= d.min() and d.max() <= self.depth[-1]):
            raise ParameterError(
                f"depth {d.min():g} … {d.max():g} m is outside {self.depth[0]:g} … {self.depth[-1]:g} m of the curve"
            )
        return np.exp(self._log(d))


def resolved(model: Model, condition: Condition) -> Model:
    """The model with as many samples a mesh period as steps of two of them need."""
    period = model.mesh.pair.base_pitch / (2 * pi * condition.speed_hz * model.mesh.pair.base_radius[0])
    samples = POINTS_PER_PITCH * ceil(2 * period / STEP / POINTS_PER_PITCH)
    return Model.of(model.rig, model.calibration, samples=samples)


def level_curve(
    model: Model,
    condition: Condition,
    wear: Wear,
    depths: Sequence[float] | np.ndarray,
    *,
    band: tuple[float, float],
    duration: float = 1.2,
    unevenness: float = 0.0,
    seed: int = 1,
) -> LevelCurve:
    """Levels of the reference accelerometer at rising depths [m].

    band        [Hz]
    duration    of the motion that is evaluated at every depth [s]
    unevenness  standard deviation of the depth from gear tooth to gear tooth, of the depth; drawn with `seed`
    """
    if np.any(np.diff(depths) <= 0):
        raise ParameterError("depths must rise")
    fine = resolved(model, condition)
    c, (z1, z2) = fine.calibration, fine.mesh.pair.teeth
    load = direction({"th1": condition.torque, "th13": -condition.torque * z2 / z1})
    responses = fine.accelerometer[None, :]
    state = steady_start(fine.structure, fine.steady(fine.unworn, condition).require_converged(), load)
    rows = []
    for depth in depths:
        profile = wear(depth)
        if unevenness:
            hunting = HuntingPeriod(mesh=fine.mesh)
            contacts = hunting.contacts(
                profile,
                condition.speed_hz,
                (uneven(profile, unevenness, z2, fine.mesh.pair.base_radius[0], seed),),
                stiffness_scale=c.stiffness_scale,
                damping_time=c.damping_time,
            )
        else:
            contacts = fine.mesh.contacts(
                profile, condition.speed_hz, stiffness_scale=c.stiffness_scale, damping_time=c.damping_time
            )
        for span in (SETTLE, duration):
            motion = integrate(fine.structure, contacts, load, span, responses, keep=2, start=state)
            state = motion.modal
        rows.append((*_rms(motion.acceleration[:, 0], motion.time[1], band), float(np.mean(motion.mesh_force == 0))))
    level, scatter, apart = np.array(rows).T
    return LevelCurve(
        teeth=fine.mesh.pair.teeth,
        condition=condition,
        depth=np.asarray(depths, float),
        level=level,
        scatter=scatter,
        apart=apart,
    )


def _rms(acceleration: np.ndarray, step: float, band: tuple[float, float]) -> tuple[float, float]:
    """RMS in the band [m/s²] and what it scatters by."""
    low, high = max(band[0], LOWEST), band[1]
    n = acceleration.size // BLOCKS
    window = np.hanning(n)
    blocks = acceleration[: n * BLOCKS].reshape(BLOCKS, n)
    power = np.abs(rfft(blocks * window, axis=1)) ** 2 * 2 / (n * np.sum(window**2))
    f = np.fft.rfftfreq(n, step)
    each = power[:, (f >= low) & (f <= high)].sum(axis=1)
    level = float(np.sqrt(each.mean()))
    return level, float(each.std(ddof=1) / np.sqrt(BLOCKS) / (2 * level))


def uneven(profile: WornProfile, unevenness: float, teeth: int, base_radius: float, seed: int) -> Error:
    """Gear teeth that are worn deeper and less deep than the profile says."""
    factor = unevenness * np.random.default_rng(seed).standard_normal(teeth)

    def error(at: Passages) -> tuple[np.ndarray, np.ndarray]:
        h, slope = profile.at(at.position)
        off = -factor[at.gear_tooth] * (at.side > 0)
        return off * h, off * slope * base_radius

    return error


def linear_curve(
    model: Model, condition: Condition, wear: Wear, depths: Sequence[float] | np.ndarray, *, band: tuple[float, float]
) -> LevelCurve:
    """The same as `level_curve` if contact were never lost."""
    fine = resolved(model, condition)
    c = fine.calibration
    level = []
    for depth in depths:
        contacts = fine.mesh.contacts(wear(depth), condition.speed_hz, stiffness_scale=c.stiffness_scale)
        steady = _closed(fine, contacts, condition)
        level.append(fine.acceleration_rms(steady, (max(band[0], LOWEST), band[1])))
    zero = np.zeros(len(level))
    return LevelCurve(
        teeth=fine.mesh.pair.teeth,
        condition=condition,
        depth=np.asarray(depths, float),
        level=np.array(level),
        scatter=zero,
        apart=zero,
    )


def _closed(model: Model, contacts: Contacts, condition: Condition):
    """The linear response to the quasi-static deflection, as a steady state."""
    static = quasi_static_state(contacts, model.mean_force(condition))
    stiffness = float(np.where(static.contact_forces > 0, contacts.stiffness, 0.0).sum(axis=0).mean())
    G = model.structure.receptance(contacts.omega[1:], model.structure.mesh, model.structure.mesh)
    lines = static.force_lines.copy()
    d0 = rfft(static.deflection, norm="forward")[1:]
    k = stiffness * (1 + 1j * contacts.omega[1:] * model.calibration.damping_time)
    lines[1:] = -k / (1 + k * G) * d0
    return replace(static, force_lines=lines)
