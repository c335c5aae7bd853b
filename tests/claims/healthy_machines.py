"""Machines made of plain formulas, independent of the twin: what a healthy baseline is learned from and compared with.

    x(t) = Σ_k A_k·(1 + τ(θ))·cos(k·z1·θ + φ_k + τ(θ)/3) + run-out + noise

τ  what single teeth of both gears add, the same in every recording unless the pattern of the teeth does not repeat
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.rig import Rig
from twin.windows import Samples, Window

DAY_NS = 86_400_000_000_000
PAIRS = ((20, 30), (18, 45), (24, 40), (21, 35), (20, 36), (17, 34), (19, 57), (26, 39), (22, 55), (20, 48))


@dataclass(frozen=True, kw_only=True)
class Machine:
    """One gearbox with accelerometers."""

    seed: int
    gears: int = 0  # which gears are in it: others have teeth of their own
    repeats: bool = True  # whether recordings show the same pattern of the teeth
    foreign_hz: float | None = None  # a modulation of the mesh that no shaft makes, also of the healthy machine
    rail: float | None = None  # of the last axis [m/s²]
    axes: int = 2
    rate: float = 5000.0
    seconds: float = 4.0

    @property
    def teeth(self) -> tuple[int, int]:
        return PAIRS[self.seed % len(PAIRS)]

    @property
    def speed_hz(self) -> float:
        return float(np.random.default_rng((self.seed, 1)).uniform(24, 32))

    @property
    def rig(self) -> Rig:
        pinion, gear = self.teeth
        return Rig.from_mapping({
            "gears": {"pinion": {"teeth": pinion}, "gear": {"teeth": gear}},
            "operating": {"pinion_speed_hz": self.speed_hz},
        })  # fmt: skip

    def window(self, recording: int, *, fault: str | None = None, size: float = 1.0, part: int = 0) -> Window:
        """One window of a recording, of one day each; `part` numbers windows of one recording.

        fault  impact (once a turn of the pinion), level, noise, or a modulation (foreign)
        """
        own, now = np.random.default_rng((self.seed, 2)), np.random.default_rng((self.seed, 3, recording, part))
        day = np.random.default_rng((self.seed, 4, recording))  # what windows of one recording share
        pinion, gear = self.teeth
        t = np.arange(int(self.seconds * self.rate)) / self.rate
        speed = self.speed_hz * (1 + 0.0005 * day.normal())
        turns = speed * t + now.uniform(0, gear)
        level = np.exp(0.04 * day.normal())
        patterns = np.random.default_rng((self.seed, 5, self.gears)) if self.repeats else day
        τ = 0.1 * (
            _of_teeth(patterns.normal(size=pinion), turns)
            + _of_teeth(patterns.normal(size=gear), turns * pinion / gear)
        )
        phase_of_foreign = now.uniform(0, 2 * np.pi)
        out = {}
        for axis in range(self.axes):
            x = 0.2 * np.cos(2 * np.pi * turns + own.uniform(0, 6)) if self.repeats else np.zeros(t.size)
            for k in range(1, 5):
                x += (
                    own.uniform(0.4, 1.5)
                    / k
                    * (1 + τ)
                    * np.cos(2 * np.pi * k * pinion * turns + own.uniform(0, 6) + τ / 3)
                )
            if self.foreign_hz is not None:
                x *= 1 + 0.25 * np.cos(2 * np.pi * self.foreign_hz * t + phase_of_foreign)
            x += 0.3 * now.normal(size=t.size)
            x = level * _with_fault(x, fault, size, turns, t, now)
            if self.rail is not None and axis == self.axes - 1:
                x = np.clip(x, -self.rail, self.rail)
            out[f"a{axis}"] = Samples(start=0.0, rate=self.rate, values=x)
        start = recording * DAY_NS + part * 60_000_000_000
        return Window(start_time_ns=start, accelerations=out)


def _of_teeth(each: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """What single teeth add, evenly from one to the next."""
    return np.interp(turns % 1 * each.size, np.arange(each.size + 1), np.append(each, each[0]))


def _with_fault(x: np.ndarray, fault: str | None, size: float, turns: np.ndarray, t: np.ndarray, rng) -> np.ndarray:
    if fault == "impact":
        struck = np.zeros(t.size)
        struck[np.flatnonzero(np.diff(np.floor(turns)))] = 6 * size
        τ = t[t < 0.01]
        return x + np.convolve(struck, np.exp(-600 * τ) * np.sin(2 * np.pi * 1500 * τ))[: t.size]
    if fault == "level":
        return x * (1 + 0.6 * size)
    if fault == "noise":
        return x + 0.9 * size * rng.normal(size=t.size)
    if fault == "foreign":
        return x * (1 + 0.4 * size * np.cos(2 * np.pi * 7.31 * t))
    return x
