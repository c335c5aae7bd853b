"""The vibration level against the limit learned from the machine's own first windows.

A machine with a healthy baseline has its level compared with that.
"""

from __future__ import annotations

from dataclasses import replace

from twin.capabilities.context import Context, Draft
from twin.learned_limits import OperatingPoint
from twin.level_record import with_level


def applies(context: Context, draft: Draft) -> bool:
    """Where the level was measured, nothing falsifies it, and no baseline is given."""
    usable = context.features.rms is not None and context.input.level_fault is None
    return usable and context.options.baseline is None and (draft.modelled or not draft.state.tracing.stages)


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with the level's excess, and with the level among those learned."""
    features, record = context.features, draft.record
    value = features.rms
    assert value is not None
    if draft.modelled:
        if not record.rms_predicted or record.rms_predicted != record.rms_predicted:
            return draft
        value /= record.rms_predicted
    point = OperatingPoint(speed=features.speed_hz, torque=features.torque_nm)
    levels, excess = with_level(
        draft.state.learned_levels, point, value, relative=draft.modelled, sensor=features.sensor or ""
    )
    return replace(draft, state=replace(draft.state, learned_levels=levels)).with_parts(level_excess=excess)
