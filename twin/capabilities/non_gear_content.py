"""Content of the vibration that no gear makes: bearing impacts, tones, lines at orders of no shaft.

It needs a speed alone, and is attributed by the model's own search where the machine has a model.
"""

from __future__ import annotations

from dataclasses import replace

from twin.capabilities.context import Context, Draft
from twin.tracing.attribution_loop import attribute_non_gear_content
from twin.tracing.summary import attribution_of, effects_of
from twin.tracing.unexplained import with_unknown_content


def applies(context: Context, draft: Draft) -> bool:
    """Where effects are sought, the speed is known, and the model was not updated by this window."""
    return not draft.modelled and context.options.trace and context.features.speed_hz is not None


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with the effects found; of a machine whose model was updated before, the window joins its history."""
    tracing, events = attribute_non_gear_content(context.rig, draft.state.tracing, context.input)
    draft = replace(draft, state=replace(draft.state, tracing=tracing)).with_parts(events=events)
    if tracing.stages:
        return draft
    return draft.with_parts(
        effects=effects_of(context.rig, tracing),
        unexplained=with_unknown_content(tracing, replace(draft.assessment.unexplained, struck=tracing.struck)),
        attribution=attribution_of(tracing),
    )
