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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twin.effects import EFFECTS
from twin.effects.facts import ShaftLine
from twin.effects.kept import RESPONSES
from twin.effects.response import Effect
from twin.errors import TwinError
from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.context import TracingContext
from twin.tracing.findings import Findings, ShaftForce
from twin.tracing.scatter import MODELLED
from twin.tracing.shaft_lines import Seen, evidence_of_line, lines_of, rms, std_of_mean, steady_line, unit_responses
from twin.tracing.shaft_remainder import one_order_only
from twin.wear.profile import WornProfile

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
        0.5,
        of="line, or what tooth errors make of it",
        meaning="what may be left of a line that tooth errors explain",
        source=TUNED
        + "; the larger of both, and over the first windows together: on the wide evaluation's first draw, "
        "pitch errors that are fitted without a misalignment make a line that is too large and 30° off on new flanks",
    )
    run_out: float = deciding(
        4.0,
        of="once-per-turn error of the disc",
        meaning="line of the transmission error at the pinion's own order from which it is a run-out: what the torque "
        "shows at that order is not compared with a ripple",
        source="as for eccentricities: a poor disc's own reaches 2.7 times",
    )
    least_torque_std: float = deciding(
        0.2, of="torque noise floor", meaning="noise that a ripple's line has at least", source="not derived: chosen"
    )

    def of_channel(self, channel: str, scales: Scales) -> _Floor:
        """What a line of a channel must exceed."""
        if channel == "torque":
            least, std = self.least_torque * scales.torque_noise, self.least_torque_std * scales.torque_noise
            return _Floor(least=least, deviations=self.torque_deviations, std=std)
        least = self.least_acceleration * scales.acceleration
        return _Floor(least=least, deviations=self.acceleration_deviations, std=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Floor:
    """What a line must exceed, and the noise that it has at least, in the channel's unit."""

    least: float
    deviations: float
    std: float


THRESHOLDS = ShaftForceThresholds()
ORDERS = range(1, 11)  # of the pinion, where the order is free


def detect(context: TracingContext, limits: ShaftForceThresholds = THRESHOLDS) -> Findings:
    """The findings with the forces that are suspected; effects come of them in `confirm`."""
    conditions = [w.condition for w in context.fitting]
    forces = find_shaft_forces(context.model, context.features, conditions, context.mesh_phase, context.scales, limits)
    return replace(context.findings, forces=tuple(forces))


def confirm(context: TracingContext) -> Findings:
    """The findings with those suspected forces as effects that neither teeth nor an eccentricity explain.

    Nor where the housing moves at other orders, too: then the line is one of a force with harmonics, which is neither.
    """
    findings = context.findings
    confirmed = []
    lines = context.shaft_lines if findings.forces else ()
    orders = {round(force.order) for force in findings.forces}
    beside = findings.forces_beside_teeth(lines)
    for force in findings.forces:
        if force.channel == "acceleration" and force not in beside:
            continue
        if force.channel == "torque" and force.order in findings.run_out_orders:
            continue
        if not one_order_only(lines, round(force.order), orders - {round(force.order)}):
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
    """The forces that effects of this detector declare, from measurement windows (n,) and their conditions (n,).

    A run-out of the pinion makes a line of the torque, too: where no force makes the run-out, that line is left to the
    eccentricity. Those of a free order come first. Of two forces at one order, each suspected by a channel of its own,
    the one stays that leaves less of the other's line: a ripple shakes the housing, and an unbalance swings the torque.
    """
    search = _Search(model, windows, conditions, phase, scales, limits)
    kinds = [kind for kind in EFFECTS.values() if kind.facts.shaft_line is not None]
    own = [f for kind in kinds if not kind.facts.shaft_line.order and (f := search.at_own_order(kind)) is not None]
    free = [f for kind in kinds if kind.facts.shaft_line.order and (f := search.at_any_order(kind)) is not None]
    for rival in list(free):
        same = [g for g in own if g.order == rival.order]
        if any(search.left_of(rival, g.channel) >= search.left_of(g, rival.channel) for g in same):
            free.remove(rival)
        else:
            own = [g for g in own if g not in same]
    return [*free, *own]


def tooth_errors_explain(
    model: Model,
    windows: Sequence[WindowFeatures],
    worn: Sequence[tuple[Condition, WornProfile]],
    effects: Sequence[Effect],
    phase: float,
    order: int,
    limits: ShaftForceThresholds = THRESHOLDS,
) -> bool:
    """Whether effects of the teeth make the torque's line of an order of the pinion by themselves.

    windows  the first ones (n,): the lines of teeth that differ grow with wear
    worn     their conditions and flanks (n,)
    """
    seen, made = [], []
    for window, (condition, profile) in zip(windows, worn, strict=True):
        line = None if window.torque is None else window.torque.get(0, order, 0)
        if line is None:
            continue
        try:
            (line_made,) = RESPONSES.get(model, effects, profile, condition).torque([float(order)])
        except TwinError:
            return False
        seen.append(line * np.exp(-1j * order * phase / model.mesh.pair.teeth[0]))
        made.append(line_made)
    if not seen:
        return False
    sizes = [float(np.linalg.norm(lines)) for lines in (np.subtract(seen, made), seen, made)]
    return sizes[0] < limits.explained_share * max(sizes[1:])


def run_out_of(model: Model, condition: Condition, effect: Effect, order: float = 1.0) -> complex:
    """What a force makes of the transmission error at the order of its shaft, in the model's angle [m]."""
    (made,) = RESPONSES.get(model, (effect,), model.unworn, condition).transmission_error([order])
    return complex(made)


class _Search:
    """The windows of one machine, searched for lines that a shaft drives."""

    def __init__(
        self,
        model: Model,
        windows: Sequence[WindowFeatures],
        conditions: Sequence[Condition],
        phase: float,
        scales: Scales,
        limits: ShaftForceThresholds,
    ) -> None:
        self.model, self.windows, self.conditions = model, windows, conditions
        self.phase, self.scales, self.limits = phase, scales, limits

    def at_own_order(self, kind: Any) -> ShaftForce | None:
        """A force at the own order of its shaft."""
        line: ShaftLine = kind.facts.shaft_line
        z1, z2 = self.model.mesh.pair.teeth
        key, order = ((0, 1, 0), 1.0) if line.shaft == "pinion" else ((0, 0, 1), z1 / z2)
        seen = lines_of(self.windows, line.channel, key)
        return self._driven(kind, seen, order) if self._stands_out(seen, line.channel) else None

    def at_any_order(self, kind: Any) -> ShaftForce | None:
        """A force at the one order of the pinion that stands out; teeth that differ have lines at all orders."""
        channel = kind.facts.shaft_line.channel
        found = [(p, lines_of(self.windows, channel, (0, p, 0))) for p in ORDERS if p > 1 or not self._runs_out(kind)]
        swings = [(rms(seen), p, seen) for p, seen in found if self._stands_out(seen, channel)]
        if not swings:
            return None
        size, p, seen = max(swings, key=lambda s: s[0])
        next_largest = max((s for s, q, _ in swings if q != p), default=0.0)
        if size < self.limits.dominance * next_largest:
            return None
        return self._driven(kind, seen, float(p))

    def _runs_out(self, kind: Any) -> bool:
        """Whether the pinion has a run-out that a force at its own order does not make."""
        seen = lines_of(self.windows, "transmission_error", (0, 1, 0))
        if not seen or rms(seen) < self.limits.run_out * self.scales.once_per_turn[0]:
            return False
        force = self._driven(kind, lines_of(self.windows, kind.facts.shaft_line.channel, (0, 1, 0)), 1.0)
        return force is None or self.left_of(force, "transmission_error") > self.limits.explained_share

    def left_of(self, force: ShaftForce, channel: str) -> float:
        """What a force leaves of a channel's line at its order, relative to that line; 1 where it cannot be said."""
        key = (0, int(force.order), 0) if float(force.order).is_integer() else (0, 0, 1)
        seen = lines_of(self.windows, channel, key)
        made = unit_responses(
            self.model, self.conditions, force.effect, channel, force.order, self.phase, self.limits.same_speed
        )
        if made is None or not seen:
            return 1.0
        left = [abs(y - made[i]) ** 2 for i, y, _ in seen]
        return float(np.sqrt(np.mean(left)) / rms(seen))

    def _stands_out(self, seen: Sequence[Seen], channel: str) -> bool:
        """Whether lines exceed a floor and their noise, whatever their phases."""
        if len(seen) < self.limits.least_windows:
            return False
        floor = self.limits.of_channel(channel, self.scales)
        return rms(seen) > max(floor.least, floor.deviations * std_of_mean(seen))

    def _driven(self, kind: Any, seen: Sequence[Seen], order: float) -> ShaftForce | None:
        """The force whose line keeps size and phase as a multiple of the modelled response; None where it does not."""
        line: ShaftLine = kind.facts.shaft_line
        limits, scales = self.limits, self.scales
        unit = line.unit * (scales[line.unit_of] if line.unit_of else 1.0)
        at = {line.order: order} if line.order else {}
        effect = kind(**{line.size: unit}, **at)
        units = unit_responses(self.model, self.conditions, effect, line.channel, order, self.phase, limits.same_speed)
        steady = None if units is None else steady_line(seen, units, limits.steadiness, limits.size_scatter)
        if steady is None:
            return None
        size = float(unit * abs(steady.multiple))
        given = min(size, scales.sized(kind.facts.detection, "largest_size"))
        std = float(np.hypot(unit * steady.std, MODELLED * size))
        parameter = next(p for p in kind.parameters if p.name == line.size)
        floor = limits.of_channel(line.channel, scales)
        return ShaftForce(
            effect=kind(**{line.size: given, line.phase: float(np.angle(steady.multiple))}, **at),
            parameters={line.size: (size, parameter.unit, std)} | {name: (o, "", 0.0) for name, o in at.items()},
            log_evidence=evidence_of_line(steady.size, max(steady.line_std, floor.std)),
            channel=line.channel,
            order=order,
        )
