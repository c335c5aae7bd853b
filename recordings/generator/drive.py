"""What drives and brakes the machine: set speed, load, and the blows of a damaged bearing, on the time grid.

Speed and torque differ a little from window to window and wander slowly within one (an Ornstein-Uhlenbeck
process). The motor is a torque source under speed control; the brake only brakes.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

BLOW_SECONDS = 0.3e-3  # of one blow in a damaged bearing


def wander(rng: np.random.Generator, n: int, dt: float, spread: float, time_constant: float) -> np.ndarray:
    """A slow stationary random process of the given standard deviation; (n,)."""
    coarse = max(1, int(time_constant / 50 / dt))
    m = n // coarse + 3
    keep = np.exp(-coarse * dt / time_constant)
    noise = rng.normal(0, 1, m)
    noise[1:] *= np.sqrt(1 - keep**2)
    slow = lfilter([1.0], [1.0, -keep], noise)
    return spread * np.interp(np.arange(n) / coarse, np.arange(m), slow)


def blows(rng: np.random.Generator, n: int, dt: float, force: float, rate: float, slip: float, rise: float = 0.0):
    """Half-sine blows [N] at a mean rate [Hz], every interval off by the relative slip; (n,).

    The rate rises by a share of its mean from start to end.
    """
    out = np.zeros(n)
    if force == 0 or rate == 0:
        return out
    count = int(n * dt * rate * 1.2) + 10
    times = np.cumsum((1 + slip * rng.normal(0, 1, count)) / rate) - rng.uniform(0, 1) / rate
    if rise:
        t = dt * np.arange(n)
        times = np.interp(times, t * (1 + rise / 2 * (t / t[-1] - 1)), t, left=-1.0)
    width = max(2, int(BLOW_SECONDS / dt))
    shape = np.sin(np.pi * (np.arange(width) + 0.5) / width)
    for t in times[times >= 0]:
        i = int(t / dt)
        if i + width > n:
            break
        out[i : i + width] += force * shape
    return out
