"""Modulation of the mesh vibration by the turn of either shaft, where the machine has no model that describes it.

A machine whose model gives a wear depth has it explained by its effects. What is found is a description: healthy gears
have sidebands, too, so that it changes neither verdict nor status.
"""

from __future__ import annotations

from twin.assessment import Modulation, Unavailable
from twin.baseline.modulation import against_baseline
from twin.capabilities.context import Context, Draft
from twin.errors import TwinError
from twin.features.modulation import modulations


def applies(context: Context, draft: Draft) -> bool:
    """Where tooth counts are known and an accelerometer recorded, and no window has updated a model that fits."""
    known = context.rig.has("gears.pinion.teeth", "gears.gear.teeth")
    modelled = draft.modelled or draft.state.tracing.stages
    fits = modelled and not isinstance(draft.assessment.wear, Unavailable)
    return not fits and known and bool(context.window.accelerations)


def assess(context: Context, draft: Draft) -> Draft:
    """The draft with the modulations of every accelerometer; unchanged where the speed is not known."""
    window, rig = context.window, context.rig
    try:
        track = context.signals.track
    except TwinError:  # the record says already why there is no speed
        return draft
    found: list[Modulation] = []
    for sensor, samples in window.accelerations.items():
        try:
            found += modulations(samples, track, rig.teeth, sensor)
        except TwinError as reason:
            draft = draft.noted(f"sidebands of {sensor} are not available: {reason}")
    deepest = tuple(sorted(found, key=lambda m: -m.depth))
    baseline = context.options.baseline
    same = baseline is not None and baseline.rig.teeth == rig.teeth
    return draft.with_parts(modulation=against_baseline(deepest, baseline) if baseline and same else deepest)
