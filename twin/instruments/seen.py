"""What the checks of a window's instruments look at: mesh lines of every accelerometer against the encoder, by turns.

    c_k(b) = 2·mean of x(t)·exp(−i·k·z1·θ(t)) over turn b of the pinion
    τ      delay of x against θ: c_k(b) ~ exp(−i·ω_k·τ(b)),  ω_k = 2π·k·z1·f

Only harmonics that keep their phase from one turn to the next are used, which a delay that changes slowly, or seldom,
leaves alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi

import numpy as np

from twin.errors import TwinError
from twin.features.angle import AngleTrack
from twin.features.extract import pinion_angle
from twin.rig import Rig
from twin.thresholds import deciding
from twin.windows import Fault, Samples, Window

HARMONICS = 12  # of the mesh that are looked at
USABLE_RATE = 0.4  # of the sampling rate


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshPhaseThresholds:
    """Which mesh lines tell the delay of a channel."""

    coherent: float = deciding(
        0.6, meaning="coherence of a mesh line from one turn to the next, from which its phase is used",
        source="not derived: chosen; three jumps in 25 turns leave 0.75, noise of half a radian 0.78",
    )  # fmt: skip
    least_lines: int = deciding(
        3, meaning="mesh lines that must agree on a delay",
        source="derivation: of two, some delay within a mesh period explains any phases",
    )  # fmt: skip
    least_turns: int = deciding(
        8, unit="turns of the pinion", meaning="turns that a change of a delay needs", source="not derived: chosen"
    )  # fmt: skip
    steady: float = deciding(
        0.02, of="speed", meaning="standard deviation of the speed above which phases of the path move by themselves",
        source="not derived: resonances of the structure are some per cent wide",
    )  # fmt: skip


LIMITS = MeshPhaseThresholds()


@dataclass(frozen=True, eq=False, kw_only=True)
class MeshPhases:
    """Mesh lines of one channel in every turn."""

    phasors: np.ndarray  # (K, n)
    omega: np.ndarray  # (K,) [rad/s]
    starts: np.ndarray  # first sample of every turn, and the end of the last (n + 1,)
    times: np.ndarray  # middle of every turn after the channel's first sample (n,) [s]

    @cached_property
    def power(self) -> np.ndarray:
        """Σ |c|² of every line (K,)."""
        return np.asarray((np.abs(self.phasors) ** 2).sum(axis=1))


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """One window with the angle that its channels are held against."""

    rig: Rig
    window: Window

    @cached_property
    def track(self) -> AngleTrack | None:
        """The pinion's angle by an encoder; None where there is none, or the speed changes too much."""
        if not self.window.encoders or not self.rig.has("gears.pinion.teeth", "gears.gear.teeth"):
            return None
        try:
            track = pinion_angle(self.rig, self.window, {})
        except TwinError:
            return None
        return track if track.speed_variation <= LIMITS.steady else None

    def phases(self, samples: Samples, limits: MeshPhaseThresholds = LIMITS) -> MeshPhases | None:
        """The mesh lines of an accelerometer by turns; None where too few are clear."""
        track = self.track
        if track is None or not np.isfinite(samples.values).any():
            return None
        turns = np.arange(int(np.ceil(track.start / (2 * pi))), int(track.stop / (2 * pi)) + 1)
        starts = np.rint((track.time(2 * pi * turns.astype(float)) - samples.start) * samples.rate).astype(int)
        starts = starts[(starts >= 0) & (starts <= samples.values.size)]
        if starts.size <= limits.least_turns:
            return None
        inside = slice(starts[0], starts[-1])
        knots = np.linspace(track.start, track.stop, max(64, int(64 * track.turns)))
        angle = np.interp(samples.times[inside], track.time(knots), knots)
        x = samples.values[inside]
        x = np.where(np.isfinite(x), x - np.nanmean(x), 0.0)
        mesh = 2 * pi * self.rig.teeth[0] * track.speed
        count = min(HARMONICS, int(USABLE_RATE * samples.rate * 2 * pi / mesh))
        base, turned, rows = np.exp(-1j * self.rig.teeth[0] * angle), np.ones(x.size, dtype=complex), []
        for _ in range(count):
            turned = turned * base
            rows.append(2 * np.add.reduceat(x * turned, starts[:-1] - starts[0]) / np.diff(starts))
        c = np.array(rows).reshape(count, starts.size - 1)
        power = np.maximum((np.abs(c) ** 2).sum(axis=1), 1e-300)
        beside = np.abs((c[:, 1:] * c[:, :-1].conj()).sum(axis=1)) / power
        clear = np.flatnonzero(beside >= limits.coherent)
        if clear.size < limits.least_lines:
            return None
        middle = 0.5 * (starts[1:] + starts[:-1]) / samples.rate
        return MeshPhases(phasors=c[clear], omega=mesh * (clear + 1.0), starts=starts, times=middle)


def with_channels(window: Window, corrected: dict[str, Samples], faults: Iterable[Fault]) -> Window:
    """The window with some accelerometers corrected, and what was found among its faults."""
    accelerations = {**window.accelerations, **corrected}
    return replace(window, accelerations=accelerations, faults=(*window.faults, *faults))
