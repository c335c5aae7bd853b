"""How well a twin predicts windows that took no part in fitting its effects.

    waveform = 100·‖measured − predicted‖/‖measured‖          over the lines of the synchronous averages

A window is predicted from its speed, torque and encoder depth, by the twin with some effects and by the twin without.
Both use the same learned factors, of the path to the housing and of the mesh lines: those that the twin with all
effects took from the windows that were fitted. So they differ by the effects alone, and none can hide in a factor. An
effect is judged on the windows that both twins can predict; a window that one of them cannot is named in the note.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri

from twin.assessment import HealthyErrors, HeldOutBand, HeldOutErrors, HeldOutLine, HeldOutResidual
from twin.effects.addition import Addition
from twin.effects.kept import RESPONSES
from twin.effects.response import Effect, ResponseLines, solve_with
from twin.errors import NotAvailable, NotConverged
from twin.features.window_features import MeasuredLines
from twin.model import Condition, Model
from twin.rig import Rig
from twin.tracing.healthy_lines import LIMITS, HealthyLines, LearnedFactors, largest_healthy
from twin.updating.conditions import condition_of
from twin.updating.history import WindowInput
from twin.updating.memory import Memory
from twin.updating.model_cache import healthy_model_of, profile_of
from twin.updating.prediction import parts
from twin.wear.profile import WornProfile

HARMONICS = 5  # of the mesh, reported by band
BAND = 2  # shaft orders beside a mesh harmonic
STRONGEST = 40


ENCODERS = ("transmission_error", "pinion_motion")
LINE_ARRAYS = ("orders", "measured", "predicted", "std", "variance")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChannelComparison:
    """Lines of one channel of a window, measured and predicted, complex (n,) each, in the channel's unit."""

    orders: np.ndarray  # of pinion rotation
    measured: np.ndarray
    predicted: np.ndarray
    std: np.ndarray  # of noise, per real and imaginary part
    variance: np.ndarray  # of a healthy machine's line about its prediction (healthy_lines.py)

    @property
    def left(self) -> float:
        """Energy of what the prediction leaves."""
        return float(np.sum(np.abs(self.measured - self.predicted) ** 2))

    @property
    def energy(self) -> float:
        return float(np.sum(np.abs(self.measured) ** 2))

    @property
    def error(self) -> float:
        """‖measured − predicted‖/‖measured‖."""
        return float(np.sqrt(self.left / self.energy)) if self.energy > 0 else 0.0

    def chosen(self, use: np.ndarray) -> ChannelComparison:
        """Those lines alone; use (n,) bool."""
        return ChannelComparison(**{name: getattr(self, name)[use] for name in LINE_ARRAYS})

    def extended(self, orders: Any, measured: Any, predicted: Any, std: Any) -> ChannelComparison:
        """With more lines, of which the level is predicted alone; (m,) each."""
        floor = LIMITS.foreign_floor * float(np.abs(self.measured).max(initial=0.0))
        variance = 2 * np.square(std) + (LIMITS.foreign * np.abs(measured)) ** 2 + max(floor**2, 1e-30)
        added = (np.asarray(x) for x in (orders, measured, predicted, std, variance))
        return ChannelComparison(
            **{name: np.concatenate((getattr(self, name), more)) for name, more in zip(LINE_ARRAYS, added, strict=True)}
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HeldOutComparison:
    """One window, measured and predicted, by channel."""

    index: int
    speed_hz: float
    channels: Mapping[str, ChannelComparison]  # by name, whatever has been measured; the acceleration always
    rms_measured: float | None  # of the acceleration in the rig's band [m/s²]
    rms_predicted: float

    @property
    def acceleration(self) -> ChannelComparison:
        return self.channels["acceleration"]

    @property
    def encoder(self) -> ChannelComparison | None:
        """The transmission error, or the pinion's motion where it alone has an encoder."""
        return next((self.channels[name] for name in ENCODERS if name in self.channels), None)


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
    unworn = RESPONSES.get(model, (), model.unworn, condition)
    healthy = HealthyLines.of(rig)
    top = min(rig.band[1], np.inf if features.band is None else features.band[1])
    channels = {}
    for name in ("acceleration", "torque", *ENCODERS):
        lines = getattr(features, name)
        if lines is None or (name in ENCODERS and (lines.unit != "m" or any(e in channels for e in ENCODERS))):
            continue
        orders, y, std, m = _lines(lines, response, alone, name, per_turn)
        new = _lines(lines, unworn, None, name, per_turn)[3] if unworn.converged else np.zeros_like(m)
        ρ, t = learned.at(np.maximum(orders * condition.speed_hz, 1.0), window.index)
        factor = {"acceleration": ρ * t, "torque": 1.0}.get(name, t)
        inside = orders * condition.speed_hz <= (top if name == "acceleration" else np.inf)
        orders, y, std, m, new = (x[inside] for x in (orders, y, std, m * factor, new * factor))
        v = healthy.variance(name, orders, condition.speed_hz, parts(m, new), std, depth, learned)
        channels[name] = ChannelComparison(orders=orders, measured=y, predicted=m, std=std, variance=v)
    heard = channels["acceleration"]
    in_band = heard.orders * condition.speed_hz >= rig.band[0]
    return HeldOutComparison(
        index=window.index,
        speed_hz=condition.speed_hz,
        channels=channels,
        rms_measured=features.rms,
        rms_predicted=float(
            np.hypot(np.sqrt(0.5 * np.sum(np.abs(heard.predicted[in_band]) ** 2)), features.noise_rms or 0.0)
        ),
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
    """Errors over windows, with those that a healthy machine has at most; None where there are none."""
    if not windows:
        return HeldOutErrors(note=note)
    heard, seen = [w.acceleration for w in windows], [w.encoder for w in windows if w.encoder is not None]
    levels = [w.rms_predicted / w.rms_measured - 1 for w in windows if w.rms_measured]
    energy = sum(lines.energy for lines in heard)
    return HeldOutErrors(
        rms=float(np.sqrt(np.mean(np.square(levels)))) if levels else None,
        waveform=_over(heard),
        noise=float(np.sqrt(sum(float(np.sum(2 * lines.std**2)) for lines in heard) / energy)) if energy > 0 else None,
        transmission_error=_over(seen),
        windows=tuple(w.index for w in windows),
        note=note,
        healthy=HealthyErrors(rms=_healthy_level(windows), waveform=_healthy(heard), transmission_error=_healthy(seen)),
    )


def _over(lines: Sequence[ChannelComparison]) -> float | None:
    """The relative error of one channel over several windows."""
    energy = sum(c.energy for c in lines)
    return float(np.sqrt(sum(c.left for c in lines) / energy)) if energy > 0 else None


def _healthy(lines: Sequence[ChannelComparison]) -> float | None:
    """The relative error that a healthy machine has at most in one channel."""
    energy = sum(c.energy for c in lines)
    return float(np.sqrt(largest_healthy([c.variance for c in lines]) / energy)) if energy > 0 else None


def _healthy_level(windows: Sequence[HeldOutComparison]) -> float | None:
    """The relative error of the level that a healthy machine has at most: of lines that are each off by themselves."""
    off = []
    for w in windows:
        c = w.acceleration
        if w.rms_predicted > 0:
            off.append(0.5 * np.sqrt(np.sum(np.abs(c.predicted) ** 2 * c.variance / 2)) / w.rms_predicted**2)
    return None if not off else float(-ndtri(0.5 * (1 - LIMITS.quantile)) * np.sqrt(np.mean(np.square(off))))


def residual_by_band_and_order(before: HeldOutComparison, after: HeldOutComparison, teeth: int) -> HeldOutResidual:
    """The residual of one window before and after: by mesh harmonic and by line, the strongest first."""
    one, other, bands = before.acceleration, after.acceleration, []
    for k in range(1, HARMONICS + 1):
        near = np.abs(one.orders - k * teeth) <= BAND + 1e-9
        bands.append(
            HeldOutBand(
                harmonic=k,
                frequency=float(k * teeth * before.speed_hz),
                measured=_rms(one.measured[near]),
                before=_rms(one.predicted[near]),
                after=_rms(other.predicted[near]),
                residual_before=_rms((one.measured - one.predicted)[near]),
                residual_after=_rms((other.measured - other.predicted)[near]),
            )
        )
    size = np.maximum(np.abs(one.measured), np.abs(one.measured - one.predicted))
    lines = [
        HeldOutLine(
            order=float(one.orders[i]),
            frequency=float(one.orders[i] * before.speed_hz),
            measured=float(abs(one.measured[i])),
            before=float(abs(one.measured[i] - one.predicted[i])),
            after=float(abs(other.measured[i] - other.predicted[i])),
        )
        for i in np.argsort(-size)[:STRONGEST]
    ]
    return HeldOutResidual(window=before.index, bands=tuple(bands), lines=tuple(lines))


def _rms(lines: np.ndarray) -> float:
    return float(np.sqrt(0.5 * np.sum(np.abs(lines) ** 2)))
