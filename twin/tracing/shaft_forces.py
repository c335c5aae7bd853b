"""What turns with a shaft and pushes: unbalance, torque ripple, and the rattle of teeth that part.

    a = Σ_w conj(u_w)·y_w / Σ_w |u_w|²

y_w  line of window w, at absolute angle
u_w  what a unit of the effect makes of it under the window's own speed and torque, by the twin

A line that keeps its size and its phase, as a multiple of u_w, from window to window is driven by the shaft. The torque
meter shows a ripple of the drive directly; the accelerometer shows an unbalance at the shaft's own order, where the
mesh has nothing. Where the torque swings as far as its mean and noise fills the spectrum, the teeth part: rattle.

Source   twin/effects/torque_ripple.py, mass_unbalance.py, backlash_rattle.py
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects import EFFECTS
from twin.effects.response import Effect, solve_with
from twin.errors import TwinError
from twin.features.window_features import Key, MeasuredLines, WindowFeatures
from twin.model import Condition, Model
from twin.tracing.scatter import MODELLED

LEAST_TORQUE = 0.005  # of a line of the torque meter that keeps its phase [N·m]
LEAST_ACCELERATION = 0.002  # at the pinion's own order [m/s²]
LEAST_WINDOWS = 3
UNIT = 0.1  # of a ripple [N·m]
ALIKE = 0.02  # of the speed's logarithm; five times that of the torque's: windows that share a response
STEADY = 0.85  # |mean| over mean of absolute values
STEADY_SIZE = 0.3  # std of absolute values over their mean: what drives a line does not grow with wear
ORDERS = range(1, 11)
DOMINANT = 3.0  # of a ripple's line over the next one: pitch errors and run-out make lines at many orders
EXPLAINED = 0.5  # of a line: what may be left where something else makes it
PARTING = 0.6  # of the mean torque: a swing that parts the teeth
NOISY = 0.3  # share of the level that lies between the orders, when teeth strike
SWAYING = 15e-6  # line of the transmission error of teeth that part [m]
UNSTEADY = 0.012  # scatter of that line from window to window, of its size: a run-out keeps its own


@dataclass(frozen=True, slots=True, kw_only=True)
class Turning:
    """One effect that turns with the pinion."""

    effect: Effect
    parameters: dict[str, tuple[float, str, float]]  # value, unit, std
    log_evidence: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Steady:
    """A line that keeps its size and phase over the windows, as multiples of the response to a unit."""

    multiple: complex
    std: float
    size: float  # of the line itself, rms over the windows
    line_std: float  # of the mean line


def _lines(windows: Sequence[WindowFeatures], name: str, key: Key) -> list[tuple[int, complex, float]]:
    """Window's number, line and its std, where it was read."""
    out = []
    for i, w in enumerate(windows):
        lines: MeasuredLines | None = getattr(w, name)
        if lines is not None and lines.get(*key) is not None:
            out.append((i, lines.at(*key), lines.std_at(*key)))
    return out


def _strong(seen: Sequence[tuple[int, complex, float]], least: float, deviations: float) -> bool:
    """Whether lines stand out of noise, whatever their phases."""
    if len(seen) < LEAST_WINDOWS:
        return False
    size = float(np.sqrt(np.mean([abs(y) ** 2 for _, y, _ in seen])))
    return size > least and size > deviations * _std_of_mean(seen)


def _std_of_mean(seen: Sequence[tuple[int, complex, float]]) -> float:
    return float(np.sqrt(np.mean([s**2 for _, _, s in seen]) / len(seen)))


def _steady(seen: Sequence[tuple[int, complex, float]], units: Sequence[complex]) -> _Steady | None:
    """Lines as multiples of what a unit makes of them in each window; None where they do not keep size and phase."""
    y = np.array([v for _, v, _ in seen])
    unit = np.array([units[i] for i, _, _ in seen])
    if not np.abs(unit).all():
        return None
    multiples, weight = y / unit, np.abs(unit) ** 2
    mean = complex(np.average(multiples, weights=weight))
    sizes = np.abs(multiples)
    size = float(np.average(sizes, weights=weight))
    scatter = float(np.sqrt(np.average((sizes - size) ** 2, weights=weight)))
    if abs(mean) < STEADY * size or scatter > STEADY_SIZE * size:
        return None
    line_std = _std_of_mean(seen)
    return _Steady(
        multiple=mean,
        std=float(line_std / np.sqrt(weight.mean())),
        size=float(np.sqrt(np.mean(np.abs(y) ** 2))),
        line_std=line_std,
    )


def _units(
    model: Model, conditions: Sequence[Condition], effect: Effect, channel: str, order: float, phase: float
) -> list[complex] | None:
    """What an effect makes of a line under each condition, in the encoder's angle; None without a steady state."""
    known: dict[tuple[int, int], complex] = {}
    out = []
    for condition in conditions:
        key = (round(np.log(condition.speed_hz) / ALIKE), round(np.log(condition.torque) / (5 * ALIKE)))
        if key not in known:
            try:
                (seen,) = getattr(solve_with(model, (effect,), model.unworn, condition), channel)([order])
            except TwinError:
                return None
            known[key] = complex(seen * np.exp(1j * order * phase / model.mesh.pair.teeth[0]))
        out.append(known[key])
    return out


def rattling(windows: Sequence[WindowFeatures]) -> bool:
    """Whether the teeth part and strike in most of the windows."""
    noisy = [(w.noise_rms or 0.0) > NOISY * w.rms for w in windows if w.rms]
    return bool(noisy) and float(np.mean(noisy)) > 0.5


