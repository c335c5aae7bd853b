"""What stands clear of its neighbourhood though no effect names it, however small: no machine with it is explained.

Lines of a force at orders of the pinion (twin/tracing/shaft_remainder.py), with the place where they enter; noise that
every turn of a shaft modulates, less deeply than a rub that is reported as an effect; and, where no effect is found, a
step of the mean transmission error (twin/tracing/mean_step.py).

Holds    lines and noise as their own files say; a force on the shaft needs both encoders
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.features.channel_lines import LineReading
from twin.features.window_features import WindowFeatures
from twin.model import Model
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.context import TracingContext
from twin.tracing.findings import Findings, NonGearContent
from twin.tracing.mean_step import mean_step
from twin.tracing.shaft_remainder import ShaftLine, disc_error, shaft_lines
from twin.tracing.unknown_entry import entry_of, law_of
from twin.tracing.unknown_lines import FollowedLine, SeenWindow
from twin.tracing.unknown_words import of_light_noise, of_mean_step, of_shaft


@dataclass(frozen=True, slots=True, kw_only=True)
class UnnamedThresholds:
    """When noise that a shaft modulates stands clear."""

    noise_depth: float = deciding(
        0.4,
        meaning="mean depth, over the windows since it began, to which a shaft's turn modulates the noise",
        source="tuned on wide draw 1: rubs reach 0.7 and more; healthy machines 0.1, and 0.5 in single windows",
    )
    least_windows: int = deciding(3, meaning="windows that must show it", source="not derived: chosen")
    windows_share: float = deciding(
        0.75, of="windows since it began", meaning="share of them that must show it", source="not derived: chosen"
    )


THRESHOLDS = UnnamedThresholds()


def with_unnamed(
    findings: Findings,
    context: TracingContext,
    windows: Sequence[SeenWindow],
    model: Model | None,
    limits: UnnamedThresholds = THRESHOLDS,
) -> Findings:
    """The findings with what no effect names.

    windows  the measurement windows that show what lies beside the gears
    """
    content = findings.non_gear
    clear: list[str] = []
    lines = () if model is None else _forces(findings, context, windows, model)
    if lines and model is not None:
        followed = _followed(lines, windows, context)
        entry = entry_of(model, followed, windows, context.scales)
        onset = _onset(min(line.since for line in lines), windows)
        law = law_of(model, entry.place, followed, windows)
        clear.append(of_shaft(lines, entry, law, followed[0], onset))
        heard = tuple((float(line.order), line.level) for line in lines if line.channel == "acceleration")
        unheard = {line.order for line in lines} - {round(order) for order, _ in heard}
        content = replace(content, forces=(*heard, *((float(p), None) for p in sorted(unheard))))
    noise = None if content.modulated_by or content.impacts else _modulated(findings, context, limits)
    if noise is not None:
        clear.append(of_light_noise(*noise))
    step = None if findings.effects or findings.teeth_separate else mean_step(context)
    if step is not None:
        clear.append(of_mean_step(step))
    return replace(findings, non_gear=replace(content, unnamed="; ".join(clear)))


def _features(context: TracingContext, window: SeenWindow) -> WindowFeatures | None:
    return next((w.features for w in context.windows if w.index == window.index), None)


def _forces(
    findings: Findings, context: TracingContext, windows: Sequence[SeenWindow], model: Model
) -> tuple[ShaftLine, ...]:
    """Lines of force at the pinion's orders that no effect has been named for."""
    named = {round(f.order) for f in findings.forces if findings.has(f.name)}
    features = [f for w in windows if (f := _features(context, w)) is not None]
    if findings.teeth_separate or len(features) != len(windows):
        return ()
    return tuple(line for line in shaft_lines(model, features, context.scales) if line.order not in named)


def _followed(lines: Sequence[ShaftLine], windows: Sequence[SeenWindow], context: TracingContext) -> list[FollowedLine]:
    """The lines as those of one cause, each with what all channels show at its order; the clearest first."""
    clearest: dict[int, ShaftLine] = {}
    for line in lines:
        clearest.setdefault(line.order, line)
    out = []
    for p, line in clearest.items():
        read = [(i, _reading(_features(context, w), p, context.scales)) for i, w in enumerate(windows)]
        at = tuple((i, r) for i, r in read if i >= line.since and r is not None and line.channel in r.channels)
        out.append(FollowedLine(follows="angle", channel=line.channel, at=at))
    return sorted(out, key=lambda line: -line.clearness)


def _reading(features: WindowFeatures | None, p: int, scales: Scales) -> LineReading | None:
    """One order of the pinion in all channels; the discs' errors count as noise of the transmission error."""
    if features is None or not features.speed_hz:
        return None
    found = {}
    for name, lines, own in (
        ("acceleration", features.acceleration, 0.0),
        ("encoder", features.transmission_error, disc_error(p, scales)),
        ("torque", features.torque, 0.0),
    ):
        y = None if lines is None else lines.get(0, p, 0)
        if lines is not None and y is not None:
            found[name] = (y.real, y.imag, float(np.hypot(lines.std_at(0, p, 0), own)))
    f = p * features.speed_hz
    return LineReading(order=float(p), frequency=f, std=1e-3, follows_angle=0.0, channels=found)


def _onset(first: int, windows: Sequence[SeenWindow]) -> float:
    """Revolutions half-way between the last window without it and the first with it; 0 where all show it."""
    return 0.5 * (windows[first - 1].revolutions + windows[first].revolutions) if first else 0.0


def _modulated(
    findings: Findings, context: TracingContext, limits: UnnamedThresholds
) -> tuple[str, float, float] | None:
    """The shaft whose turn modulates the noise in most windows, the mean depth and the onset; None where none does."""
    content: NonGearContent = findings.non_gear
    if content.defect is not None or findings.tooth_errors:
        return None
    best = None
    for shaft in ("pinion", "gear"):
        depths = np.array([dict(w.swelling).get(shaft, 0.0) for _, w in context.non_gear])
        shown = np.flatnonzero(depths >= limits.noise_depth)
        if shown.size < limits.least_windows:
            continue
        since = depths[shown[0] :]
        if shown.size < limits.windows_share * since.size or since.mean() < limits.noise_depth:
            continue
        turns = [revolutions for revolutions, _ in context.non_gear]
        onset = 0.5 * (turns[shown[0] - 1] + turns[shown[0]]) if shown[0] else 0.0
        if best is None or since.mean() > best[1]:
            best = (shaft, float(since.mean()), onset)
    return best
