"""From the history of a machine to the effects that its twin lacks.

The detectors run in the order of `DETECTORS`; each sees what those before it have found, and is asked again where its
answer rests on findings that came later. Windows held out take no part in any fit; errors before and after are those of
the held-out windows.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from twin.required_evidence import DEFAULT, RequiredEvidence
from twin.rig import Rig
from twin.tracing.accelerometer_fault import accelerometer_fault_of, corrected
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import TracingContext, held_out
from twin.tracing.detectors import DETECTORS, Detector
from twin.tracing.findings import NonGearContent
from twin.tracing.settling import Known, ask, settled
from twin.updating.history import WindowInput


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Traced:
    """What a trace found."""

    found: tuple[AttributedEffect, ...]
    non_gear: NonGearContent
    table: tuple[tuple[str, float], ...] = ()  # candidates on the mesh and their gain
    other_structure: bool = False  # whether the path to the housing is not the rig file's
    misfit_before: float | None = None
    misfit_after: float | None = None
    held_out: tuple[int, ...] = ()  # indices of windows, rising
    fitted: tuple[int, ...] = ()
    skipped: tuple[tuple[int, str], ...] = ()  # windows that could not be read: index, and why
    waiting: bool = False  # whether only the latest window breaks off: one more must show it


def trace(
    rig: Rig,
    history: Sequence[WindowInput],
    depths: Mapping[int, float],
    phase: float | None,
    *,
    rejected: Collection[str] = (),
    kept: Sequence[AttributedEffect] = (),
    fixed: Collection[str] = (),
    tolerated: float = 0.0,
    since_ns: int = 0,
    required: RequiredEvidence = DEFAULT,
    detectors: Sequence[Detector] = DETECTORS,
) -> Traced:
    """The effects that the history shows; NotAvailable where it does not suffice.

    depths     wear depth of each window by index [m], as a start
    phase      of the mesh against the encoder's zero [rad]; without it only non-gear content is sought
    rejected   names that an engineer has ruled out
    kept       effects that the mesh lines are fitted with from the start
    fixed      names that an engineer has accepted or pinned: they stay, whatever they add
    tolerated  misfit of the mesh lines up to which no more effects are sought
    since_ns   when the pinion's disc was last turned: the mesh phase of what was recorded before is another [Unix ns]
    required   evidence that an effect must have
    """
    context = TracingContext.of(
        rig,
        history,
        depths,
        phase,
        rejected=rejected,
        kept=kept,
        fixed=fixed,
        tolerated=tolerated,
        since_ns=since_ns,
        required=required,
    )
    fault = None if phase is None or "unknown_effect" in rejected else accelerometer_fault_of(context)
    if fault is not None:
        context = corrected(context, fault)
    known: Known = {}
    for detector in detectors:
        if phase is None and detector.needs_phase:
            continue
        context = ask(context, detector, known)
        if context.findings.teeth_separate:
            break
    context = settled(context, known, detectors)
    findings, mesh = context.findings, context.findings.mesh
    return Traced(
        found=findings.effects,
        non_gear=findings.non_gear,
        table=() if mesh is None else mesh.table,
        other_structure=findings.other_structure,
        misfit_before=None if mesh is None else mesh.base.misfit,
        misfit_after=None if mesh is None else mesh.best.misfit,
        held_out=tuple(sorted(context.held_out)),
        fitted=tuple(w.index for w in context.fitting),
        skipped=context.skipped,
        waiting=mesh is not None and mesh.waiting,
    )


__all__ = ["Traced", "held_out", "trace"]
