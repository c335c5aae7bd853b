"""Do the teeth separate and strike? The torque swings as far as its mean, and noise fills the spectrum.

    |T̃| > p·T̄        T̃ the torque's strongest line at an order of the pinion, T̄ its mean

At p = 1 the torque changes its sign once a turn and the teeth must separate. Where blows raise the noise between the
orders, a smaller swing has separated them already. Without a torque meter, the transmission error sways by several
times what the load deflects, and never by the same amount, while the noise between the orders is high.

Source   rattle criterion: R. Singh, H. Xie, R. J. Comparin, J. Sound Vib. 131 (1989) 177–196;
         twin/effects/backlash_rattle.py
Holds    a load that swings with an order of the pinion
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects import EFFECTS
from twin.effects.kept import RESPONSES
from twin.errors import TwinError
from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.context import TracingContext
from twin.tracing.findings import Findings, ShaftForce
from twin.tracing.scatter import MODELLED
from twin.tracing.shaft_lines import evidence_of_line, lines_of

TUNED = "tuned on D00–D13 and T01–T58; not derived"


@dataclass(frozen=True, slots=True, kw_only=True)
class RattleThresholds:
    """When teeth are taken to separate."""

    parting_share: float = deciding(
        0.6,
        of="mean torque",
        meaning="swing of the torque from which the teeth separate",
        source="derivation: at 1 the torque changes its sign; the margin for what the meter's path takes away is "
        "tuned on D00–D13 and T01–T58",
    )
    parting_share_of_blows: float = deciding(
        0.06, of="mean torque", meaning="the same where blows raise the noise between the orders", source=TUNED
    )
    noise_share: float = deciding(
        0.3,
        of="level",
        meaning="share of the level between the orders from which teeth strike",
        source=TUNED,
    )
    windows_share: float = deciding(
        0.5, of="windows", meaning="share of the windows that must be so noisy", source="not derived: the majority"
    )
    sway: float = deciding(
        7.41,
        of="static mesh deflection",
        meaning="line of the transmission error of teeth that separate, where no torque meter shows the swing",
        source="15 µm on the reference rig; " + TUNED,
    )
    unsteadiness: float = deciding(
        0.012,
        of="that line",
        meaning="scatter of that line from window to window; the run-out of an eccentricity keeps its size",
        source=TUNED,
    )
    least_windows: int = deciding(3, meaning="windows that show that line", source="not derived: chosen")
    largest_swing: float = deciding(
        4.5,
        of="rated torque",
        meaning="swing of the load that the model is given at most",
        source="not derived: chosen so that a resonance of the torque meter's path gives no absurd load",
    )


THRESHOLDS = RattleThresholds()
ORDERS = range(1, 11)  # of the pinion


def detect(context: TracingContext, limits: RattleThresholds = THRESHOLDS) -> Findings:
    """The findings with rattle where the teeth separate; nothing else can then be sought."""
    if "backlash_rattle" in context.rejected:
        return context.findings
    conditions = [w.condition for w in context.fitting]
    found = find_rattle(context.model, context.features, conditions, context.scales, limits)
    if found is None:
        return context.findings
    return replace(context.findings.adding(found.attributed()), teeth_separate=True)


def find_rattle(
    model: Model,
    windows: Sequence[WindowFeatures],
    conditions: Sequence[Condition],
    scales: Scales,
    limits: RattleThresholds = THRESHOLDS,
) -> ShaftForce | None:
    """The swing of the load that separates the teeth; None where none is large enough.

    windows     measurement windows (n,)
    conditions  of each window (n,)
    """
    swings = {p: seen for p in ORDERS if (seen := lines_of(windows, "torque", (0, p, 0)))}
    if not swings:
        return _without_torque_meter(windows, conditions, scales, limits)
    order = max(swings, key=lambda p: float(np.median([abs(y) for _, y, _ in swings[p]])))
    shares = [abs(y) / conditions[i].torque for i, y, _ in swings[order]]
    least = limits.parting_share_of_blows if strikes(windows, limits) else limits.parting_share
    if float(np.median(shares)) <= least:
        return None
    strongest = [(abs(y), std) for _, y, std in swings[order]]
    swing, condition = max(size for size, _ in strongest), conditions[0]
    sizes, stds = np.array(strongest).T
    at_brake = _meter_per_load(model, condition, order, scales)
    size = float(min(swing / at_brake, limits.largest_swing * scales.torque)) if at_brake else float(swing)
    return ShaftForce(
        effect=EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=size, order=float(order)),
        parameters={
            "load_ripple": (size, "N·m", float(size * np.hypot(np.std(sizes) / swing, MODELLED))),
            "order": (float(order), "", 0.0),
        },
        log_evidence=evidence_of_line(sizes, stds),
        order=float(order),
    )


def strikes(windows: Sequence[WindowFeatures], limits: RattleThresholds = THRESHOLDS) -> bool:
    """Whether noise between the orders says that the teeth strike, in most of the windows."""
    noisy = [(w.noise_rms or 0.0) > limits.noise_share * w.rms for w in windows if w.rms]
    return bool(noisy) and float(np.mean(noisy)) > limits.windows_share


def _without_torque_meter(
    windows: Sequence[WindowFeatures], conditions: Sequence[Condition], scales: Scales, limits: RattleThresholds
) -> ShaftForce | None:
    """Rattle by the transmission error's unsteady sway, while the teeth strike."""
    if not strikes(windows, limits):
        return None
    sways = {p: np.array([abs(y) for _, y, _ in lines_of(windows, "transmission_error", (0, p, 0))]) for p in ORDERS}
    sways = {p: sizes for p, sizes in sways.items() if sizes.size >= limits.least_windows}
    if not sways:
        return None
    order, sizes = max(sways.items(), key=lambda item: float(np.median(item[1])))
    size = float(np.median(sizes))
    scatter = 1.4826 * float(np.median(np.abs(sizes - size)))  # standard deviation of a normal scatter
    if size < limits.sway * scales.deflection or scatter < limits.unsteadiness * size:
        return None
    swing = min(limits.parting_share * conditions[0].torque, limits.largest_swing * scales.torque)
    return ShaftForce(
        effect=EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=swing, order=float(order)),
        parameters={"order": (float(order), "", 0.0)},
        log_evidence=float(0.5 * sizes.size * (scatter / (limits.unsteadiness * size)) ** 2),
        order=float(order),
    )


def _meter_per_load(model: Model, condition: Condition, order: int, scales: Scales) -> float:
    """Torque meter's line per unit ripple of the load, linear; 0 where there is no steady state."""
    ripple = 0.01 * scales.torque  # small: the response is linear
    unit = EFFECTS["backlash_rattle"](extra_backlash=0.0, load_ripple=ripple, order=float(order))
    try:
        (seen,) = RESPONSES.get(model, (unit,), model.unworn, condition).torque([float(order)])
    except TwinError:
        return 0.0
    return abs(seen) / ripple
