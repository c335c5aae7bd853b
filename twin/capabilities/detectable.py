"""What could have been found where nothing was: the smallest sizes that windows show, and false alarms in a year."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.assessment import Detectable, SmallestSize, Unexplained
from twin.capabilities.context import Context, Draft
from twin.detectability.visible import ALARM_CLASS, smallest_sizes
from twin.detectability.yearly import false_alarms
from twin.effects import EFFECTS
from twin.model import Condition
from twin.tracing.context import THRESHOLDS
from twin.tracing.state import LEAST_WINDOWS
from twin.updating.conditions import kind_of
from twin.updating.model_cache import healthy_model_of


def applies(context: Context, draft: Draft) -> bool:
    """Where effects were searched for, and the answer says that nothing is left to find, or that nothing was found."""
    tracing, found = draft.state.tracing, draft.assessment
    searched = draft.modelled and context.options.trace and tracing.measured >= LEAST_WINDOWS
    nothing = not found.effects or found.unexplained.verdict == "explained"
    alarming = any(effect.name in ALARM_CLASS for effect in found.effects)
    return searched and nothing and not alarming


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with what could have been found."""
    rig, state = context.rig, draft.state
    windows = [w.features for w in state.tracing.history if kind_of(w.features, rig) == "measurement"]
    usual = float(np.median([w.speed_hz or 0.0 for w in windows]))
    windows = [w for w in windows if (w.speed_hz or 0.0) >= THRESHOLDS.least_speed_share * usual]
    segment, memory = state.memory.segments[-1], state.memory
    condition = Condition(speed_hz=segment.speed_hz, torque=segment.torque)
    sizes = smallest_sizes(rig, healthy_model_of(rig, memory), condition, windows, state.tracing.phase)
    rate = context.options.false_alarm_rate
    return draft.with_parts(
        unexplained=_with_hidden(draft.assessment.unexplained, sizes),
        detectable=Detectable(
            windows=len(windows),
            sizes=sizes,
            false_alarms=false_alarms(rate, state.tracing.measured, state.windows_seen + 1, state.running),
        ),
    )


def _with_hidden(unexplained: Unexplained, sizes: Sequence[SmallestSize]) -> Unexplained:
    """No machine is explained in whose windows damage of the alarm class would have gone unseen at any size."""
    hidden = [EFFECTS[s.name].facts.label for s in sizes if s.hidden]
    if unexplained.verdict != "explained" or not hidden:
        return unexplained
    reason = f"these windows vary too much to show {' or '.join(hidden)} of any size"
    return replace(unexplained, verdict="insufficient_data", reason=reason)
