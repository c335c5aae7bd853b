"""The gearbox with effects, solved: lines of acceleration, transmission error and torque at orders of the pinion.

response = solve_with(model, (TheEffect(...),), profile, condition)
response.acceleration([19, 19 + 19 / 52])
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from math import pi
from typing import ClassVar, Protocol

import numpy as np

from twin.dynamics.contact_loss import solve_through_contact_loss
from twin.dynamics.harmonic_balance import EVERY, Contacts, SteadyLines, SteadyState, solve
from twin.dynamics.sensitivity import Linearised
from twin.dynamics.structure import Structure, direction
from twin.effects.facts import Facts
from twin.effects.parameter import Parameter
from twin.effects.setup import SensorGain, Setup, common_period, contacts_of, setup_of
from twin.effects.signature import Signature
from twin.effects.tooth_wear import with_tooth_wear
from twin.errors import ParameterError
from twin.model import Condition, Model
from twin.wear.profile import WornProfile

MOTOR, BRAKE = direction({"th1": 1.0}), direction({"th13": 1.0})
DRIVEN = direction({f"th{n}": 1.0 for n in (8, 10, 12, 13)})  # rotation of the gear's shaft as a whole
MOST_PRODUCTS = 300  # with the Jacobian, before finer samples are tried: hunting periods that are solved take 30 to 250


class Effect(Protocol):
    """One thing that a healthy gearbox does not have."""

    parameters: ClassVar[tuple[Parameter, ...]]
    signature: ClassVar[Signature]
    facts: ClassVar[Facts]

    @property
    def period(self) -> str:
        """The shortest period over which it repeats: "mesh", "pinion" or "gear" (a turn of it) or "hunting"."""
        ...

    def apply(self, setup: Setup) -> Setup: ...


class _Channels:
    """What the channels see of a steady state: x(t) = Re Σ X·e^{i·order·θ1}, θ1 = 0 at t = 0."""

    model: Model
    steady: SteadyLines
    structure: Structure
    turns: Fraction  # pinion turns in the period
    mesh_periods: int  # in the period
    gains: tuple[SensorGain, ...]  # what a faulty accelerometer does to each frequency

    @cached_property
    def orders(self) -> np.ndarray:
        """Order of every line k ≥ 1, of the pinion's rotation (n//2,)."""
        return np.arange(1, self.steady.omega.size) / float(self.turns)

    @cached_property
    def acceleration_lines(self) -> np.ndarray:
        """What the accelerometer reports at every order (n//2,) [m/s²]."""
        return self._heard(EVERY)

    @cached_property
    def transmission_error_lines(self) -> np.ndarray:
        """r_b1·θ7 − r_b2·θ8 at every order (n//2,) [m]."""
        return self._lines(self.structure.transmission_error)

    @cached_property
    def pinion_motion_lines(self) -> np.ndarray:
        """r_b1·θ7, what the pinion's encoder sees, at every order (n//2,) [m]."""
        return self._lines(direction({"th7": self.model.mesh.pair.base_radius[0]}))

    @cached_property
    def torque_lines(self) -> np.ndarray:
        """The torque meter at every order (n//2,) [N·m]."""
        return self._lines(self.structure.torque_meter)

    def acceleration(self, orders: Sequence[float] | np.ndarray) -> np.ndarray:
        """At some orders (m,) → (m,) [m/s²]."""
        return self._heard(self._places(orders))

    def transmission_error(self, orders: Sequence[float] | np.ndarray) -> np.ndarray:
        """At some orders (m,) → (m,) [m]."""
        return self._lines(self.structure.transmission_error, self._places(orders))

    def torque(self, orders: Sequence[float] | np.ndarray) -> np.ndarray:
        """At some orders (m,) → (m,) [N·m]."""
        return self._lines(self.structure.torque_meter, self._places(orders))

    def at_mesh(self, channel: np.ndarray, count: int) -> np.ndarray:
        """A response direction (21,) at the first mesh orders (count,)."""
        n = self.mesh_periods
        return self._lines(channel, slice(n, n * count + 1, n))

    def _lines(self, response: np.ndarray, at: slice | np.ndarray = EVERY) -> np.ndarray:
        return self.steady.lines(self.structure, response, at)

    def _heard(self, at: slice | np.ndarray) -> np.ndarray:
        ω = self.steady.omega[at]
        lines = -(ω**2) * self._lines(self.model.accelerometer, at)
        for gain in self.gains:
            lines = gain(ω / (2 * pi)) * lines
        return lines

    def _places(self, orders: Sequence[float] | np.ndarray) -> np.ndarray:
        """Which lines of the period are at some orders (m,)."""
        wanted = np.asarray(orders, dtype=float)
        place = wanted * float(self.turns)
        k = np.rint(place).astype(int)
        wrong = (np.abs(place - k) > 1e-6) | (k < 1) | (k >= self.steady.omega.size)
        if wrong.any():
            raise ParameterError(
                f"order {wanted[wrong][0]:g} of the pinion's rotation is no line of the period: multiples of "
                f"{float(1 / self.turns):g} up to {self.orders[-1]:g}"
            )
        return k


