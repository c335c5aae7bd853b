"""The gearbox with effects, as the calibrated model that updating asks for steady states.

    extend(model, effects)

What acts over one mesh period (misalignment, friction, profile, stiffness, damping) is in every steady state, and in
the wear that follows from it: with misalignment every slice of the face wears by its own load. What repeats only with
a turn of a shaft (pitch errors, a crack, eccentricity) leaves the mean flank as it is, and joins where a window is
predicted: `window_lines`, over the period that it needs, with what every tooth has worn more or less than the mean
where teeth differ (twin/effects/tooth_wear.py). A sensor's error is in the acceleration alone.

Sizes    on the reference rig, worn 25 µm, eccentricities of 90 µm move the transmission error's mesh lines by less than
         0.1 %, unworn by 0.1 µm; pitch errors of 5 µm double the unworn ones
Ignores  what differing teeth do to the mean flank in the wear curve; what eccentricity does to the wear of single teeth
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import pi

import numpy as np

from twin.dynamics.contact_loss import solve_through_contact_loss
from twin.dynamics.harmonic_balance import EVERY, SteadyState
from twin.dynamics.structure import Structure
from twin.effects.response import Effect, Response, solve_with
from twin.effects.setup import SensorGain, contacts_of, sampled, setup_of
from twin.errors import NotConverged
from twin.model import Calibration, Condition, Model
from twin.wear.curve import LINES, MeshLines
from twin.wear.profile import WornProfile

KEPT = 256  # windows with effects of longer periods; 10 kB each, 60 kB with a structure of its own
SLICED_SAMPLES = 256  # a mesh period, where the face is sliced: lines within 2.5 nm and 0.1 % of those with 1024


@dataclass(frozen=True, eq=False, kw_only=True)
class ExtendedModel(Model):
    """One calibrated gearbox with effects."""

    effects: tuple[Effect, ...]

    @cached_property
    def of_mesh(self) -> tuple[Effect, ...]:
        """Those that act over one mesh period."""
        return tuple(e for e in self.effects if e.period == "mesh")

    @cached_property
    def slices(self) -> int:
        """Across the face: as many as the effects of the mesh ask for, whatever their size."""
        return slices_of(self.of_mesh)

    @cached_property
    def sensor_gains(self) -> tuple[SensorGain, ...]:
        """What a faulty accelerometer does to each frequency."""
        setup = setup_of(self, Condition(speed_hz=10.0, torque=10.0), "mesh")
        for effect in self.of_mesh:
            if effect.facts.acts_on == "sensor":
                setup = effect.apply(setup)
        return setup.accelerometer

    @cached_property
    def unworn(self) -> WornProfile:
        return WornProfile.unworn(self.mesh.pair).across(self.slices)

    def response(
        self, profile: WornProfile, condition: Condition, start: SteadyState | None = None, whole: bool = False
    ) -> Response:
        """The response over a mesh period, or over the period that all effects need; see its `steady.converged`."""
        if whole:
            return solve_with(self, self.effects, profile.slices, condition, start=start)
        setup = setup_of(self, condition, "mesh", len(profile.slices))
        for effect in self.of_mesh:
            setup = effect.apply(setup)
        contacts = contacts_of(setup, profile.slices)
        steady = solve_through_contact_loss(
            setup.structure, contacts, self.mean_force(condition), loads=setup.loads, start=start
        )
        return Response(model=self, setup=setup, contacts=contacts, steady=steady)

    def steady(self, profile: WornProfile, condition: Condition, start: SteadyState | None = None) -> SteadyState:
        return self.response(profile.across(self.slices), condition, start).steady

    def acceleration_lines(self, steady: SteadyState, at: slice = EVERY) -> np.ndarray:
        lines = super().acceleration_lines(steady, at)
        for gain in self.sensor_gains:
            lines = gain(steady.omega[at] / (2 * pi)) * lines
        return lines

    def mean_transmission_error(self, steady: SteadyState, condition: Condition) -> float:
        """As without effects, with the loads that friction leaves the brake (Response.mean_transmission_error)."""
        if not steady.directions:
            return super().mean_transmission_error(steady, condition)
        setup = replace(setup_of(self, condition, "mesh"), structure=self.structure)
        return Response(model=self, setup=setup, contacts=None, steady=steady).mean_transmission_error  # type: ignore[arg-type]


def slices_of(effects: Iterable[Effect]) -> int:
    """Slices across the face that effects need, whatever their size: a fit may pass through none."""
    return max((effect.facts.slices for effect in effects), default=1)


def extend(model: Model, effects: Iterable[Effect]) -> Model:
    """The model with those effects in it that change the mesh lines; the very model where there are none."""
    effects = tuple(e for e in effects if e.facts.changes_mesh_lines)
    if not effects:
        return model
    sliced = slices_of(effects) > 1
    return ExtendedModel(
        rig=model.rig,
        calibration=model.calibration,
        structure=model.structure,
        mesh=sampled(model.mesh, SLICED_SAMPLES) if sliced else model.mesh,
        effects=effects,
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WindowLines:
    """What a window is expected to show at the mesh orders."""

    lines: MeshLines
    beyond: np.ndarray  # acceleration lines above the LINES-th [m/s²]
    contact_loss: float


def window_lines(model: Model, profile: WornProfile, condition: Condition) -> WindowLines:
    """The mesh lines with everything in the model, whatever period it needs; raises NotConverged."""
    long = isinstance(model, ExtendedModel) and any(e.period != "mesh" for e in model.effects)
    if not long:
        steady = model.steady(profile, condition)
        if not steady.converged:
            raise NotConverged(f"no steady state at {condition.speed_hz:g} Hz, {condition.torque:g} N·m")
        return WindowLines(
            lines=MeshLines.of(model, steady, condition),
            beyond=model.acceleration_lines(steady)[LINES:],
            contact_loss=steady.contact_loss,
        )
    assert isinstance(model, ExtendedModel)
    return _over_long_period(_Asked.of(model, profile.across(model.slices), condition))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    """What a window's lines follow from: a trace asks for the same of many windows that the trace before asked for."""

    model: ExtendedModel = field(compare=False)
    profile: WornProfile = field(compare=False)
    condition: Condition
    rig: str
    calibration: Calibration
    structure: Structure
    samples: int  # a mesh period
    effects: tuple[Effect, ...]
    depths: tuple[bytes, ...]  # of every slice of the face

    @classmethod
    def of(cls, model: ExtendedModel, profile: WornProfile, condition: Condition) -> _Asked:
        return cls(
            model=model,
            profile=profile,
            condition=condition,
            rig=model.rig.text,
            calibration=model.calibration,
            structure=model.structure,
            samples=model.mesh.samples,
            effects=model.effects,
            depths=tuple(each.depth.tobytes() for each in profile.slices),
        )


@lru_cache(maxsize=KEPT)
def _over_long_period(asked: _Asked) -> WindowLines:
    model, condition = asked.model, asked.condition
    response = model.response(asked.profile, condition, whole=True)
    if not response.steady.converged:
        raise NotConverged(f"no steady state with effects at {condition.speed_hz:g} Hz, {condition.torque:g} N·m")
    z1 = model.mesh.pair.teeth[0]
    highest = int(response.orders[-1] / z1)
    orders = z1 * np.arange(1, highest + 1)
    step = round(z1 * float(response.setup.turns))
    motion = response.steady.lines(response.setup.structure, response.setup.structure.pinion_motion)
    heard = response.acceleration(orders)
    found = WindowLines(
        lines=MeshLines(
            transmission_error=response.transmission_error(orders[:LINES]),
            mean=response.mean_transmission_error,
            pinion_motion=motion[step - 1 :: step][:LINES].copy(),
            acceleration=heard[:LINES].copy(),
        ),
        beyond=heard[LINES:],
        contact_loss=response.steady.contact_loss,
    )
    for values in (found.lines.transmission_error, found.lines.pinion_motion, found.lines.acceleration, found.beyond):
        values.setflags(write=False)  # others are given the same
    return found
