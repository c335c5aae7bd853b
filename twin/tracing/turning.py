"""What turns with a shaft and pushes: unbalance, torque ripple, and the rattle of teeth that part.

    |mean of the line over the windows| at absolute angle, against the twin's response to a unit of the effect

A line that keeps its size and its phase against the shaft from window to window is driven by it. The torque meter
shows a ripple of the drive directly; the accelerometer shows an unbalance at the shaft's own order, where the mesh has
nothing. Where the torque swings as far as its mean and noise fills the spectrum, the teeth part: rattle.

Source   twin/effects/torque_ripple.py, mass_unbalance.py, backlash_rattle.py
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from twin.effects import EFFECTS
from twin.effects.response import Effect, solve_with
from twin.errors import TwinError
from twin.features.window_features import Lines, WindowFeatures
from twin.model import Condition, Model
from twin.wear.profile import WornProfile

LEAST_TORQUE = 0.005  # of a line of the torque meter that keeps its phase [N·m]
LEAST_ACCELERATION = 0.002  # at the pinion's own order [m/s²]
LEAST_WINDOWS = 4
STEADY = 0.85  # |mean| over mean of absolute values
ORDERS = range(1, 11)
PARTING = 0.6  # of the mean torque: a swing that parts the teeth
NOISY = 0.3  # share of the level that lies between the orders, when teeth strike


@dataclass(frozen=True, slots=True, kw_only=True)
class Turning:
    """One effect that turns with the pinion."""

    effect: Effect
    parameters: dict[str, tuple[float, str, float]]  # value, unit, std
    log_evidence: float


def _steady(windows: Sequence[WindowFeatures], name: str, key: tuple[int, int, int]) -> tuple[complex, float] | None:
    """Mean of a line over the windows, and its std; None where it does not keep its phase."""
    seen = []
    for w in windows:
        lines: Lines | None = getattr(w, name)
        if lines is not None and lines.get(*key) is not None:
            seen.append((lines.at(*key), lines.std_at(*key)))
    if len(seen) < LEAST_WINDOWS:
        return None
    y = np.array([v for v, _ in seen])
    if abs(y.mean()) < STEADY * np.abs(y).mean():
        return None
    return complex(y.mean()), float(np.sqrt(np.mean([s**2 for _, s in seen]) / len(seen)))


def rattling(windows: Sequence[WindowFeatures]) -> bool:
    """Whether the teeth part and strike in most of the windows."""
    noisy = [(w.noise_rms or 0.0) > NOISY * w.rms for w in windows if w.rms]
    return bool(noisy) and float(np.mean(noisy)) > 0.5


def find_turning(
    model: Model,
    windows: Sequence[WindowFeatures],
    condition: Condition,
    profile: WornProfile,
    phase: float,
    taken: Collection[int] = (),
) -> list[Turning]:
    """Ripple or rattle, and unbalance, from measurement windows.

    taken  orders of the torque that effects found before explain
    """
    out: list[Turning] = []
    z1 = model.mesh.pair.teeth[0]
    swings = []
    for p in ORDERS:
        if p in taken:
            continue
        line = _steady(windows, "torque", (0, p, 0))
        if line is not None and abs(line[0]) > LEAST_TORQUE and abs(line[0]) > 6 * line[1]:
            swings.append((abs(line[0]), p, line))
    rattle = rattling(windows)
    if rattle:
        raw = [
            (abs(w.torque.at(0, p, 0)), p)
            for w in windows
            for p in ORDERS
            if w.torque is not None and w.torque.get(0, p, 0) is not None
        ]
        swing, order = max(raw, default=(0.0, 1))
        if swing > 0.1 * PARTING * condition.torque:
            at_brake = _per_unit(model, condition, profile, order)
            size = float(min(swing / at_brake, 45.0)) if at_brake else float(swing)
            out.append(
                Turning(
                    effect=EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=size, order=float(order)),
                    parameters={"load_ripple": (size, "N·m", 0.3 * size), "order": (float(order), "", 0.0)},
                    log_evidence=30.0,
                )
            )
            return out
    if swings:
        size, p, (value, std) = max(swings)
        unit = EFFECTS["torque_ripple"](amplitude=0.1, order=float(p))
        try:
            (seen,) = solve_with(model, (unit,), profile, condition).torque([float(p)])
        except TwinError:
            seen = 0.0
        if abs(seen) > 0:
            amplitude = 0.1 * size / abs(seen)
            turned = value * np.exp(-1j * p * phase / z1) / seen
            out.append(
                Turning(
                    effect=EFFECTS["torque_ripple"](
                        amplitude=float(amplitude), order=float(p), phase=float(np.angle(turned))
                    ),
                    parameters={
                        "amplitude": (float(amplitude), "N·m", float(amplitude * (std / size + 0.05))),
                        "order": (float(p), "", 0.0),
                    },
                    log_evidence=float(min(0.5 * (size / max(std, 1e-3)) ** 2, 1e4)),
                )
            )
    line = _steady(windows, "acceleration", (0, 1, 0))
    if line is not None and abs(line[0]) > LEAST_ACCELERATION and abs(line[0]) > 5 * line[1]:
        unit = EFFECTS["mass_unbalance"](pinion=1e-3)
        try:
            (seen,) = solve_with(model, (unit,), profile, condition).acceleration([1.0])
        except TwinError:
            seen = 0.0
        if abs(seen) > 0:
            U = 1e-3 * abs(line[0]) / abs(seen)
            turned = line[0] * np.exp(-1j * phase / z1) / seen
            out.append(
                Turning(
                    effect=EFFECTS["mass_unbalance"](
                        pinion=float(min(U, 0.05)), pinion_heavy_point=float(np.angle(turned))
                    ),
                    parameters={"pinion": (float(U), "kg·m", float(U * (line[1] / abs(line[0]) + 0.1)))},
                    log_evidence=float(min(0.5 * (abs(line[0]) / line[1]) ** 2, 1e4)),
                )
            )
    return out


def _per_unit(model: Model, condition: Condition, profile: WornProfile, order: int) -> float:
    """Torque meter's line per unit ripple of the load, linear; 0 where there is no steady state."""
    unit = EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=0.1, order=float(order))
    try:
        (seen,) = solve_with(model, (unit,), profile, condition).torque([float(order)])
    except TwinError:
        return 0.0
    return abs(seen) / 0.1
