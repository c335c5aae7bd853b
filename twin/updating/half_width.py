"""The contact half-width from the first window that is worn enough to show it.

A wider contact rounds the worn profile: its higher mesh harmonics fall against the first. Structure does the same to
some extent, so the prior stays in force and the change is small unless the data insist.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.errors import NotAvailable
from twin.features.window_features import WindowFeatures
from twin.model import Condition
from twin.rig import Rig
from twin.structure_spread import is_estimated
from twin.thresholds import deciding
from twin.updating import encoders
from twin.updating.calibration import fit_half_width
from twin.updating.depth import HARMONICS, estimate_depth
from twin.updating.memory import Memory
from twin.updating.model_cache import curve_of, model_of
from twin.updating.prediction import Expectation


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfWidthFit:
    """When the contact half-width is fitted, and within which depths."""

    worn_enough: float = deciding(
        40e-6,
        unit="m",
        meaning="depth from which a worn window shows the half-width",
        source="not derived: the half-width changes mesh harmonics 2 and 3 of deep wear",
    )
    range: float = deciding(
        0.15,
        of="the depth",
        meaning="range of depths about that of the window within which the fit is free",
        source="not derived: larger than the errors of depths on the reference campaigns",
    )


FIT = HalfWidthFit()


def refitted(rig: Rig, memory: Memory, features: WindowFeatures, condition: Condition, depth: float) -> Memory:
    """The memory with the half-width refitted where the depth [m] has first passed FIT.worn_enough."""
    due = memory.half_width_from == 0 and depth >= FIT.worn_enough
    if (
        not due
        or is_estimated(rig)
        or memory.fit is None
        or len(memory.segments) > 1
        or encoders.encoder_lines(features) is None
    ):
        return memory
    fit, old_curve = memory.fit, curve_of(rig, memory)
    pinion_only = features.transmission_error is None
    new = model_of(rig, memory) if memory.active(0.0) else None

    def misfit(half_width: float) -> float:
        calibration = replace(fit.calibration, contact_half_width=half_width)
        trial = replace(memory, fit=replace(fit, calibration=calibration), offset=None)
        model, curve = model_of(rig, trial, features.revolutions or 0.0), curve_of(rig, trial)
        gauge = encoders.gauge_of(features, trial, model, condition)
        if gauge is None:
            raise NotAvailable("the contact half-width is not available: the window has no encoder lines")
        expectation = Expectation.at(model, curve, condition, depth, new)
        low, high = (1 - FIT.range) * depth, (1 + FIT.range) * depth
        found = estimate_depth(gauge, expectation.response(pinion_only, gauge.from_unworn), low, high)
        return found.misfit * (2 * HARMONICS - 2)

    memory = replace(memory, half_width_from=depth, fit=fit_half_width(fit, misfit))
    factor = curve_of(rig, memory).work_at(depth) / old_curve.work_at(depth)
    rms = memory.rms_track
    return replace(
        memory,
        track=memory.track.rescaled(factor),
        rms_track=replace(rms, work=rms.work * factor, rate=rms.rate * factor),
        points=tuple(p.rescaled(factor) for p in memory.points),
        rms_points=tuple(p.rescaled(factor) for p in memory.rms_points),
    )
