"""Shaft-synchronous forces: does the drive's torque pulsate, is the pinion unbalanced?

The torque meter shows a ripple of the drive directly, at one order that stands out; the accelerometer shows an
unbalance at the pinion's own order, where the mesh has nothing. Both keep size and phase as a multiple of the modelled
response from window to window, and do not grow with wear (twin/tracing/shaft_lines.py).

Teeth and eccentricities make lines at the same orders. What is found is therefore suspected until the detectors of
teeth and eccentricity have run; `confirm` then reports what they leave.

Source   twin/effects/torque_ripple.py, mass_unbalance.py
Holds    forces that turn with the pinion
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects import EFFECTS
from twin.effects.response import Effect, solve_with
from twin.errors import TwinError
from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.context import TracingContext
from twin.tracing.findings import Findings, ShaftForce
from twin.tracing.scatter import MODELLED
from twin.tracing.shaft_lines import Seen, evidence_of_line, lines_of, rms, std_of_mean, steady_line, unit_responses

TUNED = "tuned on D00–D13 and T01–T58; not derived"


@dataclass(frozen=True, slots=True, kw_only=True)
class ShaftForceThresholds:
    """When a line is a force that turns with the shaft."""

    least_torque: float = deciding(
        1.0, of="torque noise floor", meaning="line of the torque meter that may be a ripple", source=TUNED
    )
    torque_deviations: float = deciding(
        6.0, of="standard deviation of the mean line", meaning="the same, against the line's noise", source=TUNED
    )
    least_acceleration: float = deciding(
        1.0, of="acceleration noise floor", meaning="acceleration line that may be an unbalance", source=TUNED
    )
    acceleration_deviations: float = deciding(
        5.0, of="standard deviation of the mean line", meaning="the same, against the line's noise", source=TUNED
    )
    least_windows: int = deciding(3, meaning="windows that show the line", source="not derived: chosen")
    same_speed: float = deciding(
        0.02,
        meaning="difference of ln speed (and a fifth of that of ln torque) within which windows share a response",
        source="not derived: chosen",
    )
    steadiness: float = deciding(
        0.85, meaning="|mean| over mean |multiple| of a line that keeps its phase", source=TUNED
    )
    size_scatter: float = deciding(
        0.3,
        meaning="standard deviation of |multiple| over its mean: no growth with wear",
        source=TUNED,
    )
    dominance: float = deciding(
        3.0,
        meaning="a ripple's line over the next strongest: teeth that differ have lines at many orders",
        source=TUNED,
    )
    explained_share: float = deciding(
        0.5, of="line", meaning="what may be left of a line that tooth errors explain", source=TUNED
    )
    least_torque_std: float = deciding(
        0.2, of="torque noise floor", meaning="noise that a ripple's line has at least", source="not derived: chosen"
    )
    largest_unbalance_force: float = deciding(
        0.352,
        of="rated mesh force",
        meaning="centrifugal force at the rated speed of the largest unbalance that the model is given",
        source="0.05 kg·m on the reference rig, the bound of the effect's parameter; not derived",
    )


THRESHOLDS = ShaftForceThresholds()
ORDERS = range(1, 11)  # of the pinion
UNIT_UNBALANCE = 1e-3  # at which the linear response is taken [kg·m]


def detect(context: TracingContext, limits: ShaftForceThresholds = THRESHOLDS) -> Findings:
    """The findings with the forces that are suspected; effects come of them in `confirm`."""
    conditions = [w.condition for w in context.fitting]
    forces = find_shaft_forces(context.model, context.features, conditions, context.mesh_phase, context.scales, limits)
    return replace(context.findings, forces=tuple(forces))


def confirm(context: TracingContext) -> Findings:
    """The findings with those suspected forces as effects that neither teeth nor an eccentricity explain."""
    findings = context.findings
    confirmed = []
    for force in findings.forces:
        if force.name == "mass_unbalance" and findings.tooth_errors:
            continue
        if force.name == "torque_ripple" and force.parameters["order"][0] in findings.run_out_orders:
            continue
        confirmed.append(force.attributed())
    return findings.adding(*confirmed, rejected=context.rejected)


def find_shaft_forces(
    model: Model,
    windows: Sequence[WindowFeatures],
    conditions: Sequence[Condition],
    phase: float,
    scales: Scales,
    limits: ShaftForceThresholds = THRESHOLDS,
) -> list[ShaftForce]:
    """Torque ripple and unbalance, from measurement windows (n,) and their conditions (n,)."""
    unbalance = _unbalance(model, windows, conditions, phase, scales, limits)
    taken = set() if unbalance is None else {1}
    ripple = _ripple(model, windows, conditions, phase, taken, scales, limits)
    return [found for found in (ripple, unbalance) if found is not None]


def tooth_errors_explain(
    model: Model,
    windows: Sequence[WindowFeatures],
    condition: Condition,
    effects: Sequence[Effect],
    phase: float,
    order: int,
    limits: ShaftForceThresholds = THRESHOLDS,
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
    return bool(abs(measured - made) < limits.explained_share * abs(measured))


def run_out_of(model: Model, condition: Condition, effect: Effect) -> complex:
    """What an unbalance makes of the transmission error at the pinion's own order, in the model's angle [m]."""
    (made,) = solve_with(model, (effect,), model.unworn, condition).transmission_error([1.0])
    return complex(made)


def _stands_out(seen: Sequence[Seen], least: float, deviations: float, least_windows: int) -> bool:
    """Whether lines exceed a floor and their noise, whatever their phases."""
    return len(seen) >= least_windows and rms(seen) > max(least, deviations * std_of_mean(seen))


def _ripple(
    model: Model,
    windows: Sequence[WindowFeatures],
    conditions: Sequence[Condition],
    phase: float,
    taken: Collection[int],
    scales: Scales,
    limits: ShaftForceThresholds,
) -> ShaftForce | None:
    """The one order of the torque that stands out and keeps its phase; teeth that differ have lines at all orders."""
    least = limits.least_torque * scales.torque_noise
    swings = []
    for p in ORDERS:
        seen = lines_of(windows, "torque", (0, p, 0))
        if _stands_out(seen, least, limits.torque_deviations, limits.least_windows):
            swings.append((rms(seen), p, seen))
    if not swings:
        return None
    size, p, seen = max(swings, key=lambda s: s[0])
    next_largest = max((s for s, q, _ in swings if q != p), default=0.0)
    if p in taken or size < limits.dominance * next_largest:
        return None
    unit = 0.01 * scales.torque  # small: the response is linear
    ripple = EFFECTS["torque_ripple"](amplitude=unit, order=float(p))
    units = unit_responses(model, conditions, ripple, "torque", p, phase, limits.same_speed)
    line = None if units is None else steady_line(seen, units, limits.steadiness, limits.size_scatter)
    if line is None:
        return None
    amplitude = unit * abs(line.multiple)
    least_std = limits.least_torque_std * scales.torque_noise
    return ShaftForce(
        effect=EFFECTS["torque_ripple"](
            amplitude=float(amplitude), order=float(p), phase=float(np.angle(line.multiple))
        ),
        parameters={
            "amplitude": (float(amplitude), "N·m", float(np.hypot(unit * line.std, MODELLED * amplitude))),
            "order": (float(p), "", 0.0),
        },
        log_evidence=evidence_of_line(line.size, max(line.line_std, least_std)),
    )


def _unbalance(
    model: Model,
    windows: Sequence[WindowFeatures],
    conditions: Sequence[Condition],
    phase: float,
    scales: Scales,
    limits: ShaftForceThresholds,
) -> ShaftForce | None:
    """What shakes the housing once a turn of the pinion, always at the same angle, as the square of the speed."""
    seen = lines_of(windows, "acceleration", (0, 1, 0))
    least = limits.least_acceleration * scales.acceleration
    if not _stands_out(seen, least, limits.acceleration_deviations, limits.least_windows):
        return None
    unit = EFFECTS["mass_unbalance"](pinion=UNIT_UNBALANCE)
    units = unit_responses(model, conditions, unit, "acceleration", 1.0, phase, limits.same_speed)
    line = None if units is None else steady_line(seen, units, limits.steadiness, limits.size_scatter)
    if line is None:
        return None
    U = float(UNIT_UNBALANCE * abs(line.multiple))
    most = limits.largest_unbalance_force * scales.force / (2 * np.pi * scales.speed) ** 2
    return ShaftForce(
        effect=EFFECTS["mass_unbalance"](pinion=min(U, float(most)), pinion_heavy_point=float(np.angle(line.multiple))),
        parameters={"pinion": (U, "kg·m", float(np.hypot(UNIT_UNBALANCE * line.std, MODELLED * U)))},
        log_evidence=evidence_of_line(line.size, line.line_std),
    )
