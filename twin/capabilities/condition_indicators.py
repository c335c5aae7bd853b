"""Condition indicators of every accelerometer, with NA4 against the record of the windows before.

They need no model of the machine, and decide nothing: they are kept with the window for whoever follows their trend.
"""

from __future__ import annotations

from dataclasses import replace

from twin.capabilities.context import Context, Draft
from twin.features.indicator_record import with_na4


def applies(context: Context, draft: Draft) -> bool:
    """Where an accelerometer has valid samples."""
    return bool(context.features.indicators)


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with the indicators in the window's record."""
    records, indicators = with_na4(draft.state.residual_records, context.features)
    draft = replace(draft, state=replace(draft.state, residual_records=records))
    return draft.with_parts(window=replace(draft.record, indicators=indicators))
