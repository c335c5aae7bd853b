"""Likely mistakes of units, wiring, clocks, speed and tooth counts, as notes on the first windows of a machine.

They are mistakes of the installation, so that the first windows show them; the later ones are not examined.
"""

from __future__ import annotations

from twin.capabilities.context import Context, Draft
from twin.plausibility import mistakes_of

EXAMINED = 2  # windows of a machine, from the first


def applies(context: Context, draft: Draft) -> bool:
    """Where the window is one of the first of its machine."""
    return context.state.windows_seen < EXAMINED


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with a note for each mistake."""
    return draft.noted(*(mistake.text for mistake in mistakes_of(context.rig, context.window)))
