"""A trace of all windows as on one mounting of the encoder discs.

What looks like a disc that was turned may be an effect that sets in, or effects from the start by which the first
windows showed a wrong phase of the mesh. A turned disc is believed where wear alone explains all windows once the disc
is turned back. Where nothing explains all windows together, they are traced with the phase that the later ones show;
only where that explains no more are the earlier ones given up.

    Y_o → Y_o·e^{−i·o·Δ/z1}                  line of order o on the mounting before, Δ the turn of the mesh phase [rad]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.errors import NotAvailable, NotConverged
from twin.required_evidence import DEFAULT, RequiredEvidence
from twin.rig import Rig
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.mesh_windows import OnsetThresholds
from twin.tracing.state import Tracing
from twin.tracing.trace import Traced, trace
from twin.updating.history import WindowInput
from twin.updating.memory import Memory


@dataclass(frozen=True, slots=True, kw_only=True)
class RemountLimits:
    """When a turned disc is believed."""

    explained_misfit: float = deciding(
        0.6,
        meaning="misfit of wear alone (chi-square per line) that leaves nothing to be explained",
        source="not derived: chosen above the 0.1 to 0.3 that healthy campaigns reach",
    )
    left_share: float = deciding(
        0.5,
        of="misfit of all windows",
        meaning="misfit below which the later windows' phase is believed for all, or the earlier ones are given up",
        source="not derived: chosen so that another phase, or giving up windows, must at least halve the misfit",
    )


REMOUNT_LIMITS = RemountLimits()


def trace_over_remounts(
    rig: Rig,
    tracing: Tracing,
    memory: Memory,
    kept: Sequence[AttributedEffect],
    tolerated: float,
    required: RequiredEvidence = DEFAULT,
    limits: RemountLimits = REMOUNT_LIMITS,
) -> tuple[Tracing, Traced]:
    """A trace of all windows, with the turns of the disc that are believed; NotAvailable, NotConverged.

    kept       effects that the mesh lines are fitted with from the start
    tolerated  misfit of the mesh lines up to which no more effects are sought
    required   evidence that an effect must have
    """
    depths = dict(tracing.stages[-1].depths)
    phase = memory.phase if tracing.phase is None else tracing.phase
    tracing = replace(tracing, phase=phase)

    def attempt(turns: Sequence[tuple[int, float]], since_ns: int = 0, at: float | None = phase) -> Traced:
        return trace(
            rig, [turned_back(rig, t, turns) for t in tracing.history], depths, at, rejected=tracing.rejected,
            kept=kept, fixed=tracing.fixed, tolerated=tolerated, since_ns=since_ns, required=required,
        )  # fmt: skip

    known = tracing.turns[-1][0] if tracing.turns else 0
    new_turn = memory.discs_since_ns > known and memory.phase is not None
    if new_turn and phase is not None:
        back = sum(turn for _, turn in tracing.turns)
        turn = float(np.angle(np.exp(1j * ((memory.phase or 0.0) - phase - back))))
        turns = (*tracing.turns, (memory.discs_since_ns, turn))
        turned = attempt(turns)
        if (turned.misfit_before or 0.0) <= limits.explained_misfit:
            return replace(tracing, turns=turns), turned
        whole = turned if turn == 0 else attempt(tracing.turns)
    else:
        whole = attempt(tracing.turns)
    if new_turn and (whole.misfit_after or 0.0) > OnsetThresholds().explained:
        most = limits.left_share * (whole.misfit_after or 0.0)
        of_later = replace(tracing, phase=memory.phase, turns=((memory.discs_since_ns, 0.0),))
        for since, after in ((0, of_later), (memory.discs_since_ns, tracing)):
            try:
                other = attempt((), since, memory.phase)
            except (NotAvailable, NotConverged):
                continue
            if (other.misfit_after or 0.0) < most:
                return after, other
    return tracing, whole


def turned_back(rig: Rig, window: WindowInput, turns: Sequence[tuple[int, float]]) -> WindowInput:
    """The window as the pinion's disc would have shown it before it was turned."""
    turn = sum(angle for since, angle in turns if window.features.start_time_ns >= since)
    if turn == 0:
        return window
    features = window.features
    changes = {}
    for name in ("acceleration", "transmission_error", "pinion_motion", "torque"):
        lines = getattr(features, name)
        if lines is not None:
            back = np.exp(-1j * np.array(lines.orders) * turn / rig.teeth[0])
            amplitudes = tuple((np.array(lines.amplitudes) * back).tolist())
            changes[name] = replace(lines, amplitudes=amplitudes)
    return replace(window, features=replace(features, **changes))
