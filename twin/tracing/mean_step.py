"""A step of the mean transmission error: has a shaft shifted, or a disc?

    m_w = ē_w − ē(depth, torque, speed)         s = mean of m after a time less that before it

ē_w  mean of the transmission error in a window; what follows it is that of the twin with wear alone     [m]

Edges are counted absolutely and both encoders sit on free ends, so that m stays the same to a fraction of a micrometre
while a machine only wears. A pinion that drops in a bearing with play or in a seat that has come loose, and a disc that
turns on its shaft, move it at one time and for good. An encoder that warms up drifts, which is no step.

Source   definition of the transmission error; t-statistic of two means
Holds    both encoders, windows on one mounting of the discs, no other effect in the twin (a misalignment moves it too)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.effects.kept import RESPONSES
from twin.errors import TwinError
from twin.thresholds import deciding
from twin.tracing.context import TracingContext


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanStepThresholds:
    """When the mean has stepped."""

    least: float = deciding(
        1.0,
        of="pinion once-per-turn error",
        meaning="size of a step",
        source="tuned on wide draw 1: 1.5 µm on the reference rig; healthy machines move by up to 0.7 µm, or drift",
    )
    largest: float = deciding(
        0.02, of="base pitch", meaning="size above which a step is one of the counted edges", source="118 µm; chosen"
    )
    over_scatter: float = deciding(
        6.0,
        of="range of the mean before or after",
        meaning="size of a step",
        source="derivation: an encoder that settles moves by a half or more of its first move after it",
    )
    least_windows: int = deciding(2, meaning="windows before and after", source="not derived: one value has no scatter")


THRESHOLDS = MeanStepThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanStep:
    """A step of the mean transmission error."""

    size: float  # [m]
    std: float  # [m]
    before: float  # revolutions of the last window before it
    after: float  # of the first after it

    @property
    def onset(self) -> float:
        """Revolutions half-way between."""
        return 0.5 * (self.before + self.after)


def mean_step(context: TracingContext, limits: MeanStepThresholds = THRESHOLDS) -> MeanStep | None:
    """The step in the windows of one mounting; None where there is none, or it cannot be told."""
    if context.phase is None:
        return None
    turns, means = [], []
    for w in context.mounted:
        error = w.features.transmission_error
        if w.index not in context.measurement or error is None or error.unit != "m" or error.get(0) is None:
            continue
        try:
            made = RESPONSES.get(context.model, (), context.profiles[w.index], w.condition)
        except TwinError:
            continue
        if made.converged:
            turns.append(w.features.revolutions or 0.0)
            means.append(error.at(0).real - made.mean_transmission_error)
    scales = context.scales
    return _largest(np.array(turns), np.array(means), scales.once_per_turn[0], scales.base_pitch, limits)


def _largest(
    turns: np.ndarray, means: np.ndarray, once_per_turn: float, pitch: float, limits: MeanStepThresholds
) -> MeanStep | None:
    """The largest step that stands clear of what the means before and after it scatter by."""
    best = None
    for k in range(limits.least_windows, turns.size - limits.least_windows + 1):
        first, second = means[:k], means[k:]
        size = float(second.mean() - first.mean())
        scatter = max(float(np.ptp(first)), float(np.ptp(second)))
        clear = max(limits.least * once_per_turn, limits.over_scatter * scatter) <= abs(size) <= limits.largest * pitch
        if clear and (best is None or abs(size) > abs(best.size)):
            std = float(np.hypot(first.std() / np.sqrt(first.size), second.std() / np.sqrt(second.size)))
            best = MeanStep(size=size, std=std, before=float(turns[k - 1]), after=float(turns[k]))
    return best