@dataclass(frozen=True, eq=False, kw_only=True)
class ResponseLines(_Channels):
    """The lines of a steady state that is not kept itself; see `converged`."""

    model: Model
    steady: SteadyLines
    structure: Structure
    turns: Fraction
    mesh_periods: int
    gains: tuple[SensorGain, ...]
    mean_transmission_error: float  # [m], zero for rigid perfect gears without load
    converged: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Response(_Channels):
    """A steady state and what the channels see of it."""

    model: Model
    setup: Setup
    contacts: Contacts
    steady: SteadyState

    @property
    def structure(self) -> Structure:  # type: ignore[override]
        return self.setup.structure

    @property
    def turns(self) -> Fraction:  # type: ignore[override]
        return self.setup.turns

    @property
    def mesh_periods(self) -> int:  # type: ignore[override]
        return self.setup.samples // self.setup.mesh.samples

    @property
    def gains(self) -> tuple[SensorGain, ...]:  # type: ignore[override]
        return self.setup.accelerometer

    @property
    def alone(self) -> ResponseLines:
        """What the channels see, without what the contacts do over time."""
        return ResponseLines(
            model=self.model,
            steady=self.steady.spectra,
            structure=self.structure,
            turns=self.turns,
            mesh_periods=self.mesh_periods,
            gains=self.gains,
            mean_transmission_error=self.mean_transmission_error,
            converged=self.steady.converged,
        )

    def acceleration_rms(self, band: tuple[float, float] | None = None) -> float:
        """RMS of the accelerometer in a band [Hz], the rig's by default [m/s²]."""
        low, high = self.model.rig.band if band is None else band
        f = self.steady.omega[1:] / (2 * pi)
        inside = (f >= low) & (f <= high)
        return float(np.sqrt(0.5 * np.sum(np.abs(self.acceleration_lines[inside]) ** 2)))

    @property
    def constant_loads(self) -> np.ndarray:
        """Torques at motor and brake that keep the mean speed (21,) [N·m]: friction leaves the brake less."""
        T2 = float(DRIVEN @ self._mean_contact_forces)
        return self.setup.condition.torque * MOTOR - T2 * BRAKE

    @property
    def mean_transmission_error(self) -> float:
        """Mean of r_b1·θ7 − r_b2·θ8 [m], zero for rigid perfect gears without load."""
        balanced = self.constant_loads + self._mean_contact_forces
        return float(self.steady.deflection.mean()) + float(self.structure.error_beyond_mesh @ balanced)

    @property
    def face_moment(self) -> np.ndarray:
        """Moment of the drive flanks' forces about the middle of the face (n,) [N·m].

        The bearings of both shafts take it up as a couple in the plane of the line of action, M/span each.
        """
        m, rows = self.setup.slices, (self.setup.passages.side > 0).sum()
        forces = self.steady.contact_forces[: m * rows].reshape(m, rows, -1)
        return self.setup.pair.face_width * (self.setup.face_position * forces).sum(axis=(0, 1))

    @cached_property
    def _mean_contact_forces(self) -> np.ndarray:
        """Mean generalised force of the contacts on the structure (21,)."""
        force = -self.structure.mesh * self.steady.force_lines[0].real
        for along, lines in zip(self.steady.directions, self.steady.action_lines, strict=True):
            force = force - along * lines[0].real
        return force


