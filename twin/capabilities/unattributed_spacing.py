"""Lines of evenly spaced orders that no known shaft makes, where the machine has neither a model nor a baseline."""

from __future__ import annotations

from twin.baseline.comparison import lines_without_shaft
from twin.capabilities.context import Context, Draft
from twin.errors import TwinError


def applies(context: Context, draft: Draft) -> bool:
    """Where effects are sought without a baseline and no window has updated a model."""
    options = context.options
    alone = options.trace and options.baseline is None
    return not draft.modelled and alone and not draft.state.tracing.stages


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with the lines; unchanged where there are none, or where the speed is not known."""
    try:
        found = lines_without_shaft(context.rig, context.window, f"window {context.input.index}")
    except TwinError:  # the record says already why there is no speed
        return draft
    draft = draft.with_parts(unattributed_search=found.sought)
    if not found.lines:
        return draft
    draft = draft.with_parts(unattributed_lines=found.lines)
    return draft if found.unexplained is None else draft.with_parts(unexplained=found.unexplained)
