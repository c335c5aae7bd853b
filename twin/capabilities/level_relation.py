"""Wear depth by a calibrated relation of vibration level and depth, for machines without a model."""

from __future__ import annotations

from dataclasses import replace

from twin.assessment import LevelWear, Unavailable
from twin.capabilities.context import Context, Draft
from twin.errors import NotAvailable
from twin.levels.wear_by_level import NO_RATE, wear_by_level


def applies(context: Context, draft: Draft) -> bool:
    """Where a relation is given and the machine was not modelled."""
    return not draft.modelled and context.options.relation is not None


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with depth by level, or the reason why the relation says nothing of this window."""
    relation, state = context.options.relation, draft.state
    assert relation is not None
    wear: LevelWear | Unavailable
    try:
        wear = wear_by_level(relation, context.rig, context.features, state.levels, context.input.index)
    except NotAvailable as missing:
        wear = Unavailable(reason=str(missing))
    life = Unavailable(reason=NO_RATE)
    draft = draft.with_latest(wear=wear, life=life).with_parts(wear=wear, life=life)
    if isinstance(wear, Unavailable):
        return draft
    record = replace(draft.record, depth=wear.depth)
    return replace(draft, state=replace(draft.state, levels=wear.levels), judged=True).with_parts(window=record)
