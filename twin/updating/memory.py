"""Memory of the twin between windows: plain data, and its translation to and from JSON."""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from twin.effects.addition import Addition
from twin.effects.response import Effect
from twin.features.window_features import WindowFeatures
from twin.model import Calibration
from twin.updating.calibration import Fit
from twin.updating.joint_gauge import LineFactors
from twin.updating.rms_update import RmsTrack
from twin.updating.tracker import WearTrack
from twin.updating.wear_points import Points, WearPoint
from twin.wear.profile import WornProfile

Line = tuple[float, float, complex, float]  # window, frequency [Hz], factor, std
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

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        return {"shape": list(self.shape), "data": b64encode(self.data).decode("ascii")}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> StoredProfile:
        return cls(shape=tuple(data["shape"]), data=b64decode(data["data"]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """A stretch of the campaign under one operating condition, with one set of effects."""

    speed_hz: float
    torque: float
    start_depth: float  # largest combined depth at its start [m]
    start_work: float  # x at its start [rad/N]
    start_revolutions: float = 0.0  # pinion turns at its start
    start_profile: StoredProfile | None = None  # None: new flanks

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        profile = self.start_profile
        return {
            "speed_hz": self.speed_hz,
            "torque": self.torque,
            "start_depth": self.start_depth,
            "start_work": self.start_work,
            "start_revolutions": self.start_revolutions,
            "start_profile": None if profile is None else profile.to_dict(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Segment:
        profile = data["start_profile"]
        return cls(**{**data, "start_profile": None if profile is None else StoredProfile.from_dict(profile)})


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
    path: tuple[Line, ...] = ()
    mesh: tuple[Line, ...] = ()
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

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        return {
            "fit": None if self.fit is None else {**asdict(self.fit), "calibration": self.fit.calibration.to_dict()},
            "compliance_scale": self.compliance_scale,
            "unworn": [w.to_dict() for w in self.unworn],
            "unworn_before": self.unworn_before,
            "zero_std": self.zero_std,
            "depth": self.depth,
            "half_width_from": self.half_width_from,
            "segments": [s.to_dict() for s in self.segments],
            "prior": None if self.prior is None else asdict(self.prior),
            "track": self.track.to_dict(),
            "rms_track": self.rms_track.to_dict(),
            "phase": self.phase,
            "phase_std": self.phase_std,
            "discs_since_ns": self.discs_since_ns,
            "offset": None if self.offset is None else asdict(self.offset),
            "line_factors": None if self.line_factors is None else self.line_factors.to_dict(),
            "path": [[j, f, ρ.real, ρ.imag, σ] for j, f, ρ, σ in self.path],
            "mesh": [[j, f, ρ.real, ρ.imag, σ] for j, f, ρ, σ in self.mesh],
            "updates": self.updates,
            "points": [asdict(p) for p in self.points],
            "rms_points": [asdict(p) for p in self.rms_points],
            "effects": [a.to_dict() for a in self.effects],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Memory:
        if not data:
            return cls()
        fit = data["fit"]
        if fit is not None:
            fit = Fit(**{**fit, "calibration": Calibration.from_dict(fit["calibration"])})
        return cls(
            fit=fit,
            compliance_scale=data["compliance_scale"],
            unworn=tuple(WindowFeatures.from_dict(w) for w in data["unworn"]),
            unworn_before=data["unworn_before"],
            zero_std=data["zero_std"],
            depth=data["depth"],
            half_width_from=data["half_width_from"],
            segments=tuple(Segment.from_dict(s) for s in data["segments"]),
            prior=RatePrior(**data["prior"]) if data["prior"] else None,
            track=WearTrack.from_dict(data["track"]),
            rms_track=RmsTrack.from_dict(data["rms_track"]),
            phase=data["phase"],
            phase_std=data["phase_std"],
            discs_since_ns=data["discs_since_ns"],
            offset=None if data["offset"] is None else MeanOffset(**data["offset"]),
            line_factors=None if data["line_factors"] is None else LineFactors.from_dict(data["line_factors"]),
            path=tuple((j, f, complex(re, im), σ) for j, f, re, im, σ in data["path"]),
            mesh=tuple((j, f, complex(re, im), σ) for j, f, re, im, σ in data["mesh"]),
            updates=data["updates"],
            points=tuple(WearPoint(**p) for p in data["points"]),
            rms_points=tuple(WearPoint(**p) for p in data["rms_points"]),
            effects=tuple(Addition.from_dict(a) for a in data["effects"]),
        )


def with_lines(learned: tuple[Line, ...], new: list[Line]) -> tuple[Line, ...]:
    """The learned lines with new ones, the oldest dropped beyond MOST_LINES."""
    return (*learned, *new)[-MOST_LINES:]