def solve_with(
    model: Model,
    effects: Iterable[Effect],
    profile: WornProfile | Sequence[WornProfile],
    condition: Condition,
    period: str | None = None,
    *,
    samples: int | None = None,
    start: SteadyState | None = None,
) -> Response:
    """The steady state of a gearbox with effects; see `response.steady.converged`.

    profile  worn flanks, or one for every slice across the face
    period   "mesh", "pinion", "gear" or "hunting"; the shortest that all effects allow where None
    samples  a mesh period; twice as many as usual where None and a longer period has no steady state otherwise: where
             teeth nearly part, coarse samples make steps of their contacts that Newton's method cannot pass
    start    a steady state of similar contacts to start from
    """
    effects = tuple(effects)
    profiles = (profile,) if isinstance(profile, WornProfile) else tuple(profile)
    needed = common_period(effect.period for effect in effects)
    if period is None:
        period = needed
    elif common_period((period, needed)) != period:
        names = ", ".join(
            type(effect).__name__ for effect in effects if common_period((period, effect.period)) != period
        )
        raise ParameterError(f"{names} does not repeat over the period of the {period}: {needed} is needed")
    mean_force = model.mean_force(condition)

    def posed(samples: int | None) -> tuple[Setup, Contacts]:
        setup = _applied(setup_of(model, condition, period, len(profiles), samples), effects)
        return setup, contacts_of(with_tooth_wear(setup, model, effects, profiles), profiles)

    setup, contacts = posed(samples)
    if samples is None and period != "mesh":
        steady = solve(setup.structure, contacts, mean_force, loads=setup.loads, start=start, most=MOST_PRODUCTS)
        if steady.converged:
            return Response(model=model, setup=setup, contacts=contacts, steady=steady)
        (setup, contacts), start = posed(2 * setup.mesh.samples), None
    steady = solve_through_contact_loss(setup.structure, contacts, mean_force, loads=setup.loads, start=start)
    return Response(model=model, setup=setup, contacts=contacts, steady=steady)


def _applied(setup: Setup, effects: Iterable[Effect]) -> Setup:
    for effect in effects:
        setup = effect.apply(setup)
    return setup


class Nearby:
    """Responses near a solved one, to first order, by one linear solution each (twin/dynamics/sensitivity.py)."""

    def __init__(self, response: Response) -> None:
        self.base = response
        setup, model = response.setup, response.model
        mean_force = model.mean_force(setup.condition)
        self._linearised = Linearised(setup.structure, response.contacts, mean_force, response.steady, setup.loads)

    def recalibrated(self, model: Model) -> Response:
        """With other calibrated values of the same gearbox, which effects do no more than multiply."""
        base, old, new = self.base, self.base.model.calibration, model.calibration
        stiffer = new.stiffness_scale / old.stiffness_scale
        longer = 1.0 if new.damping_time == old.damping_time else new.damping_time / old.damping_time
        setup = replace(
            base.setup,
            structure=model.structure,
            stiffness=stiffer * base.setup.stiffness,
            damping_time=longer * base.setup.damping_time,
        )
        contacts = replace(
            base.contacts,
            stiffness=base.contacts.stiffness if stiffer == 1 else stiffer * base.contacts.stiffness,
            damping_time=setup.damping_time,
        )
        return self._moved(model, setup, contacts)

    def response(
        self, model: Model, effects: Iterable[Effect], profile: WornProfile | Sequence[WornProfile]
    ) -> Response:
        """Under the same condition, over the same period.

        Raises ParameterError where an effect does not repeat with it.
        """
        profiles = (profile,) if isinstance(profile, WornProfile) else tuple(profile)
        near, effects = self.base.setup, tuple(effects)
        period = common_period(effect.period for effect in effects)
        samples = near.mesh.samples
        setup = _applied(setup_of(model, near.condition, period, len(profiles), samples), effects)
        return self._moved(model, setup, contacts_of(with_tooth_wear(setup, model, effects, profiles), profiles))

    def _moved(self, model: Model, setup: Setup, contacts: Contacts) -> Response:
        mean_force = model.mean_force(setup.condition)
        steady = self._linearised.moved(setup.structure, contacts, mean_force, setup.loads)
        return Response(model=model, setup=setup, contacts=contacts, steady=steady)
