"""One measurement window: what the channels of one machine recorded during one stretch of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

SHAFTS = ("pinion", "gear")


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """Evenly sampled values of one channel, without a gap.

    A repaired or lost stretch holds NaN, so that index and time stay tied to each other.
    """

    rate: float  # [Hz]
    start: float  # time of the first sample after the window's start [s]
    values: np.ndarray  # (n,) float64, in the channel's unit (m/s², N·m)

    @property
    def times(self) -> np.ndarray:
        """Time of each sample after the window's start [s], (n,)."""
        return self.start + np.arange(self.values.size) / self.rate

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return self.values.size / self.rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Edges:
    """The times at which the edges of one shaft encoder passed.

    Edge number `first_index + k` passed at `times[k]`; a lost edge holds NaN.
    `first_index / per_rev` is the shaft's absolute revolution count since the gears were new.
    """

    per_rev: int
    first_index: int
    times: np.ndarray  # (n,) float64, after the window's start, rising [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowValue:
    """What a slowly varying quantity was in a window: the summary of its values there, else the last known one."""

    value: float  # in SI units
    count: int  # of values in the window; 0 where the value is an older one
    age: float  # of the newest value at the window's end [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """Something wrong with a window's data, and what was done about it."""

    kind: str  # gap, duplicate, disorder, nan, clipping, rate_change, missing_channel, reversed, ...
    channel: str  # accel/y6, torque/pinion, encoder/gear, ...
    count: int  # frames, samples or edges concerned
    action: str  # repaired, degraded, refused, none
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """All channels of one machine over one stretch of time, on one clock that starts at `start_time_ns`."""

    start_time_ns: int  # Unix time of the window's start [ns]
    accelerations: Mapping[str, Samples] = field(default_factory=dict)  # by sensor
    torques: Mapping[str, Samples] = field(default_factory=dict)  # by shaft
    encoders: Mapping[str, Edges] = field(default_factory=dict)  # by shaft
    slow: Mapping[str, SlowValue] = field(default_factory=dict)  # slowly varying quantities, by channel label
    faults: tuple[Fault, ...] = ()
    quality: str = "good"  # good, repaired, degraded, refused

    @property
    def duration(self) -> float:
        """Time from the window's start to the last thing recorded in it [s]."""
        ends = [s.start + s.duration for s in (*self.accelerations.values(), *self.torques.values())]
        ends += [float(e.times[-1]) for e in self.encoders.values() if e.times.size]
        return max(ends, default=0.0)
