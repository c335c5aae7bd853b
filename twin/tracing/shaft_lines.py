"""Lines at orders of the pinion over several windows, as multiples of what a unit of an effect makes of them.

    a = Σ_w conj(u_w)·y_w / Σ_w |u_w|²

y_w  line of window w, at absolute angle
u_w  what a unit of the effect makes of it under the window's own speed and torque, by the model

A line that keeps size and phase as a multiple of u_w, from window to window, is driven by the shaft.

Source   linear least squares; the effects' own files for u_w
Holds    effects whose response is linear in their size: small ripples, small unbalances
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects.kept import RESPONSES
from twin.effects.response import Effect
from twin.errors import TwinError
from twin.features.window_features import Key, MeasuredLines, WindowFeatures
from twin.model import Condition, Model

Seen = tuple[int, complex, float]  # window's number, line, std of the line


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyLine:
    """A line that keeps its size and phase over the windows, as multiples of the response to a unit."""

    multiple: complex
    std: float
    size: float  # of the line itself, rms over the windows
    line_std: float  # of the mean line


def lines_of(windows: Sequence[WindowFeatures], channel: str, key: Key) -> list[Seen]:
    """One line of a channel in every window where it was read."""
    out = []
    for i, w in enumerate(windows):
        lines: MeasuredLines | None = getattr(w, channel)
        if lines is not None and key in lines.keys:
            at = lines.keys.index(key)
            out.append((i, lines.amplitudes[at], lines.std[at]))
    return out


def rms(seen: Sequence[Seen]) -> float:
    """Size of a line over the windows, in its unit."""
    return float(np.sqrt(np.mean([abs(y) ** 2 for _, y, _ in seen])))


def std_of_mean(seen: Sequence[Seen]) -> float:
    """Standard deviation of the mean line, in its unit."""
    return float(np.sqrt(np.mean([s**2 for _, _, s in seen]) / len(seen)))


def steady_line(
    seen: Sequence[Seen], units: Sequence[complex], least_steadiness: float, most_scatter: float
) -> SteadyLine | None:
    """Lines as multiples of what a unit makes of them in each window; None where they do not keep size and phase.

    least_steadiness  |mean| over the mean of absolute values
    most_scatter      standard deviation of the absolute values over their mean
    """
    y = np.array([v for _, v, _ in seen])
    unit = np.array([units[i] for i, _, _ in seen])
    if not np.abs(unit).all():
        return None
    multiples, weight = y / unit, np.abs(unit) ** 2
    mean = complex(np.average(multiples, weights=weight))
    sizes = np.abs(multiples)
    size = float(np.average(sizes, weights=weight))
    scatter = float(np.sqrt(np.average((sizes - size) ** 2, weights=weight)))
    if abs(mean) < least_steadiness * size or scatter > most_scatter * size:
        return None
    line_std = std_of_mean(seen)
    return SteadyLine(
        multiple=mean,
        std=float(line_std / np.sqrt(weight.mean())),
        size=float(np.sqrt(np.mean(np.abs(y) ** 2))),
        line_std=line_std,
    )


def unit_responses(
    model: Model,
    conditions: Sequence[Condition],
    effect: Effect,
    channel: str,
    order: float,
    phase: float,
    same_speed: float,
) -> list[complex] | None:
    """What an effect makes of a line under each condition, in the encoder's angle; None without a steady state.

    channel     method of `Response`: "torque", "acceleration" or "transmission_error"
    same_speed  difference of the logarithm of the speed, five times that of the torque, within which windows share one
    """
    known: dict[tuple[int, int], complex] = {}
    out = []
    for condition in conditions:
        key = (round(np.log(condition.speed_hz) / same_speed), round(np.log(condition.torque) / (5 * same_speed)))
        if key not in known:
            try:
                (seen,) = getattr(RESPONSES.get(model, (effect,), model.unworn, condition), channel)([order])
            except TwinError:
                return None
            known[key] = complex(seen * np.exp(1j * order * phase / model.mesh.pair.teeth[0]))
        out.append(known[key])
    return out


def evidence_of_line(size: float | np.ndarray, std: float | np.ndarray) -> float:
    """ln evidence of lines against noise alone [nat], at most a million: beyond, nothing competes with it."""
    return float(min(0.5 * np.sum((size / np.maximum(std, 1e-9)) ** 2), 1e6))


def without_order(windows: Sequence[WindowFeatures], order: int) -> list[WindowFeatures]:
    """The windows without the transmission error's line at one order of the pinion, which a ripple explains."""
    out = []
    for w in windows:
        te = w.transmission_error
        if te is not None and (0, order, 0) in te.keys:
            kept = [i for i, key in enumerate(te.keys) if key != (0, order, 0)]
            te = replace(
                te,
                keys=tuple(te.keys[i] for i in kept),
                orders=tuple(te.orders[i] for i in kept),
                amplitudes=tuple(te.amplitudes[i] for i in kept),
                std=tuple(te.std[i] for i in kept),
            )
        out.append(replace(w, transmission_error=te))
    return out


def without_line(windows: Sequence[WindowFeatures], key: Key, made: Sequence[complex]) -> list[WindowFeatures]:
    """The windows (n,) without what something makes of one line of the transmission error (n,), in its unit."""
    out = []
    for w, own in zip(windows, made, strict=True):
        te = w.transmission_error
        if te is not None and key in te.keys:
            at = te.keys.index(key)
            rest = (*te.amplitudes[:at], te.amplitudes[at] - own, *te.amplitudes[at + 1 :])
            te = replace(te, amplitudes=rest)
        out.append(replace(w, transmission_error=te))
    return out
