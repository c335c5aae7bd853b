"""What turns with a shaft and pushes: unbalance, torque ripple, and the rattle of teeth that part.

    |mean of the line over the windows| at absolute angle, against the twin's response to a unit of the effect

A line that keeps its size and its phase against the shaft from window to window is driven by it. The torque meter
shows a ripple of the drive directly; the accelerometer shows an unbalance at the shaft's own order, where the mesh has
nothing. Where the torque swings as far as its mean and noise fills the spectrum, the teeth part: rattle.

Source   twin/effects/torque_ripple.py, mass_unbalance.py, backlash_rattle.py
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects import EFFECTS
from twin.effects.response import Effect, solve_with
from twin.errors import TwinError
from twin.features.window_features import Lines, WindowFeatures
from twin.model import Condition, Model
from twin.tracing.scatter import MODELLED
from twin.wear.profile import WornProfile

LEAST_TORQUE = 0.005  # of a line of the torque meter that keeps its phase [N·m]
LEAST_ACCELERATION = 0.002  # at the pinion's own order [m/s²]
LEAST_WINDOWS = 4
STEADY = 0.85  # |mean| over mean of absolute values
STEADY_SIZE = 0.3  # std of absolute values over their mean: what drives a line does not grow with wear
ORDERS = range(1, 11)
DOMINANT = 3.0  # of a ripple's line over the next one: pitch errors and run-out make lines at many orders
EXPLAINED = 0.5  # of a line: what may be left where something else makes it
PARTING = 0.6  # of the mean torque: a swing that parts the teeth
NOISY = 0.3  # share of the level that lies between the orders, when teeth strike


@dataclass(frozen=True, slots=True, kw_only=True)
class Turning:
    """One effect that turns with the pinion."""

    effect: Effect
    parameters: dict[str, tuple[float, str, float]]  # value, unit, std
    log_evidence: float


def _steady(windows: Sequence[WindowFeatures], name: str, key: tuple[int, int, int]) -> tuple[complex, float] | None:
    """Mean of a line over the windows, and its std; None where it does not keep its phase and its size."""
    seen = []
    for w in windows:
        lines: Lines | None = getattr(w, name)
        if lines is not None and lines.get(*key) is not None:
            seen.append((lines.at(*key), lines.std_at(*key)))
    if len(seen) < LEAST_WINDOWS:
        return None
    y = np.array([v for v, _ in seen])
    size = np.abs(y)
    if abs(y.mean()) < STEADY * size.mean() or np.std(size) > STEADY_SIZE * size.mean():
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
) -> list[Turning]:
    """Rattle, or ripple and unbalance, from measurement windows."""
    if rattling(windows):
        rattle = _rattle(model, windows, condition, profile)
        if rattle is not None:
            return [rattle]
    unbalance = _unbalance(model, windows, condition, profile, phase)
    ripple = _ripple(model, windows, condition, profile, phase, set() if unbalance is None else {1})
    return [found for found in (ripple, unbalance) if found is not None]


def _rattle(
    model: Model, windows: Sequence[WindowFeatures], condition: Condition, profile: WornProfile
) -> Turning | None:
    """The swing of the load that parts the teeth; None where none is large enough."""
    raw = [
        (abs(w.torque.at(0, p, 0)), p)
        for w in windows
        for p in ORDERS
        if w.torque is not None and w.torque.get(0, p, 0) is not None
    ]
    swing, order = max(raw, default=(0.0, 1))
    seen = [
        (abs(w.torque.at(0, order, 0)), w.torque.std_at(0, order, 0))
        for w in windows
        if w.torque is not None and w.torque.get(0, order, 0) is not None
    ]
    if swing <= 0.1 * PARTING * condition.torque:
        return None
    sizes, stds = np.array(seen).T
    at_brake = _per_unit(model, condition, profile, order)
    size = float(min(swing / at_brake, 45.0)) if at_brake else float(swing)
    return Turning(
        effect=EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=size, order=float(order)),
        parameters={
            "load_ripple": (size, "N·m", float(size * np.hypot(np.std(sizes) / swing, MODELLED))),
            "order": (float(order), "", 0.0),
        },
        log_evidence=_of_line(sizes, stds),
    )


def _ripple(
    model: Model,
    windows: Sequence[WindowFeatures],
    condition: Condition,
    profile: WornProfile,
    phase: float,
    taken: Collection[int],
) -> Turning | None:
    """The one order of the torque that stands out and keeps its phase; teeth that differ have lines at all orders."""
    swings = []
    for p in ORDERS:
        line = _steady(windows, "torque", (0, p, 0))
        if line is not None and abs(line[0]) > LEAST_TORQUE and abs(line[0]) > 6 * line[1]:
            swings.append((abs(line[0]), p, line))
    if not swings:
        return None
    size, p, (value, std) = max(swings)
    rest = max((s for s, q, _ in swings if q != p), default=0.0)
    if p in taken or size < DOMINANT * rest:
        return None
    unit = EFFECTS["torque_ripple"](amplitude=0.1, order=float(p))
    try:
        (seen,) = solve_with(model, (unit,), profile, condition).torque([float(p)])
    except TwinError:
        return None
    if abs(seen) == 0:
        return None
    amplitude = 0.1 * size / abs(seen)
    turned = value * np.exp(-1j * p * phase / model.mesh.pair.teeth[0]) / seen
    return Turning(
        effect=EFFECTS["torque_ripple"](amplitude=float(amplitude), order=float(p), phase=float(np.angle(turned))),
        parameters={
            "amplitude": (float(amplitude), "N·m", float(amplitude * np.hypot(std / size, MODELLED))),
            "order": (float(p), "", 0.0),
        },
        log_evidence=_of_line(size, max(std, 1e-3)),
    )


def _unbalance(
    model: Model, windows: Sequence[WindowFeatures], condition: Condition, profile: WornProfile, phase: float
) -> Turning | None:
    """What shakes the housing once a turn of the pinion, always at the same angle."""
    line = _steady(windows, "acceleration", (0, 1, 0))
    if line is None or abs(line[0]) <= LEAST_ACCELERATION or abs(line[0]) <= 5 * line[1]:
        return None
    unit = EFFECTS["mass_unbalance"](pinion=1e-3)
    try:
        (seen,) = solve_with(model, (unit,), profile, condition).acceleration([1.0])
    except TwinError:
        return None
    if abs(seen) == 0:
        return None
    U = 1e-3 * abs(line[0]) / abs(seen)
    turned = line[0] * np.exp(-1j * phase / model.mesh.pair.teeth[0]) / seen
    return Turning(
        effect=EFFECTS["mass_unbalance"](pinion=float(min(U, 0.05)), pinion_heavy_point=float(np.angle(turned))),
        parameters={"pinion": (float(U), "kg·m", float(U * np.hypot(line[1] / abs(line[0]), MODELLED)))},
        log_evidence=_of_line(abs(line[0]), line[1]),
    )


def swung_by(
    model: Model,
    windows: Sequence[WindowFeatures],
    condition: Condition,
    effects: Sequence[Effect],
    phase: float,
    order: int,
) -> bool:
    """Whether effects of the teeth make the torque's line of an order of the pinion by themselves.

    windows  the first ones, unworn or nearly: the lines of teeth that differ grow with wear
    """
    seen = [w.torque.at(0, order, 0) for w in windows if w.torque is not None and w.torque.get(0, order, 0) is not None]
    if not seen:
        return False
    measured = complex(np.mean(seen)) * np.exp(-1j * order * phase / model.mesh.pair.teeth[0])
    try:
        (made,) = solve_with(model, effects, model.unworn, condition).torque([float(order)])
    except TwinError:
        return False
    return bool(abs(measured - made) < EXPLAINED * abs(measured))


def run_out_of(model: Model, condition: Condition, effect: Effect) -> complex:
    """What an unbalance makes of the transmission error at the pinion's own order, in the twin's angle [m]."""
    (made,) = solve_with(model, (effect,), model.unworn, condition).transmission_error([1.0])
    return complex(made)


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


def _of_line(size: float | np.ndarray, std: float | np.ndarray) -> float:
    """ln evidence of lines against noise alone [nat]; beyond a million nothing is told from anything."""
    return float(min(0.5 * np.sum((size / np.maximum(std, 1e-9)) ** 2), 1e6))


def _per_unit(model: Model, condition: Condition, profile: WornProfile, order: int) -> float:
    """Torque meter's line per unit ripple of the load, linear; 0 where there is no steady state."""
    unit = EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=0.1, order=float(order))
    try:
        (seen,) = solve_with(model, (unit,), profile, condition).torque([float(order)])
    except TwinError:
        return 0.0
    return abs(seen) / 0.1
