"""Held-out windows with the unknown: its lines by level, its noise, its modulation and its channel's own faults.

    left = Σ (|y_l| − |m_l|)²,     m_l = H(f_l)·A_l  with the effect in the twin, 0 without it

A line that follows no shaft has no phase that could be predicted from window to window, so that its level counts.
A line that the window does not show is measured as nothing. Noise between the lines counts as one line of its level
(amplitude √2·RMS) in the middle of the band. It is that of a window itself where nothing unknown makes any; where it
does, the twin without the effect expects the noise of before.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from twin.effects.addition import Addition
from twin.effects.unknown_effect import UnknownEffect, transfers
from twin.features.channel_lines import LineReading
from twin.model import Condition, Model
from twin.rig import Rig
from twin.tracing.held_out_error import ENCODERS, HeldOutComparison
from twin.tracing.unknown_lines import THRESHOLDS as SAME
from twin.updating.history import WindowInput
from twin.updating.memory import Line, Memory
from twin.updating.model_cache import healthy_model_of


def unknown_in(additions: Iterable[Addition]) -> Addition | None:
    """The unknown effect among additions; None where there is none."""
    return next((a for a in additions if isinstance(a.effect, UnknownEffect)), None)


def with_unknown(
    rig: Rig,
    memory: Memory,
    compared: HeldOutComparison,
    found: Iterable[Addition],
    present: Sequence[Addition],
    window: WindowInput,
    torque: float,
) -> HeldOutComparison:
    """A window's comparison with the lines of the unknown effect that was found, as a twin with `present` expects them.

    found   every effect of the twin in use
    torque  of the window [N·m]
    """
    whole = unknown_in(found)
    if whole is None:
        return compared
    assert isinstance(whole.effect, UnknownEffect)
    turns = window.features.revolutions or 0.0
    there = unknown_in(present) is not None and whole.onset_revolutions <= turns
    condition = Condition(speed_hz=compared.speed_hz, torque=torque)
    compared = _of_channel(compared, whole.effect, there, window.features.start_time_ns)
    compared = _with_lines(healthy_model_of(rig, memory), rig, compared, whole.effect, there, window, condition)
    if whole.effect.modulation:
        compared = _with_sidebands(rig, compared, whole.effect, there, window)
    if whole.effect.noise and window.features.noise_rms is not None and whole.onset_revolutions <= turns:
        expected = whole.effect.noise if there else whole.effect.noise_before
        rest = max(compared.rms_predicted**2 - window.features.noise_rms**2, 0.0)
        compared = replace(compared, rms_predicted=float(np.sqrt(rest)))
        middle = float(np.mean(rig.band)) / compared.speed_hz
        lines = np.sqrt(2) * np.array([window.features.noise_rms]), np.sqrt(2) * np.array([expected])
        compared = _extended(rig, compared, np.array([middle]), *lines, np.zeros(1))
    return compared


def path_without_fault(
    path: Sequence[Line], found: Iterable[Addition], history: Iterable[WindowInput]
) -> tuple[Line, ...]:
    """Learned factors of the path as a channel without its delay and wrong polarity would have taught them."""
    whole = unknown_in(found)
    if whole is None:
        return tuple(path)
    assert isinstance(whole.effect, UnknownEffect)
    effect = whole.effect
    begun = {
        w.index: w.features.start_time_ns for w in history if (w.features.revolutions or 0.0) >= whole.onset_revolutions
    }
    return tuple(
        (j, f, factor / complex(effect.sensor_gain(np.array([f]), begun[int(j)])[0]), std)
        if int(j) in begun
        else (j, f, factor, std)
        for j, f, factor, std in path
    )


def _of_channel(compared: HeldOutComparison, effect: UnknownEffect, there: bool, start_ns: int) -> HeldOutComparison:
    """With the delay and the polarity of the accelerometer's channel."""
    if not there or (effect.delay == effect.delay_rate == 0 and effect.polarity == 1):
        return compared
    heard = compared.acceleration
    gain = effect.sensor_gain(heard.orders * compared.speed_hz, start_ns)
    heard = replace(heard, predicted=heard.predicted * gain)
    return replace(compared, channels={**compared.channels, "acceleration": heard})


