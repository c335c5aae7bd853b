"""Models and master curves by what they are made from, kept so that they are computed once.

Pure functions of their arguments: what is kept is only ever what would be computed again.
"""

from __future__ import annotations

import json
from functools import lru_cache

from twin.effects.addition import Addition
from twin.effects.extended import extend
from twin.effects.response import Effect
from twin.model import Calibration, Condition, Model
from twin.rig import Rig
from twin.updating.memory import Memory, Segment
from twin.wear.curve import MasterCurve
from twin.wear.profile import WornProfile

DEEPEST = 5e-4  # depth to which curves are made where the rig file gives no end of life [m]


class _Key:
    """A rig by its values, hashable."""

    __slots__ = ("rig", "text")

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.text = json.dumps(rig.values, sort_keys=True)

    def __hash__(self) -> int:
        return hash(self.text)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.text == other.text


@lru_cache(maxsize=16)
def _model(key: _Key, calibration: Calibration) -> Model:
    return Model.of(key.rig, calibration)


@lru_cache(maxsize=32)
def _extended(key: _Key, calibration: Calibration, effects: tuple[Effect, ...]) -> Model:
    return extend(_model(key, calibration), effects)


@lru_cache(maxsize=10)  # of a sliced face some 30 MB each
def _curve(
    key: _Key, calibration: Calibration, segments: tuple[Segment, ...], effects: tuple[Addition, ...], until: float
) -> MasterCurve:
    last = segments[-1]
    there = tuple(a.effect for a in effects if a.onset_revolutions <= last.start_revolutions)
    model = _extended(key, calibration, tuple(e for e in there if e.period == "mesh" and e.facts.acts_on != "sensor"))
    start = model.unworn
    if len(segments) > 1 and last.start_depth > 0:
        before = _curve(key, calibration, segments[:-1], effects, until)
        start = before.profile(last.start_depth)
    return MasterCurve.build(model, Condition(speed_hz=last.speed_hz, torque=last.torque), start, until)


BEYOND = 1.25  # a machine run past its end of life is still measured: curves then go on to this much of it
NEAR_END = 0.8


def deepest(rig: Rig, depth: float) -> float:
    """Depth to which the curve of a machine worn to `depth` [m] is made [m]."""
    end = rig.get("end_of_life.max_depth", DEEPEST)
    return end if depth < NEAR_END * end else BEYOND * end


def model_of(rig: Rig, memory: Memory, revolutions: float = 0.0) -> Model:
    """The model with what is calibrated so far and the effects that are there after so many turns of the pinion.

    NotAvailable where the rig file does not suffice.
    """
    calibration = Calibration.prior(rig) if memory.fit is None else memory.fit.calibration
    return _extended(_Key(rig), calibration, memory.active(revolutions))


def curve_of(rig: Rig, memory: Memory, until: float | None = None) -> MasterCurve:
    """The master curve of the present segment, to the rig's end of life and beyond, or to a lesser depth [m]."""
    calibration = model_of(rig, memory).calibration
    until = deepest(rig, memory.depth) if until is None else until
    return _curve(_Key(rig), calibration, memory.segments, memory.effects, until)


def profile_of(rig: Rig, memory: Memory, revolutions: float, depth: float) -> WornProfile:
    """The flanks at a depth [m] as they had worn after so many turns of the pinion: of that time's segment."""
    calibration = model_of(rig, memory).calibration
    passed = [s for s in memory.segments if s.start_revolutions <= revolutions] or list(memory.segments[:1])
    curve = _curve(_Key(rig), calibration, tuple(passed), memory.effects, deepest(rig, memory.depth))
    return curve.profile(max(depth, float(curve.depth[0])))


def nominal_model_of(rig: Rig) -> Model:
    """The rig file's model, before any calibration."""
    return _model(_Key(rig), Calibration.prior(rig))


def healthy_model_of(rig: Rig, memory: Memory) -> Model:
    """The calibrated model without any effect."""
    calibration = Calibration.prior(rig) if memory.fit is None else memory.fit.calibration
    return _model(_Key(rig), calibration)
