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
from math import sqrt

import numpy as np

from twin.effects.unknown_effect import transfers
from twin.errors import NotAvailable
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.model import Model
from twin.rig import Rig
from twin.thresholds import deciding
from twin.updating.model_cache import nominal_model_of

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)  # of the range of speeds, −1 … 1
WEIGHTS = WEIGHTS / 2
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


def speeds_of(speed_hz: float, variation: float) -> tuple[np.ndarray, np.ndarray]:
    """Speeds within a window [Hz] and the share of turns made at each, (m,) both.

    variation  standard deviation of the speed over its mean; the speeds are spread evenly
    """
    speeds = speed_hz * (1 + sqrt(3) * variation * NODES)
    turns = WEIGHTS * speeds
    return speeds, turns / turns.sum()


def transfer_over_speeds(
    model: Model, channel: str, orders: np.ndarray, speed_hz: float, variation: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """T at the mean speed, ⟨T⟩ over the turns and ⟨|T|²⟩ over the time, of a channel at orders above 0; (n,) each.

    channel  acceleration, encoder or torque
    """
    speeds, share = speeds_of(speed_hz, variation)
    passed = transfers(model, "mesh", np.outer(speeds, orders).ravel())[channel].reshape(speeds.size, orders.size)
    return transfers(model, "mesh", orders * speed_hz)[channel], share @ passed, WEIGHTS @ np.abs(passed) ** 2


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
    off = rig.tolerances.stiffness / 2  # of a natural frequency, for that of the stiffness

    def at_mean(channel: str, lines: MeasuredLines | None) -> MeasuredLines | None:
        return None if lines is None else _at_mean_speed(model, channel, lines, speed, variation, off)

    level = None
    if features.acceleration is not None and features.rms:
        level = _level_uncertainty(model, rig.band, features, speed, variation)
    return replace(
        features,
        level_uncertainty=level,
        transmission_error=at_mean("encoder", features.transmission_error),
        torque=at_mean("torque", features.torque),
        acceleration=at_mean("acceleration", features.acceleration),
    )


def _at_mean_speed(
    model: Model, channel: str, lines: MeasuredLines, speed: float, variation: float, off: float
) -> MeasuredLines:
    """Mesh lines and sidebands of a channel as at the mean speed; `off` of the natural frequencies, relative."""
    of_mesh = np.array([k > 0 for k, _, _ in lines.keys])
    if not of_mesh.any():
        return lines
    orders = np.array(lines.orders, dtype=float)[of_mesh]
    ratios = []
    for factor in (1.0, 1 - off, 1 + off):
        at_mean, mean, _ = transfer_over_speeds(model, channel, orders, speed * factor, variation)
        ratios.append(at_mean / mean)
    y, std = np.array(lines.amplitudes, dtype=complex), np.array(lines.std, dtype=float)
    moved = np.maximum(np.abs(ratios[1] - ratios[0]), np.abs(ratios[2] - ratios[0])) * np.abs(y[of_mesh])
    std[of_mesh] = np.sqrt((np.abs(ratios[0]) * std[of_mesh]) ** 2 + moved**2 / 2)
    y[of_mesh] *= ratios[0]
    return replace(lines, amplitudes=tuple(complex(a) for a in y), std=tuple(float(s) for s in std))


def _level_uncertainty(
    model: Model, band: tuple[float, float], features: WindowFeatures, speed: float, variation: float
) -> float:
    """By how much the level at the mean speed is off that of the window, relative."""
    lines = features.acceleration
    assert lines is not None and features.rms is not None
    orders, energy = np.array(lines.orders, dtype=float), np.abs(np.array(lines.amplitudes)) ** 2 / 2
    inside = (orders * speed >= band[0]) & (orders * speed <= band[1]) & (orders > 0)
    if not inside.any():
        return 0.0
    at_mean, mean, power = transfer_over_speeds(model, "acceleration", orders[inside], speed, variation)
    share = energy[inside] / np.abs(mean) ** 2
    noise = (features.noise_rms or 0.0) ** 2
    return float(abs(sqrt((share @ np.abs(at_mean) ** 2 + noise) / (share @ power + noise)) - 1))
