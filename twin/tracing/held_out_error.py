"""How well a twin predicts windows that took no part in fitting its effects.

    waveform = 100·‖measured − predicted‖/‖measured‖          over the lines of the synchronous averages

A window is predicted from its speed, torque and encoder depth, by the twin with some effects and by the twin without.
Both use the same learned factors, of the path to the housing and of the mesh lines: those that the twin with all
effects took from the windows that were fitted. So they differ by the effects alone, and none can hide in a factor. An
effect is judged on the windows that both twins can predict; a window that one of them cannot is named in the note.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin.assessment import HeldOutBand, HeldOutErrors, HeldOutLine, HeldOutResidual
from twin.effects.addition import Addition
from twin.effects.kept import RESPONSES
from twin.effects.response import Effect, ResponseLines, solve_with
from twin.errors import NotAvailable, NotConverged
from twin.features.window_features import MeasuredLines
from twin.model import Condition, Model
from twin.rig import Rig
from twin.updating.conditions import condition_of
from twin.updating.history import WindowInput
from twin.updating.memory import Line, Memory
from twin.updating.model_cache import healthy_model_of, profile_of
from twin.updating.prediction import MESH, PATH
from twin.wear.profile import WornProfile

HARMONICS = 5  # of the mesh, reported by band
BAND = 2  # shaft orders beside a mesh harmonic
STRONGEST = 40


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChannelComparison:
    """Lines of one channel of a window, measured and predicted, complex (n,) each, in the channel's unit."""

    orders: np.ndarray  # of pinion rotation
    measured: np.ndarray
    predicted: np.ndarray
    std: np.ndarray  # of noise, per real and imaginary part


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HeldOutComparison:
    """One window's lines, measured and predicted, (n,) each."""

    index: int
    speed_hz: float
    orders: np.ndarray
    measured: np.ndarray  # [m/s²]
    predicted: np.ndarray
    std: np.ndarray
    rms_measured: float | None
    rms_predicted: float
    error_left: float  # energies of the transmission error's lines, or of the pinion's motion where it alone has an
    # encoder [m²]
    error_measured: float
    channels: Mapping[str, ChannelComparison] = field(default_factory=dict)  # by name, whatever has been measured

    @property
    def left(self) -> float:
        return float(np.sum(np.abs(self.measured - self.predicted) ** 2))

    @property
    def energy(self) -> float:
        return float(np.sum(np.abs(self.measured) ** 2))

    @property
    def noise(self) -> float:
        return float(np.sum(2 * self.std**2))


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedFactors:
    """Factors of path and mesh as the windows that were fitted taught them."""

    path: tuple[Line, ...]
    mesh: tuple[Line, ...]

    @classmethod
    def of(cls, memory: Memory, held_out: set[int]) -> LearnedFactors:
        return cls(
            path=tuple(line for line in memory.path if int(line[0]) not in held_out),
            mesh=tuple(line for line in memory.mesh if int(line[0]) not in held_out),
        )


def compare(
    rig: Rig, memory: Memory, additions: Sequence[Addition], learned: LearnedFactors, window: WindowInput, depth: float
) -> HeldOutComparison:
    """One window at a depth [m], measured and predicted by the twin with some effects; NotAvailable, NotConverged."""
    features = window.features
    if memory.phase is None or features.acceleration is None or window.level_fault is not None:
        raise NotAvailable("the window cannot be compared: no mesh phase, or no usable accelerometer")
    if window.torque_unknown is not None:
        raise NotAvailable(f"the window cannot be compared: its torque is not known: {window.torque_unknown}")
    condition = condition_of(features, rig)
    turns = features.revolutions or 0.0
    model = healthy_model_of(rig, memory)
    there = (a.at(turns) for a in additions if a.effect.facts.synchronous)
    effects = tuple(effect for effect in there if effect is not None)
    profile = profile_of(rig, memory, turns, depth)
    response = RESPONSES.get(model, effects, profile.slices, condition)
    if not response.converged:
        raise NotConverged(f"no steady state at {condition.speed_hz:g} Hz with {len(effects)} effects")
    per_turn = memory.phase / rig.teeth[0]
    alone = _of_mesh(model, effects, profile.slices, condition, response)
    orders, y, std, m = _lines(features.acceleration, response, alone, "acceleration", per_turn)
    f = np.maximum(orders * condition.speed_hz, 1.0)
    m = m * PATH.predict(learned.path, f, window.index)[0] * MESH.predict(learned.mesh, f, window.index)[0]
    top = min(rig.band[1], np.inf if features.band is None else features.band[1])
    inside = orders * condition.speed_hz <= top
    band = rig.band
    in_band = (orders * condition.speed_hz >= band[0]) & (orders * condition.speed_hz <= band[1])
    channels = {
        "acceleration": ChannelComparison(
            orders=orders[inside], measured=y[inside], predicted=m[inside], std=std[inside]
        )
    }
    if features.torque is not None:
        at, t, torque_std, predicted = _lines(features.torque, response, alone, "torque", per_turn)
        channels["torque"] = ChannelComparison(orders=at, measured=t, predicted=predicted, std=torque_std)
    left = measured = 0.0
    encoder = "transmission_error" if features.transmission_error is not None else "pinion_motion"
    seen = getattr(features, encoder)
    if seen is not None and seen.unit == "m":
        at, e, error_std, predicted = _lines(seen, response, alone, encoder, per_turn)
        predicted = predicted * MESH.predict(learned.mesh, at * condition.speed_hz, window.index)[0]
        channels[encoder] = ChannelComparison(orders=at, measured=e, predicted=predicted, std=error_std)
        left, measured = float(np.sum(np.abs(e - predicted) ** 2)), float(np.sum(np.abs(e) ** 2))
    return HeldOutComparison(
        index=window.index,
        speed_hz=condition.speed_hz,
        orders=orders[inside],
        measured=y[inside],
        predicted=m[inside],
        std=std[inside],
        rms_measured=features.rms,
        rms_predicted=float(np.hypot(np.sqrt(0.5 * np.sum(np.abs(m[in_band]) ** 2)), features.noise_rms or 0.0)),
        error_left=left,
        error_measured=measured,
        channels=channels,
    )