def _with_lines(
    model: Model,
    rig: Rig,
    compared: HeldOutComparison,
    effect: UnknownEffect,
    there: bool,
    window: WindowInput,
    condition: Condition,
) -> HeldOutComparison:
    """With the effect's lines of acceleration and of transmission error, by level."""
    frequencies = effect.frequencies(condition.speed_hz)
    if frequencies.size == 0:
        return compared
    sizes = effect.amplitudes(condition, window.features.revolutions or 0.0) * float(there)
    orders, measured, predicted, std = [], [], [], []
    seen: list[tuple[float, float, float, float]] = []  # by the encoders: order, measured, predicted, noise
    free = list(() if window.non_gear is None else window.non_gear.readings)
    for f, size, entry, drift in zip(frequencies, sizes, effect.entry, effect.drift, strict=True):
        reading = _nearest(free, f, drift, window)
        at = f if reading is None else reading.frequency
        made = transfers(model, entry, [at])
        heard = size * abs(made["acceleration"][0])
        shown = 0.0 if reading is None else abs(reading.amplitude("acceleration") or 0.0)
        orders.append(at / condition.speed_hz)
        measured.append(shown)
        predicted.append(heard)
        std.append(0.0 if reading is None or "acceleration" not in reading.channels else reading.noise("acceleration"))
        if reading is not None:
            free.remove(reading)
            error, noise = reading.amplitude("encoder"), 0.0
            if error is not None:
                noise = reading.noise("encoder")
            moved = size * abs(made["encoder"][0])
            seen.append((at / condition.speed_hz, abs(error or 0.0), moved, noise))
    name = next((n for n in ENCODERS if n in compared.channels), None)
    if name is not None and seen:
        lines = compared.channels[name].extended(*np.transpose(seen))
        compared = replace(compared, channels={**compared.channels, name: lines})
    return _extended(rig, compared, orders, measured, predicted, std)


def _with_sidebands(
    rig: Rig, compared: HeldOutComparison, effect: UnknownEffect, there: bool, window: WindowInput
) -> HeldOutComparison:
    """With the sidebands that a modulation makes of the mesh lines, those that the window shows, by level."""
    teeth, orders, measured, predicted, std = rig.teeth[0], [], [], [], []
    for r in () if window.non_gear is None else window.non_gear.readings:
        k = max(round(r.order / teeth), 1)
        apart = abs(abs(r.order - k * teeth) * compared.speed_hz - effect.modulation_frequency)
        at = np.flatnonzero(np.abs(compared.acceleration.orders - k * teeth) < 1e-6)
        if apart > SAME.same_place / window.features.duration or at.size == 0 or "acceleration" not in r.channels:
            continue
        orders.append(r.order)
        measured.append(abs(r.amplitude("acceleration") or 0.0))
        predicted.append(float(there) * effect.modulation / 2 * abs(compared.acceleration.predicted[at[0]]))
        std.append(r.noise("acceleration"))
    return _extended(rig, compared, orders, measured, predicted, std)


def _nearest(
    readings: Sequence[LineReading], frequency: float, drift: float, window: WindowInput
) -> LineReading | None:
    """The reading of a window that is the line of a frequency, the loudest within what the line wanders."""
    reach = SAME.wander * frequency if drift else SAME.same_place / window.features.duration
    near = [r for r in readings if abs(r.frequency - frequency) < reach]
    return max(near, key=lambda r: abs(r.amplitude("acceleration") or 0.0), default=None)


def _extended(
    rig: Rig,
    compared: HeldOutComparison,
    orders: Sequence[float] | np.ndarray,
    measured: Sequence[float] | np.ndarray,
    predicted: Sequence[float] | np.ndarray,
    std: Sequence[float] | np.ndarray,
) -> HeldOutComparison:
    """With more lines of acceleration; those in the rig's band count into the level."""
    if len(orders) == 0:
        return compared
    low, high = rig.band
    f = np.array(orders) * compared.speed_hz
    inside = (f >= low) & (f <= high)
    added = 0.5 * float(np.sum(np.square(np.array(predicted)[inside])))
    heard = compared.acceleration.extended(orders, measured, predicted, std)
    return replace(
        compared,
        channels={**compared.channels, "acceleration": heard},
        rms_predicted=float(np.sqrt(compared.rms_predicted**2 + added)),
    )
