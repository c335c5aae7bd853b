"""Comparison of a window with a healthy baseline of a machine without a model."""

from __future__ import annotations

from dataclasses import replace

from twin.assessment import EffectAssessment, EffectEvent, Unexplained
from twin.baseline.comparison import BaselineResult, compare_levels, compare_with_baseline, described, tracked
from twin.baseline.learned import Baseline
from twin.baseline.validity import valid_part
from twin.capabilities.context import Context, Draft
from twin.errors import TwinError
from twin.state import BaselineParts
from twin.tracing.summary import effects_of


def applies(context: Context, draft: Draft) -> bool:
    """Where a baseline is given and no window has updated a model."""
    return not draft.modelled and context.options.baseline is not None and not draft.state.tracing.stages


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with the changes against the baseline, and an event for each that is seen for the first time."""
    baseline, index = context.options.baseline, context.input.index
    assert baseline is not None
    try:
        baseline = valid_part(baseline, draft.state.outdated)
        result = _compared(baseline, context, f"window {index}")
    except TwinError as fault:
        return draft.with_parts(unexplained=Unexplained(verdict="insufficient_data", reason=str(fault)))
    names = {effect.name for effect in result.effects}
    traced = effects_of(context.rig, draft.state.tracing)
    effects = (*result.effects, *(e for e in traced if e.name not in names))
    latest = draft.state.latest.baseline
    known = set() if latest is None else {_identity(e) for e in latest.effects}
    parts = BaselineParts(
        residual=result.residual,
        effects=effects,
        unexplained=result.unexplained,
        baseline=described(baseline, result.windows[0] if result.windows else None, result.raw_limit),
        unattributed_lines=result.unattributed_lines,
    )
    draft = replace(draft, judged=True).with_latest(baseline=parts)
    return draft.with_parts(
        residual=parts.residual,
        effects=effects,
        unexplained=parts.unexplained,
        baseline=parts.baseline,
        unattributed_lines=parts.unattributed_lines,
        unattributed_search=result.unattributed_search,
        events=tuple(
            EffectEvent(action="found", name=e.name, window=index, evidence=e.evidence)
            for e in effects
            if _identity(e) not in known
        ),
    )


def _compared(baseline: Baseline, context: Context, name: str) -> BaselineResult:
    """A window beside its baseline; by its raw levels alone where these are beyond limits and its angle is unknown."""
    try:
        window = tracked(context.rig, context.window, name, baseline.shafts)
    except TwinError as fault:
        found = compare_levels(baseline, context.rig, [context.window], str(fault))
        if not found.raw_limit.exceeded:
            raise
        return found
    return compare_with_baseline(baseline, context.rig, [window])


def _identity(effect: EffectAssessment) -> tuple[str, tuple[str, ...]]:
    """What makes two findings the same effect: its name and the channels in which it is seen."""
    return effect.name, effect.channels
