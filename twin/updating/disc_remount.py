"""Encoder discs that have moved since the last window.

A lost count, a re-mounted disc or a creeping shaft shifts the mean of the transmission error (one edge of a thousand is
a hundred micrometres) and, on the pinion, turns all mesh lines by a phase. Both are remembered from earlier windows;
where they contradict what the mesh lines say of the depth, the lines are believed and the memory starts anew.

    2·J − 2·J without it > 25           five standard deviations, with one unknown more
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.thresholds import deciding
from twin.updating import encoders
from twin.updating.depth import DepthEstimate, Gauge, explained_at, freedom
from twin.updating.memory import Memory
from twin.updating.prediction import Expectation


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscRemount:
    """When the remembered offset or phase is given up because a disc has moved."""

    chi_square: float = deciding(
        25.0,
        meaning="fall of 2·J by one unknown more, from which the remembered value is given up",
        source="derivation: five standard deviations of one unknown",
    )
    least_turn: float = deciding(
        0.05,
        unit="rad",
        meaning="turn of the mesh phase below which no disc has moved",
        source="derivation: half an edge of a disc of 1024, with 19 teeth, is 0.06",
    )
    worn_enough: float = deciding(
        5e-6,
        unit="m",
        meaning="depth from which the mesh lines know their own phase",
        source="not derived: the lines of mesh harmonics are then well above the unworn floor",
    )


REMOUNT = DiscRemount()

Found = tuple[Expectation, DepthEstimate]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SettledDepth:
    """A depth, and the memory without what the depth contradicts."""

    memory: Memory
    gauge: Gauge
    expectation: Expectation
    estimate: DepthEstimate
    notes: tuple[str, ...]


def settled(
    memory: Memory,
    features: WindowFeatures,
    model: Model,
    condition: Condition,
    search: Callable[[Gauge], Found],
) -> SettledDepth | None:
    """The depth that the window's encoders show; None where there are none."""
    gauge = encoders.gauge_of(features, memory, model, condition)
    if gauge is None:
        return None
    notes: list[str] = []
    expectation, estimate = search(gauge)
    if gauge.mean is not None and estimate.by_mean > REMOUNT.chi_square:
        mean, gauge, memory = gauge.mean, replace(gauge, mean=None), replace(memory, offset=None)
        expectation, estimate = search(gauge)
        off = mean - expectation.lines(estimate.depth).mean
        notes.append(
            f"the mean of the transmission error is {off * 1e6:+.0f} µm off what its mesh lines say: a lost count, "
            "a moved disc, or an effect that the twin lacks; not used"
        )
    if gauge.phase is not None and estimate.misfit * freedom(gauge) > REMOUNT.chi_square:
        anew = replace(memory, phase=None, phase_std=Memory().phase_std, discs_since_ns=features.start_time_ns)
        freed = encoders.gauge_of(features, anew, model, condition) or gauge
        response = expectation.response(freed.pinion_only, freed.from_unworn)
        cost, phase = explained_at(estimate.depth, freed, response)  # a phase hardly depends on the depth
        turn = float(np.angle(np.exp(1j * (phase - gauge.phase))))
        if estimate.misfit * freedom(gauge) - cost > REMOUNT.chi_square and abs(turn) > REMOUNT.least_turn:
            found = search(freed)
            if found[1].depth > REMOUNT.worn_enough:
                notes.append(f"the pinion's disc has turned by {turn:+.2f} rad of mesh phase since the last window")
                gauge, (expectation, estimate), memory = freed, found, anew
    return SettledDepth(memory=memory, gauge=gauge, expectation=expectation, estimate=estimate, notes=tuple(notes))
