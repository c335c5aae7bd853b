"""Bursts that strike an accelerometer and a torque meter at one moment: interference by the cables.

    p(b)   mean square of x_i − x_{i−1} over blocks of BLOCK, over its median over the window
    burst  p > limit in both channels, in the same or the next block

What strikes the machine reaches both, too, but it comes by an angle: where bursts keep to one part of a turn of either
shaft, they are left to the search for effects. Bursts become gaps of both channels.

Source   K. V. Mardia, P. E. Jupp, Directional Statistics (2000), 6.3 (Rayleigh's test of a direction)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp

import numpy as np

from twin.instruments.seen import Seen, with_channels
from twin.thresholds import deciding
from twin.windows import Fault, Samples, Window


@dataclass(frozen=True, slots=True, kw_only=True)
class BurstThresholds:
    """When bursts came by the cables."""

    power: float = deciding(
        30.0, of="median power of the channel's differences", meaning="power of a burst",
        source="not derived: chosen; of a block of 20 values of noise once in 10^15",
    )  # fmt: skip
    most: float = deciding(
        0.05, of="window", meaning="time of all bursts together, above which they are no bursts",
        source="not derived: chosen",
    )  # fmt: skip
    fewest: int = deciding(
        3, unit="bursts", meaning="bursts that may keep to an angle", source="derivation: Rayleigh's test of three"
    )  # fmt: skip
    direction: float = deciding(
        0.005, meaning="probability of angles as much alike by chance, below which bursts keep to a part of a turn",
        source="convention: one in a hundred for both shafts together",
    )  # fmt: skip
    alike: float = deciding(
        0.9, meaning="mean resultant of the angles from which few bursts keep to one, too",
        source="derivation: within 0.45 rad of one another",
    )  # fmt: skip


DEFAULT = BurstThresholds()
BLOCK = 0.005  # [s]


def without_bursts(seen: Seen, limits: BurstThresholds = DEFAULT) -> Window:
    """The window with gaps where an accelerometer and the torque meter were struck together by no angle."""
    torques = {name: _struck(samples, limits) for name, samples in seen.window.torques.items()}
    if seen.track is None or not any(t.any() for t in torques.values()):
        return seen.window
    accelerations, faults, gone = {}, [], {}
    for name, samples in seen.window.accelerations.items():
        own = _struck(samples, limits)
        for shaft, other in torques.items():
            both = _together(own, other)
            if both.any() and own.mean() <= limits.most and not _keeps_to_an_angle(seen, both, limits):
                accelerations[name] = _without(samples, _together(both, own))
                gone[shaft] = other
                detail = f"bursts at the same moments as in torque/{shaft}, at no angle of a shaft: taken out of both"
                count = int(np.count_nonzero(np.diff(np.concatenate(([0], both.astype(int)))) == 1))
                faults.append(
                    Fault(kind="interference", channel=f"accel/{name}", count=count, action="repaired", detail=detail)
                )
    if not accelerations:
        return seen.window
    cleaned = {shaft: _without(seen.window.torques[shaft], struck) for shaft, struck in gone.items()}
    window = with_channels(seen.window, accelerations, faults)
    return replace(window, torques={**window.torques, **cleaned})


def _struck(samples: Samples, limits: BurstThresholds) -> np.ndarray:
    """Whether a channel shows a burst in each block (m,)."""
    size = max(2, round(BLOCK * samples.rate))
    steps = np.diff(samples.values)
    rows = np.where(np.isfinite(steps), steps, 0.0)[: steps.size // size * size].reshape(-1, size)
    power = (rows**2).mean(axis=1)
    usual = float(np.median(power)) if power.size else 0.0
    return np.asarray(power > limits.power * usual) if usual > 0 else np.zeros(power.size, dtype=bool)


def _wider(struck: np.ndarray) -> np.ndarray:
    """With the blocks beside."""
    return np.convolve(struck, np.ones(3), "same") > 0


def _together(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Blocks of one that are struck where the other is, or beside (m,)."""
    n = min(a.size, b.size)
    return np.asarray(a[:n] & _wider(b[:n].astype(float)))


def _keeps_to_an_angle(seen: Seen, struck: np.ndarray, limits: BurstThresholds) -> bool:
    """Whether bursts keep to a part of a turn of a shaft, or are too few to tell."""
    assert seen.track is not None
    begins = np.flatnonzero(np.diff(np.concatenate(([0], struck.astype(int)))) == 1)
    times = (begins + 0.5) * BLOCK
    first, last = seen.track.ends
    times = times[(times > first) & (times < last)]
    if times.size < limits.fewest:
        return True
    angle = np.array([seen.track.angle_at(float(t)) for t in times])
    z1, z2 = seen.rig.teeth
    for order in (1.0, z1 / z2):
        length = float(np.abs(np.exp(1j * order * angle).mean()))
        if length > limits.alike or exp(-times.size * length**2) < limits.direction:
            return True
    return False


def _without(samples: Samples, struck: np.ndarray) -> Samples:
    """The samples with bursts and the blocks beside them lost."""
    size = max(2, round(BLOCK * samples.rate))
    lost = np.repeat(_wider(struck.astype(float)), size)[: samples.values.size]
    values = samples.values.copy()
    values[: lost.size][lost] = np.nan
    return replace(samples, values=values)
