"""Likely mistakes in a recording: units, polarity, exchanged or shifted channels, aliasing, teeth and speed, hum.

    for mistake in mistakes_of(rig, window):
        print(mistake.text)

Every check looks at one window and says nothing where the recording is clean, or where it cannot tell.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from twin.assessment import Mistake
from twin.plausibility.context import Examined
from twin.plausibility.levels import levels, torque_polarity
from twin.plausibility.sampling import aliasing, hum, shifted
from twin.plausibility.speed import candidates, encoders, mesh_lines
from twin.plausibility.thresholds import LevelThresholds, SamplingThresholds, SpeedThresholds
from twin.rig import Rig
from twin.windows import Window

CHECKS: tuple[tuple[Callable[[Examined, Any], list[Mistake]], Any], ...] = (
    (levels, LevelThresholds()),
    (torque_polarity, LevelThresholds()),
    (encoders, SpeedThresholds()),
    (mesh_lines, SpeedThresholds()),
    (candidates, SpeedThresholds()),
    (aliasing, SamplingThresholds()),
    (shifted, SamplingThresholds()),
    (hum, SamplingThresholds()),
)


def mistakes_of(rig: Rig, window: Window) -> tuple[Mistake, ...]:
    """The likely mistakes of one window, in the order of the checks."""
    seen = Examined(rig=rig, window=window)
    return tuple(mistake for check, limits in CHECKS for mistake in check(seen, limits))
