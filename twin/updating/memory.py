"""Memory of the twin between windows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from twin.effects.addition import Addition
from twin.effects.response import Effect
from twin.features.window_features import WindowFeatures
from twin.serial import Packed
from twin.updating.calibration import Fit
from twin.updating.joint_gauge import LineFactors
from twin.updating.rms_update import RmsTrack
from twin.updating.tracker import WearTrack
from twin.updating.wear_points import Points
from twin.wear.profile import WornProfile

Line = tuple[float, float, complex, float]  # window, frequency [Hz], factor, std
Lines = Annotated[tuple[Line, ...], Packed("f8,f8,c16,f8")]
MOST_LINES = 200  # of each learned factor: some sixteen windows
KEPT_SEGMENTS = 4  # the present one, and those before it that recent windows may lie in


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredProfile:
    """A worn profile's depths, exact and hashable."""

    shape: tuple[int, ...]  # (p,) or (slices, p)
    data: bytes  # combined depths, little-endian doubles in C order [m]

    @classmethod
    def of(cls, profile: WornProfile) -> StoredProfile:
        return cls(shape=profile.depth.shape, data=profile.depth.astype("<f8").tobytes())

    def on(self, unworn: WornProfile) -> WornProfile:
        """The profile on the grid of new flanks of the same pair."""
        depth = np.frombuffer(self.data, dtype="<f8").reshape(self.shape).astype(float)
        return WornProfile(positions=unworn.positions, depth=depth, active=unworn.active)


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """A stretch of the campaign under one operating condition, with one set of effects."""

    speed_hz: float
    torque: float
    start_depth: float  # largest combined depth at its start [m]
    start_work: float  # x at its start [rad/N]
    start_revolutions: float = 0.0  # pinion turns at its start
    start_profile: StoredProfile | None = None  # None: new flanks


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanOffset:
    """Offset c of the encoder discs' zeros against each other, as learned so far."""

    value: float  # [m]
    var: float  # [m²]
    torque: float  # mean torque of the windows it was learned from [N·m]


@dataclass(frozen=True, slots=True, kw_only=True)
class RatePrior:
    """What is known of the wear rate of a pair before its first worn window."""

    rate: float  # κ [rad/N per revolution]
    std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Memory:
    """The twin's memory of one machine."""

    fit: Fit | None = None
    compliance_scale: float = 1.0  # measured over predicted mean transmission error per torque
    unworn: tuple[WindowFeatures, ...] = ()  # windows that the calibration rests on
    unworn_before: int = 0  # how many of them, from the first, are of other gears or of other zeros of the encoders
    zero_std: float = 0.0  # of the depth at which unworn flanks are seen: shared by all depths measured from them [m]
    depth: float = 0.0  # of the latest measurement window, by the method in use [m]
    half_width_from: float = 0.0  # depth at which the half-width was fitted [m], 0 before
    segments: tuple[Segment, ...] = ()
    prior: RatePrior | None = None  # by the pair before; None: the rig file's
    track: WearTrack = field(default_factory=lambda: WearTrack.unworn(0.0))  # from the encoders
    rms_track: RmsTrack = field(default_factory=RmsTrack)
    phase: float | None = None  # mesh phase against the encoder's zero [rad]
    phase_std: float = 3.0
    discs_since_ns: int = 0  # when the pinion's disc was last seen to have been turned [Unix ns]
    offset: MeanOffset | None = None
    line_factors: LineFactors | None = None  # of a machine whose structure is an estimate
    path: Lines = ()
    mesh: Lines = ()
    updates: int = 0
    points: Points = ()  # wear by the encoders at the windows that the track rests on
    rms_points: Points = ()  # the same by the RMS alone
    effects: tuple[Addition, ...] = ()  # effects that the twin has in addition to wear

    def active(self, revolutions: float) -> tuple[Effect, ...]:
        """The effects that are there after so many turns of the pinion."""
        return tuple(effect for a in self.effects if (effect := a.at(revolutions)) is not None)

    def wearing(self, revolutions: float) -> tuple[Effect, ...]:
        """The effects under which the flanks wear after so many turns: they change where a segment begins only."""
        return tuple(effect for a in self.effects if (effect := a.wearing(revolutions)) is not None)


def with_lines(learned: tuple[Line, ...], new: list[Line]) -> tuple[Line, ...]:
    """The learned lines with new ones, the oldest dropped beyond MOST_LINES."""
    return (*learned, *new)[-MOST_LINES:]
