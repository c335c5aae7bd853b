"""Lines of a window whose speed changes, as a steady window at its mean speed would show them.

    y_k = e_k·⟨T(o_k·Ω)⟩        y_k ← r_k·y_k,     r_k = T(o_k·Ω̄)/⟨T(o_k·Ω)⟩        σ_k² ← |r_k|²·σ_k² + ½·(δ_k·|y_k|)²

y_k   mesh line or sideband of a channel, read against the pinion's angle: narrow however the speed changes
e_k   the transmission error that makes it, the same at every speed [m]
T     what the channel shows of a transmission error of amplitude 1 m, with the mesh closed
⟨ ⟩   mean over the speeds of the window, each as often as the pinion turns at it
δ_k   by how much r_k moves where the machine's natural frequencies are off the rig file's as its tolerances allow
σ_k   noise of the real and of the imaginary part

A line of the encoders, which follows the speed hardly at all, stays as it is; one that passes a resonance counts as
much as the place of the resonance is known. The level is compared only where the same mean changes it by little.

Source   order tracking: P. Borghesani et al., Mech. Syst. Signal Process. 23 (2009) 1-24; passing a resonance slowly:
         F. M. Lewis, Trans. ASME 54 (1932) 253-261
Holds    for speeds spread evenly about their mean, changing slowly: within a decay time 1/(ζω) by less than the width
         2ζ of a resonance. The pinion's own motion, where it alone has an encoder, is left as it is
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import asinh, ceil, log, sqrt
from typing import NamedTuple

import numpy as np

from twin.effects.unknown_effect import transfers
from twin.errors import NotAvailable
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.model import Model
from twin.rig import Rig
from twin.thresholds import deciding
from twin.updating.model_cache import nominal_model_of

EXACT = 1e-14  # relative, of a mean over the speeds
MOST_NODES = 24  # speeds that a mean is taken of
MOST_VARIATION = 0.999 / sqrt(3)  # at which the slowest of speeds spread evenly is above zero


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangingSpeed:
    """When a change of speed within a window matters."""

    steady: float = deciding(
        0.002,
        of="mean speed of the window",
        meaning="standard deviation of the speed within a window up to which the window is one of steady speed",
        source="derivation: a resonance of 2 % damping then moves a line by less than (0.002/0.02)² = 1 %",
    )


LIMITS = ChangingSpeed()


def speeds_of(speed_hz: float, variation: float, nodes: int = MOST_NODES) -> tuple[np.ndarray, np.ndarray]:
    """Speeds within a window [Hz] and the share of turns made at each, (m,) both.

    variation  standard deviation of the speed over its mean; the speeds are spread evenly
    """
    places, weights = _gauss(nodes)
    speeds = speed_hz * (1 + sqrt(3) * variation * places)
    turns = weights * speeds
    return speeds, turns / turns.sum()


_gauss = lru_cache(maxsize=MOST_NODES)(np.polynomial.legendre.leggauss)


def _nodes(damping: float, variation: float) -> int:
    """Speeds of a mean that is EXACT beside resonances of a damping: its error falls as e^{−2n·arsinh(ζ/range)}."""
    rate = 2 * asinh(damping / (sqrt(3) * variation))
    return ceil(min(MOST_NODES, -log(EXACT) / max(rate, 1e-9)))


class Passage(NamedTuple):
    """What a channel shows of a transmission error of amplitude 1 m whose speed changes, at orders (…, n)."""

    at_mean: np.ndarray  # T at the mean speed, complex
    mean: np.ndarray  # ⟨T⟩ over the turns, complex
    power: np.ndarray  # ⟨|T|²⟩ over the time


def passages(model: Model, orders: np.ndarray, speed_hz: float | np.ndarray, variation: float) -> dict[str, Passage]:
    """The passages of all channels (acceleration, encoder, torque) at mean speeds (…) and orders above 0 (n,)."""
    speeds, share = speeds_of(1.0, variation, _nodes(model.structure.modal_damping, variation))
    time = share / speeds / (share / speeds).sum()
    at = np.multiply.outer(np.multiply.outer(speed_hz, [*speeds, 1.0]), orders)
    made = {channel: T.reshape(at.shape) for channel, T in transfers(model, "mesh", at.ravel()).items()}
    return {
        channel: Passage(at_mean=T[..., -1, :], mean=share @ T[..., :-1, :], power=time @ np.abs(T[..., :-1, :]) ** 2)
        for channel, T in made.items()
    }


def with_changing_speed(rig: Rig, features: WindowFeatures, limits: ChangingSpeed = LIMITS) -> WindowFeatures:
    """The features as a steady window at the mean speed would have them, with what that adds to their uncertainty.

    Unchanged where the speed is steady, and where the rig file allows no model.
    """
    speed, variation = features.speed_hz, features.speed_variation
    if speed is None or variation is None or variation <= limits.steady:
        return features
    variation = min(variation, MOST_VARIATION)
    try:
        model = nominal_model_of(rig)
    except NotAvailable:
        return features
    orders = _orders_of(features)
    off = rig.tolerances.stiffness / 2  # of a natural frequency, for that of the stiffness
    made = passages(model, orders, speed * np.array([1.0, 1 - off, 1 + off]), variation)

    def at_mean(channel: str, lines: MeasuredLines | None) -> MeasuredLines | None:
        return None if lines is None else _at_mean_speed(lines, orders, made[channel].at_mean / made[channel].mean)

    level = None
    if features.acceleration is not None and features.rms:
        level = _level_uncertainty(rig.band, features, speed, orders, made["acceleration"])
    return replace(
        features,
        level_uncertainty=level,
        transmission_error=at_mean("encoder", features.transmission_error),
        torque=at_mean("torque", features.torque),
        acceleration=at_mean("acceleration", features.acceleration),
    )


def _orders_of(features: WindowFeatures) -> np.ndarray:
    """Orders of all mesh lines and sidebands, and of what makes the level (n,), rising."""
    mesh = [
        order
        for lines in (features.transmission_error, features.torque, features.acceleration)
        if lines is not None
        for order, (k, _, _) in zip(lines.orders, lines.keys, strict=True)
        if k > 0
    ]
    heard = () if features.acceleration is None else features.acceleration.orders
    return np.unique([*mesh, *(order for order in heard if order > 0)])


def _at_mean_speed(lines: MeasuredLines, orders: np.ndarray, ratios: np.ndarray) -> MeasuredLines:
    """Mesh lines and sidebands of a channel as at the mean speed.

    ratios  r at orders that rise (3, n), as the rig file has the natural frequencies, and with all lower and higher
    """
    of_mesh = np.array([k > 0 for k, _, _ in lines.keys])
    if not of_mesh.any():
        return lines
    at = np.searchsorted(orders, np.array(lines.orders)[of_mesh])
    r, low, high = ratios[:, at]
    y, std = np.array(lines.amplitudes, dtype=complex), np.array(lines.std, dtype=float)
    moved = np.maximum(np.abs(low - r), np.abs(high - r)) * np.abs(y[of_mesh])
    std[of_mesh] = np.sqrt((np.abs(r) * std[of_mesh]) ** 2 + moved**2 / 2)
    y[of_mesh] *= r
    return replace(lines, amplitudes=tuple(y.tolist()), std=tuple(std.tolist()))


def _level_uncertainty(
    band: tuple[float, float], features: WindowFeatures, speed: float, orders: np.ndarray, passage: Passage
) -> float:
    """By how much the level at the mean speed is off that of the window, relative."""
    lines = features.acceleration
    assert lines is not None and features.rms is not None
    own, energy = np.array(lines.orders, dtype=float), np.abs(np.array(lines.amplitudes)) ** 2 / 2
    inside = (own * speed >= band[0]) & (own * speed <= band[1]) & (own > 0)
    if not inside.any():
        return 0.0
    at_mean, mean, power = (values[0, np.searchsorted(orders, own[inside])] for values in passage)
    share = energy[inside] / np.abs(mean) ** 2
    noise = (features.noise_rms or 0.0) ** 2
    return float(abs(sqrt((share @ np.abs(at_mean) ** 2 + noise) / (share @ power + noise)) - 1))
