"""Effects and attribution of one machine as typed results, from what the attribution remembers."""

from __future__ import annotations

from twin.assessment import Attribution, Candidate, DepthPair, EffectAssessment, HeldOutErrors, SkippedWindow
from twin.rig import Rig
from twin.structure_spread import DRAWN, is_estimated
from twin.tracing.earned import judged
from twin.tracing.growth import growth_of
from twin.tracing.log import evidence_of
from twin.tracing.state import EffectErrors, Tracing, TwinStage, parameters_of, relevant

OF_OWN_LINES = "non_gear"  # the detector that needs no model of the structure
NOT_COMPARED = EffectErrors(before=HeldOutErrors(), after=HeldOutErrors())


def effects_of(rig: Rig, tracing: Tracing) -> tuple[EffectAssessment, ...]:
    """The effects in the twin, each with its parameters, evidence, and errors, depth and life without and with it."""
    out = []
    latest = max((t.features.revolutions or 0.0 for t in tracing.history), default=0.0)
    for i, item in enumerate(tracing.found):
        without, present = (_stage(tracing, n) for n in (i, i + 1))
        errors = tracing.errors[i] if i < len(tracing.errors) else NOT_COMPARED
        verdict = judged(item, errors)
        status = tracing.decisions.get(item.name) or ("found" if verdict.kind == "earned" else "suspected")
        out.append(
            EffectAssessment(
                name=item.name,
                status=status,
                parameters=parameters_of(item),
                evidence=evidence_of(item, verdict.rivals),
                error_before=errors.before,
                error_after=errors.after,
                moved_lines=errors.moved,
                depth_before=None if without is None else without.depth,
                depth_after=None if present is None else present.depth,
                life_before=None if without is None else without.life,
                life_after=None if present is None else present.life,
                onset_revolutions=item.addition.onset_revolutions,
                onset_std=item.onset_std,
                growth=growth_of(item, latest),
                caveats=_caveats(rig, item.addition.effect.facts.detector, status, verdict.reason),
            )
        )
    return tuple(out)


def _caveats(rig: Rig, detector: str, status: str, reason: str) -> tuple[str, ...]:
    """What of an effect is preliminary: what has not been tested yet, and the cause where the structure is estimated.

    What is found by lines of its own, as a bearing defect, does not rest on the structure. An engineer
    who has accepted or pinned the effect has settled its cause.
    """
    untested = (f"{reason[:1].upper()}{reason[1:]}.",) if status == "suspected" else ()
    if not is_estimated(rig) or detector == OF_OWN_LINES:
        return untested
    what = "Cause and size are" if status in ("found", "suspected") else "The size is"
    *parts, last = (part for part in rig.estimated.parts if part in DRAWN)
    listed = f"{', '.join(parts)} and {last}" if parts else last
    return (*untested, f"{what} preliminary, because the values of the rig file for {listed} are estimates.")


def _stage(tracing: Tracing, count: int) -> TwinStage | None:
    """The twin with so many of the effects; None where the machine has no model."""
    return tracing.stages[len(relevant(tracing.found[:count]))] if tracing.stages else None


def attribution_of(tracing: Tracing) -> Attribution | None:
    """What the effects rest on; None before the first window of the history."""
    if not tracing.history:
        return None
    alone = tracing.stages[0].depths if tracing.stages else {}
    now = tracing.stages[-1].depths if tracing.stages else {}
    turns = {t.index: t.features.revolutions for t in tracing.history}
    latest = tracing.latest
    return Attribution(
        reason=latest.reason,
        candidates=tuple(Candidate(name=name, log_evidence=gain) for name, gain in latest.candidates),
        misfit_before=latest.misfit_before,
        misfit_after=latest.misfit_after,
        other_structure=latest.other_structure,
        held_out=latest.held_out,
        fitted=latest.fitted,
        not_confirmed=tuple(sorted(tracing.refuted)),
        refused={name: refusal.reason for name, refusal in sorted(tracing.refuted.items())},
        rejected=tracing.rejected,
        errors=tracing.error,
        depths=tuple(
            DepthPair(index=i, revolutions=turns[i], before=alone[i], after=now[i])
            for i in now
            if i in alone and i in turns
        ),
        residual=tracing.residual,
        unknown=tracing.unknown,
        skipped=tuple(SkippedWindow(window=index, reason=reason) for index, reason in latest.skipped),
        log=tracing.log,
    )
