"""Models and master curves by what they are made from, kept so that they are computed once.

Pure functions of their arguments: what is kept is only ever what would be computed again. A curve is keyed by the
rig's values, the calibration, the effects that shape wear, the condition and the profile at its start, so that machines
of one kind share curves, and a change of the operating condition needs the present profile only, whatever came before.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from twin.effects.extended import extend
from twin.effects.response import Effect
from twin.model import Calibration, Condition, Model
from twin.rig import Rig
from twin.serial import to_plain
from twin.thresholds import deciding
from twin.updating.memory import Memory, Segment, StoredProfile
from twin.updating.path_cache import PathCache
from twin.wear.curve import MasterCurve
from twin.wear.kept_points import KeptPoints
from twin.wear.path import WearPath
from twin.wear.profile import WornProfile


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveDepths:
    """How deep master curves are computed."""

    deepest: float = deciding(
        5e-4,
        unit="m",
        meaning="depth to which curves are searched where the rig file gives no end of life",
        source="the reference rig's end of life",
    )
    beyond: float = deciding(
        1.25,
        of="end of life",
        meaning="depth to which a machine run past its end of life is still measured",
        source="not derived: room beyond the end of life",
    )
    near_end: float = deciding(
        0.8,
        of="end of life",
        meaning="depth from which curves are searched beyond the end of life",
        source="not derived: leaves room for the depth of the next window",
    )


CURVES = CurveDepths()
KEPT_MODELS = 256  # some 50 kB each; the tables of a pair of gears are shared

PATHS = PathCache()


class _Key:
    """A rig by its values, hashable."""

    __slots__ = ("rig", "text")

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.text = rig.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self.text == other.text


class PathKey(NamedTuple):
    """What a wear path is made from."""

    rig: _Key
    calibration: Calibration
    effects: tuple[Effect, ...]
    condition: Condition
    start: StoredProfile | None
    furthest: float

    @property
    def text(self) -> bytes:
        """The same in every process, and for equal keys alone."""
        effects = [(type(effect).__name__, to_plain(effect)) for effect in self.effects]
        start = None if self.start is None else to_plain(self.start)
        values = to_plain(self.calibration), to_plain(self.condition), effects, start, self.furthest
        return json.dumps([self.rig.text, *values]).encode()


@lru_cache(maxsize=KEPT_MODELS)
def _model(key: _Key, calibration: Calibration) -> Model:
    return Model.of(key.rig, calibration)


@lru_cache(maxsize=KEPT_MODELS)
def _extended(key: _Key, calibration: Calibration, effects: tuple[Effect, ...]) -> Model:
    return extend(_model(key, calibration), effects)


def _calibration(rig: Rig, memory: Memory) -> Calibration:
    return Calibration.prior(rig) if memory.fit is None else memory.fit.calibration


def _path_key(rig: Rig, memory: Memory, segment: Segment, furthest: float | None = None) -> PathKey:
    """The wear from a segment's start on, under its condition and with the effects that are there at its start."""
    there = memory.wearing(segment.start_revolutions)
    return PathKey(
        rig=_Key(rig),
        calibration=_calibration(rig, memory),
        effects=tuple(e for e in there if e.period == "mesh" and e.facts.acts_on != "sensor"),
        condition=Condition(speed_hz=segment.speed_hz, torque=segment.torque),
        start=segment.start_profile,
        furthest=CURVES.beyond * rig.get("end_of_life.max_depth", CURVES.deepest) if furthest is None else furthest,
    )


def _path(rig: Rig, memory: Memory, segment: Segment, furthest: float | None = None) -> WearPath:
    """The path of such a key."""
    key = _path_key(rig, memory, segment, furthest)

    def make(kept: KeptPoints | None) -> WearPath:
        model, stored = _extended(key.rig, key.calibration, key.effects), key.start
        start = model.unworn if stored is None else stored.on(WornProfile.unworn(model.mesh.pair))
        return WearPath(model, key.condition, start, key.furthest, kept=kept)

    return PATHS.get(key, make)


def path_at_hand(rig: Rig, memory: Memory) -> tuple[PathKey, WearPath] | None:
    """The path of the present segment with its key, where this process has it."""
    if not memory.segments:
        return None
    key = _path_key(rig, memory, memory.segments[-1])
    path = PATHS.find(key)
    return None if path is None else (key, path)


def deepest(rig: Rig, depth: float) -> float:
    """Depth to which the curve of a machine worn to `depth` [m] is searched [m]."""
    end = rig.get("end_of_life.max_depth", CURVES.deepest)
    return end if depth < CURVES.near_end * end else CURVES.beyond * end


def model_of(rig: Rig, memory: Memory, revolutions: float = 0.0) -> Model:
    """The model with what is calibrated so far and the effects that are there after so many turns of the pinion.

    NotAvailable where the rig file does not suffice.
    """
    return _extended(_Key(rig), _calibration(rig, memory), memory.active(revolutions))


def curve_of(rig: Rig, memory: Memory) -> MasterCurve:
    """The master curve of the present segment, searched to the rig's end of life, or beyond where that is near."""
    return MasterCurve(path=_path(rig, memory, memory.segments[-1]), limit=deepest(rig, memory.depth))


def curve_under(rig: Rig, memory: Memory, condition: Condition) -> MasterCurve:
    """The wear curve of new flanks under another condition, with the effects that are there now."""
    now = max(memory.track.revolutions, memory.segments[-1].start_revolutions)
    segment = Segment(
        speed_hz=condition.speed_hz, torque=condition.torque, start_depth=0.0, start_work=0.0, start_revolutions=now
    )
    return MasterCurve(path=_path(rig, memory, segment), limit=deepest(rig, memory.depth))


def start_of_curve(rig: Rig, memory: Memory) -> MasterCurve:
    """The first point of the present segment's curve alone: its lines are held at any depth."""
    return MasterCurve(path=_path(rig, memory, memory.segments[-1], 0.0), limit=0.0)


def profile_of(rig: Rig, memory: Memory, revolutions: float, depth: float) -> WornProfile:
    """The flanks at a depth [m] as they had worn after so many turns of the pinion: of that time's segment.

    Where the time lies before the segments that are kept, or the depth before the segment's start, the profile at that
    start is scaled to the depth.
    """
    passed = [s for s in memory.segments if s.start_revolutions <= revolutions] or list(memory.segments[:1])
    curve = MasterCurve(path=_path(rig, memory, passed[-1]), limit=deepest(rig, memory.depth))
    start = curve.start_depth
    if depth >= start or start == 0.0 or passed[-1] is not memory.segments[0]:
        return curve.profile(max(depth, start))
    whole = curve.profile(start)
    return WornProfile(positions=whole.positions, depth=whole.depth * (depth / start), active=whole.active)


def nominal_model_of(rig: Rig) -> Model:
    """The rig file's model, before any calibration."""
    return _model(_Key(rig), Calibration.prior(rig))


def healthy_model_of(rig: Rig, memory: Memory) -> Model:
    """The calibrated model without any effect."""
    return _model(_Key(rig), _calibration(rig, memory))
