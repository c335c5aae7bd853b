"""What evidence healthy machines of a rig give to effects that they do not have.

Machines are drawn within the tolerances of the rig file (machines.py), their windows are simulated and traced with
thresholds lowered by some nats.

What thresholds follow from them: twin/required_evidence.py.

Limits   what machines of the rig file's own structure do; a machine of another structure may do more
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp

import numpy as np

from twin.detectability.machines import HealthyMachine, drawn
from twin.detectability.windows import Campaign, simulated
from twin.effects.response import Effect
from twin.errors import NotAvailable, NotConverged
from twin.features.extract import WindowSignals, extract
from twin.features.non_gear import non_gear_features
from twin.options import Options
from twin.required_evidence import DEFAULT, STATED, NullEvidence, RequiredEvidence
from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.trace import trace
from twin.updating.history import WindowInput, replay_history
from twin.windows import Window


@dataclass(frozen=True, slots=True, kw_only=True)
class NullThresholds:
    """How healthy machines are traced."""

    lowered: float = deciding(
        4.0,
        unit="nat",
        meaning="how far thresholds are lowered, so that the tail of the evidence is seen",
        source="not derived: a lower threshold gives more campaigns with an effect, and a tail less like the end's",
    )


THRESHOLDS = NullThresholds()
LOOSE = RequiredEvidence(rate=STATED.rate * exp(THRESHOLDS.lowered))


def traced(rig: Rig, windows: Sequence[Window], required: RequiredEvidence = DEFAULT) -> tuple[AttributedEffect, ...]:
    """The effects that one trace of all windows finds; NotAvailable, NotConverged."""
    history = []
    for index, window in enumerate(windows):
        signals = WindowSignals(rig, window)
        features = extract(rig, window, signals)
        beside = non_gear_features(rig, window, signals=signals)
        history.append(WindowInput(index=index, features=features, non_gear=beside))
    memory, outcomes = replay_history(rig, (), history, Options().updating(rig))
    depths = {
        window.index: outcome.depth
        for window, outcome in zip(history, outcomes, strict=True)
        if outcome is not None and outcome.kind == "measurement"
    }
    if not depths:
        raise NotAvailable("no simulated window could update the twin")
    return trace(rig, history, depths, memory.phase, required=required).found


def one_campaign(
    rig: Rig,
    campaign: Campaign,
    seed: int,
    effects: Sequence[Effect] = (),
    required: RequiredEvidence = LOOSE,
) -> tuple[AttributedEffect, ...] | None:
    """What is found of one machine drawn by its seed, with effects or without; None without a steady state."""
    rng = np.random.default_rng([2019, seed])
    machine: HealthyMachine = drawn(rig, rng)
    try:
        return traced(rig, simulated(machine, campaign, rng, effects), required)
    except (NotAvailable, NotConverged):
        return None


def null_evidence(found: Sequence[tuple[AttributedEffect, ...]]) -> NullEvidence:
    """The evidence of what was found in each of several healthy machines."""
    by_effect: dict[str, list[float]] = {}
    for effects in found:
        for effect in effects:
            by_effect.setdefault(effect.name, []).append(float(effect.log_evidence))
    falling = {name: tuple(sorted(values, reverse=True)) for name, values in sorted(by_effect.items())}
    return NullEvidence(campaigns=len(found), found=falling)