OfMesh = tuple[ResponseLines, ResponseLines] | None


def _of_mesh(
    model: Model,
    effects: Sequence[Effect],
    flanks: Sequence[WornProfile],
    condition: Condition,
    response: ResponseLines,
) -> OfMesh:
    """Of the effects of the mesh's own period alone: with the usual samples, and with those of a longer response.

    A longer period is solved with fewer samples of every mesh period, which moves the mesh lines by some per cent; None
    where the response is of one mesh period itself, or where one of both is not found.
    """
    if response.mesh_periods == 1:
        return None
    samples = 2 * (response.steady.omega.size - 1) // response.mesh_periods
    own = tuple(e for e in effects if e.period == "mesh")
    usual = RESPONSES.get(model, own, flanks, condition)
    coarse = solve_with(model, own, flanks, condition, samples=samples).alone
    return (usual, coarse) if usual.converged and coarse.converged else None


def _lines(
    lines: MeasuredLines, response: ResponseLines, of_mesh: OfMesh, channel: str, per_turn: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Orders, measured lines, their std and the predicted ones, turned to the encoder's zero; (n,) each."""
    every = np.array(lines.orders, dtype=float)
    use = every > 0
    orders = every[use]
    y, std = np.array(lines.amplitudes)[use], np.array(lines.std)[use]
    own = getattr(response, f"{channel}_lines")
    if of_mesh is not None:
        usual, coarse = (getattr(r, f"{channel}_lines") for r in of_mesh)
        at = np.arange(response.mesh_periods - 1, own.size, response.mesh_periods)[: min(usual.size, coarse.size)]
        own = own.copy()
        own[at] += usual[: at.size] - coarse[: at.size]
    place = orders * float(response.turns)
    k = np.rint(place).astype(int)
    there = (np.abs(place - k) < 1e-6) & (k >= 1) & (k <= own.size)
    m = np.zeros(orders.size, dtype=complex)
    m[there] = own[k[there] - 1]
    return orders, y, std, m * np.exp(1j * orders * per_turn)


def errors_of(windows: Sequence[HeldOutComparison], note: str = "") -> HeldOutErrors:
    """Errors of the level and of the waveform over windows; None where there are none."""
    if not windows:
        return HeldOutErrors(note=note)
    energy = sum(w.energy for w in windows)
    levels = [w.rms_predicted / w.rms_measured - 1 for w in windows if w.rms_measured]
    error = sum(w.error_measured for w in windows)
    return HeldOutErrors(
        rms=float(np.sqrt(np.mean(np.square(levels)))) if levels else None,
        waveform=float(np.sqrt(sum(w.left for w in windows) / energy)),
        noise=float(np.sqrt(sum(w.noise for w in windows) / energy)),
        transmission_error=float(np.sqrt(sum(w.error_left for w in windows) / error)) if error > 0 else None,
        windows=tuple(w.index for w in windows),
        note=note,
    )


def residual_by_band_and_order(before: HeldOutComparison, after: HeldOutComparison, teeth: int) -> HeldOutResidual:
    """The residual of one window before and after: by mesh harmonic and by line, the strongest first."""
    bands = []
    for k in range(1, HARMONICS + 1):
        near = np.abs(before.orders - k * teeth) <= BAND + 1e-9
        bands.append(
            HeldOutBand(
                harmonic=k,
                frequency=float(k * teeth * before.speed_hz),
                measured=_rms(before.measured[near]),
                before=_rms(before.predicted[near]),
                after=_rms(after.predicted[near]),
                residual_before=_rms((before.measured - before.predicted)[near]),
                residual_after=_rms((after.measured - after.predicted)[near]),
            )
        )
    size = np.maximum(np.abs(before.measured), np.abs(before.measured - before.predicted))
    lines = [
        HeldOutLine(
            order=float(before.orders[i]),
            frequency=float(before.orders[i] * before.speed_hz),
            measured=float(abs(before.measured[i])),
            before=float(abs(before.measured[i] - before.predicted[i])),
            after=float(abs(after.measured[i] - after.predicted[i])),
        )
        for i in np.argsort(-size)[:STRONGEST]
    ]
    return HeldOutResidual(window=before.index, bands=tuple(bands), lines=tuple(lines))


def _rms(lines: np.ndarray) -> float:
    return float(np.sqrt(0.5 * np.sum(np.abs(lines) ** 2)))