def find_turning(
    model: Model,
    windows: Sequence[WindowFeatures],
    conditions: Sequence[Condition],
    phase: float,
) -> list[Turning]:
    """Rattle, or ripple and unbalance, from measurement windows and their conditions."""
    rattle = _rattle(model, windows, conditions)
    if rattle is not None:
        return [rattle]
    unbalance = _unbalance(model, windows, conditions, phase)
    ripple = _ripple(model, windows, conditions, phase, set() if unbalance is None else {1})
    return [found for found in (ripple, unbalance) if found is not None]


def _rattle(model: Model, windows: Sequence[WindowFeatures], conditions: Sequence[Condition]) -> Turning | None:
    """The swing of the load that parts the teeth; None where none is large enough.

    A swing of most of the mean parts them however regularly; where noise tells that they strike, less is enough.
    """
    swings = {p: seen for p in ORDERS if (seen := _lines(windows, "torque", (0, p, 0)))}
    if not swings:
        return _rattle_unmeasured(windows, conditions)
    order = max(swings, key=lambda p: float(np.median([abs(y) for _, y, _ in swings[p]])))
    shares = [abs(y) / conditions[i].torque for i, y, _ in swings[order]]
    if float(np.median(shares)) <= PARTING * (0.1 if rattling(windows) else 1.0):
        return None
    strongest = [(abs(y), std) for _, y, std in swings[order]]
    swing, condition = max(size for size, _ in strongest), conditions[0]
    sizes, stds = np.array(strongest).T
    at_brake = _per_unit(model, condition, order)
    size = float(min(swing / at_brake, 45.0)) if at_brake else float(swing)
    return Turning(
        effect=EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=size, order=float(order)),
        parameters={
            "load_ripple": (size, "N·m", float(size * np.hypot(np.std(sizes) / swing, MODELLED))),
            "order": (float(order), "", 0.0),
        },
        log_evidence=_of_line(sizes, stds),
    )


def _rattle_unmeasured(windows: Sequence[WindowFeatures], conditions: Sequence[Condition]) -> Turning | None:
    """Rattle where no torque meter tells the swing: teeth strike while the transmission error sways, never the same."""
    if not rattling(windows):
        return None
    sways = {p: np.array([abs(y) for _, y, _ in _lines(windows, "transmission_error", (0, p, 0))]) for p in ORDERS}
    sways = {p: sizes for p, sizes in sways.items() if sizes.size >= LEAST_WINDOWS}
    if not sways:
        return None
    order, sizes = max(sways.items(), key=lambda item: float(np.median(item[1])))
    size = float(np.median(sizes))
    scatter = 1.4826 * float(np.median(np.abs(sizes - size)))
    if size < SWAYING or scatter < UNSTEADY * size:
        return None
    swing = PARTING * conditions[0].torque
    return Turning(
        effect=EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=min(swing, 45.0), order=float(order)),
        parameters={"order": (float(order), "", 0.0)},
        log_evidence=float(0.5 * sizes.size * (scatter / (UNSTEADY * size)) ** 2),
    )


def _ripple(
    model: Model,
    windows: Sequence[WindowFeatures],
    conditions: Sequence[Condition],
    phase: float,
    taken: Collection[int],
) -> Turning | None:
    """The one order of the torque that stands out and keeps its phase; teeth that differ have lines at all orders."""
    swings = []
    for p in ORDERS:
        seen = _lines(windows, "torque", (0, p, 0))
        if _strong(seen, LEAST_TORQUE, 6.0):
            swings.append((float(np.sqrt(np.mean([abs(y) ** 2 for _, y, _ in seen]))), p, seen))
    if not swings:
        return None
    size, p, seen = max(swings, key=lambda s: s[0])
    rest = max((s for s, q, _ in swings if q != p), default=0.0)
    if p in taken or size < DOMINANT * rest:
        return None
    units = _units(model, conditions, EFFECTS["torque_ripple"](amplitude=UNIT, order=float(p)), "torque", p, phase)
    line = None if units is None else _steady(seen, units)
    if line is None:
        return None
    amplitude = UNIT * abs(line.multiple)
    return Turning(
        effect=EFFECTS["torque_ripple"](
            amplitude=float(amplitude), order=float(p), phase=float(np.angle(line.multiple))
        ),
        parameters={
            "amplitude": (float(amplitude), "N·m", float(np.hypot(UNIT * line.std, MODELLED * amplitude))),
            "order": (float(p), "", 0.0),
        },
        log_evidence=_of_line(line.size, max(line.line_std, 1e-3)),
    )


def _unbalance(
    model: Model, windows: Sequence[WindowFeatures], conditions: Sequence[Condition], phase: float
) -> Turning | None:
    """What shakes the housing once a turn of the pinion, always at the same angle, as the square of the speed."""
    seen = _lines(windows, "acceleration", (0, 1, 0))
    if not _strong(seen, LEAST_ACCELERATION, 5.0):
        return None
    units = _units(model, conditions, EFFECTS["mass_unbalance"](pinion=1e-3), "acceleration", 1.0, phase)
    line = None if units is None else _steady(seen, units)
    if line is None:
        return None
    U = float(1e-3 * abs(line.multiple))
    heavy = float(np.angle(line.multiple))
    return Turning(
        effect=EFFECTS["mass_unbalance"](pinion=min(U, 0.05), pinion_heavy_point=heavy),
        parameters={"pinion": (U, "kg·m", float(np.hypot(1e-3 * line.std, MODELLED * U)))},
        log_evidence=_of_line(line.size, line.line_std),
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


def _per_unit(model: Model, condition: Condition, order: int) -> float:
    """Torque meter's line per unit ripple of the load, linear; 0 where there is no steady state."""
    unit = EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=0.1, order=float(order))
    try:
        (seen,) = solve_with(model, (unit,), model.unworn, condition).torque([float(order)])
    except TwinError:
        return 0.0
    return abs(seen) / 0.1
