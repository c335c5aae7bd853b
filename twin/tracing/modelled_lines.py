"""What the twin expects of one window, line by line, for display beside the measured signal.

    X_o = m_o·ρ(f_o)·t(f_o)·e^{i·o·φ/z1},      x(θ) = Re Σ_o X_o·e^{i·o·θ}

m_o   line of the model with all effects that are in the twin, at the window's speed, torque and wear depth
ρ, t  measured over predicted path and transmission error, learned (updating/prediction.py)
φ     mesh phase against the pinion encoder's zero
θ     absolute pinion angle

The model is the present one, with what has been calibrated, learned and found since the window was recorded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.effects.response import solve_with
from twin.errors import NotAvailable, NotConverged
from twin.features.window_features import WindowFeatures
from twin.geometry import GearPair
from twin.rig import Rig
from twin.state import State
from twin.updating.conditions import condition_of
from twin.updating.model_cache import healthy_model_of, profile_of
from twin.updating.prediction import MESH, PATH
from twin.wear.profile import WornProfile


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelledLines:
    """Complex lines, peak, against the absolute pinion angle; only amplitudes mean anything without `phase_known`."""

    orders: np.ndarray  # of pinion rotation (n,)
    frequencies: np.ndarray  # (n,) [Hz]
    acceleration: np.ndarray  # of the reference accelerometer (n,) [m/s²]
    transmission_error: np.ndarray  # (n,) [m]
    torque: np.ndarray  # (n,) [N·m]
    sensor: str | None  # the reference accelerometer
    phase_known: bool
    effects: tuple[str, ...]  # that were in the model
    depth: float  # combined [m]
    pair: GearPair
    profile: WornProfile

    def waveform(self, lines: np.ndarray, angles: np.ndarray, period_turns: float | None = None) -> np.ndarray:
        """x(θ) at absolute pinion angles [rad] (m,); only of the orders that repeat every so many pinion turns."""
        use = np.abs(lines) > 0
        if period_turns is not None:
            of_period = self.orders * period_turns
            use &= np.abs(of_period - np.rint(of_period)) < 1e-6
        chosen = np.flatnonzero(use)
        out = np.zeros(angles.size)
        for i in chosen:
            out += (lines[i] * np.exp(1j * self.orders[i] * angles)).real
        return out


def depth_at(state: State, start_time_ns: int) -> float | None:
    """The depth [m] of the window that started then, by the twin in use; None where it has none."""
    index = next((h.index for h in state.tracing.history if h.features.start_time_ns == start_time_ns), None)
    stages = state.tracing.stages
    return None if index is None or not stages else stages[-1].depths.get(index)


def modelled_lines(rig: Rig, state: State, features: WindowFeatures, depth: float) -> ModelledLines:
    """The lines of one window at a depth [m]; NotAvailable, NotConverged."""
    memory = state.memory
    if not memory.segments:
        raise NotAvailable("no window has been compared with the model yet")
    condition = condition_of(features, rig)
    turns = features.revolutions or 0.0
    found = {f.name: f.addition for f in state.tracing.found}
    there = {name: a.at(turns) for name, a in found.items() if a.effect.facts.synchronous}
    active = {name: effect for name, effect in there.items() if effect is not None}
    model = healthy_model_of(rig, memory)
    profile = profile_of(rig, memory, turns, depth)
    response = solve_with(model, active.values(), profile.slices, condition)
    if not response.steady.converged:
        raise NotConverged(f"no steady state at {condition.speed_hz:g} Hz")
    orders = response.orders
    f = orders * condition.speed_hz
    index = next((h.index for h in state.tracing.history if h.features.start_time_ns == features.start_time_ns), 0)
    mesh = MESH.predict(memory.mesh, f, index)
    path = PATH.predict(memory.path, f, index)
    turned = np.exp(1j * orders * (memory.phase or 0.0) / rig.teeth[0])
    return ModelledLines(
        orders=orders,
        frequencies=f,
        acceleration=response.acceleration_lines * path * mesh * turned,
        transmission_error=response.transmission_error_lines * mesh * turned,
        torque=response.torque_lines * mesh * turned,
        sensor=rig.accelerometer,
        phase_known=memory.phase is not None,
        effects=tuple(active),
        depth=depth,
        pair=model.mesh.pair,
        profile=profile,
    )
