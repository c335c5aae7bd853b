"""Faults of the instruments themselves: a loose accelerometer, a clock that is off, lines of an encoder's disc."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba as nb
import numpy as np
from scipy.interpolate import CubicSpline


@nb.njit(cache=True)
def held(acceleration, dt, frequency, damping_ratio, hold):
    """What an accelerometer feels on a contact that can open: a mass on a spring that does not pull.

    x'' = −a − 2ζω·x' − min(ω²·x, hold): x is its place against the housing, and `hold` [m/s²] the force that presses
    it on over its mass, from which on it lifts off. It feels a + x''. frequency (n,) [Hz]; (n,) → (n,).
    """
    out = np.empty(acceleration.size)
    x, v = 0.0, 0.0
    for step in range(acceleration.size):
        a0 = acceleration[step]
        a1 = acceleration[min(step + 1, acceleration.size - 1)]
        ω = 2 * np.pi * frequency[step]
        kx, kv, total_x, total_v = 0.0, 0.0, 0.0, 0.0
        for stage in range(4):
            h = 0.0 if stage == 0 else (dt if stage == 3 else 0.5 * dt)
            at, speed = x + h * kx, v + h * kv
            base = a0 + h / dt * (a1 - a0)
            pull = -2 * damping_ratio * ω * speed - min(ω * ω * at, hold)
            kx, kv = speed, pull - base
            weight = 1.0 if stage == 0 or stage == 3 else 2.0
            total_x += weight * kx
            total_v += weight * kv
            if stage == 0:
                out[step] = pull
        x += dt / 6.0 * total_x
        v += dt / 6.0 * total_v
    return out


@dataclass(frozen=True, slots=True)
class LooseAccelerometer:
    """An accelerometer whose stud has come loose: every window finds it otherwise, and it rattles where it is loud."""

    frequency: float  # of the contact, highest [Hz]
    damping_ratio: float
    hold: float  # acceleration at which it lifts off [m/s²]
    spread: float  # share by which frequency, hold and gain fall short, from window to window and within

    def __call__(self, acceleration: np.ndarray, dt: float, rng: np.random.Generator) -> np.ndarray:
        """(n,) [m/s²] → (n,)."""
        start, stop, press, gain = 1 - self.spread * rng.uniform(0, 1, 4)
        frequency = self.frequency * np.linspace(start, stop, acceleration.size)
        return gain * held(acceleration, dt, frequency, self.damping_ratio, press * self.hold)


@dataclass(frozen=True, slots=True)
class Clock:
    """The accelerometer's clock is not the encoders': its samples are of a moment so much later."""

    shift: float = 0.0  # [s]
    drift: float = 0.0  # [s/s]

    def at(self, elapsed: float) -> float:
        """How much later its samples are, `elapsed` [s] into the campaign [s]."""
        return self.shift + self.drift * elapsed

    def __call__(self, values: np.ndarray, dt: float, elapsed: float) -> np.ndarray:
        """(n,) values at even steps as that clock would have it, `elapsed` [s] into the campaign; (n,)."""
        if not self.shift and not self.drift:
            return values
        t = dt * np.arange(values.size)
        at = t + self.shift + self.drift * (elapsed + t)
        return CubicSpline(t, values)(np.clip(at, t[0], t[-1]))


@dataclass(frozen=True, slots=True)
class DiscLine:
    """One line of an encoder's disc that is not seen, or seen twice, in a share of its turns."""

    line: int
    twice: bool
    share: float
    counted_from: float  # turns of the shaft

    def __call__(self, first: int, times: np.ndarray, per_rev: int, rng: np.random.Generator):
        """Number of the first edge and the edges' times [s] as the counter has them."""
        number = first + np.arange(times.size)
        struck = (number - self.line) % per_rev == 0
        struck &= rng.uniform(0, 1, times.size) < self.share
        before = _lines(first, self.line, per_rev) - _lines(round(self.counted_from * per_rev), self.line, per_rev)
        off = round(self.share * max(before, 0))
        if not self.twice:
            return first - off, times[~struck]
        where = np.flatnonzero(struck[:-1])
        extra = times[where] + 0.3 * (times[where + 1] - times[where])
        return first + off, np.insert(times, where + 1, extra)


def _lines(below: int, line: int, per_rev: int) -> int:
    """How often a line of the disc passed among the edges 0 … below − 1."""
    return (below - line + per_rev - 1) // per_rev


def seen(first: int, times: np.ndarray, per_rev: int, faults: Sequence[DiscLine], rng: np.random.Generator):
    """Edges after all faults of their disc."""
    for fault in faults:
        first, times = fault(first, times, per_rev, rng)
    return first, times
