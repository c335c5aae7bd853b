"""Stretches of a campaign under one operating condition: when a new one begins, and from which profile.

A change of the condition, or of the effects that are there, starts a new wear curve from the present profile.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from twin.model import Condition
from twin.rig import Rig
from twin.thresholds import deciding
from twin.updating.memory import KEPT_SEGMENTS, Memory, Segment, StoredProfile
from twin.updating.model_cache import curve_of


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentLimits:
    """Changes of the operating condition that start a new segment; smaller ones are followed within the segment."""

    speed: float = deciding(
        0.05,
        of="speed of the segment",
        meaning="relative change of speed that starts a new segment",
        source="not derived: a drive's own wander starts none; the response of a window is solved at its own speed",
    )
    torque: float = deciding(
        0.10,
        of="torque of the segment",
        meaning="relative change of torque that starts a new segment",
        source="not derived: a brake's own wander starts none; the response of a window is solved at its own torque",
    )


LIMITS = SegmentLimits()


def _near(value: float, other: float | None, tolerance: float) -> bool:
    return other is not None and bool(other) and abs(value / other - 1) < tolerance


def near_segment(segment: Segment, condition: Condition, limits: SegmentLimits = LIMITS) -> bool:
    """Whether a condition is that of a segment, within the changes that are followed within it."""
    return _near(condition.speed_hz, segment.speed_hz, limits.speed) and _near(
        condition.torque, segment.torque, limits.torque
    )


def with_segment(
    rig: Rig, memory: Memory, condition: Condition, revolutions: float = 0.0, limits: SegmentLimits = LIMITS
) -> Memory:
    """The memory with a segment that fits the condition and the effects, else with a new one from the present depth."""
    last = memory.segments[-1] if memory.segments else None
    same = last is not None and near_segment(last, condition, limits)
    if same and last is not None and memory.wearing(revolutions) == memory.wearing(last.start_revolutions):
        return memory
    nominal_speed, nominal_torque = rig.get("operating.pinion_speed_hz"), rig.get("operating.input_torque")
    speed = nominal_speed if _near(condition.speed_hz, nominal_speed, limits.speed) else condition.speed_hz
    torque = nominal_torque if _near(condition.torque, nominal_torque, limits.torque) else condition.torque
    depth, work, profile = _at_change(rig, memory, revolutions)
    if last is not None and _tilted(memory, last.start_revolutions, revolutions):
        memory = replace(memory, offset=None)
    segment = Segment(
        speed_hz=speed,
        torque=torque,
        start_depth=depth,
        start_work=work,
        start_revolutions=revolutions,
        start_profile=profile,
    )
    return replace(memory, segments=(*memory.segments, segment)[-KEPT_SEGMENTS:] if depth > 0 else (segment,))


def segment_begun(rig: Rig, memory: Memory) -> Memory:
    """The memory with a new segment from the present profile, under the condition of the present one."""
    if not memory.segments:
        return memory
    last, revolutions = memory.segments[-1], memory.track.revolutions
    depth, work, profile = _at_change(rig, memory, revolutions)
    segment = replace(
        last, start_depth=depth, start_work=work, start_revolutions=revolutions, start_profile=profile
    )  # fmt: skip
    return replace(memory, segments=(*memory.segments, segment)[-KEPT_SEGMENTS:] if depth > 0 else (segment,))


def _at_change(rig: Rig, memory: Memory, revolutions: float) -> tuple[float, float, StoredProfile | None]:
    """Depth [m], work [rad/N] and profile at which the present segment ends: at the onset of an effect, or now."""
    if not memory.segments or not memory.track.windows:
        return 0.0, 0.0, None
    last, work = memory.segments[-1], memory.track.work
    onsets = [n for a in memory.effects for n in a.changes if n <= revolutions]
    if onsets and max(onsets) > max(memory.track.revolutions, last.start_revolutions):
        work = memory.track.predicted(max(onsets)).work
    curve = curve_of(rig, memory)
    depth = curve.depth_at(work - last.start_work)
    if not depth > 0:
        return depth, work, None
    return depth, work, StoredProfile.of(curve.profile(max(depth, curve.start_depth)))


def _tilted(memory: Memory, before: float, now: float) -> bool:
    """Whether a shaft has tilted between two counts of revolutions, which moves the mean by an unknown step."""
    changes = [n for a in memory.effects if a.effect.facts.tilts_shaft for n in a.changes]
    return any(before < n <= now for n in changes)
