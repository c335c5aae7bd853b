"""Modulation of the mesh by a shaft against that of the healthy machine: its depth in every recording of a baseline.

    limit = max(q·d_max, d_max + Δ, d̄ + t·s·√(1 + 1/n))

d   depth in each of n healthy recordings, or what the noise may hide where none is seen; s² its variance, half of it
    that of all modulations of the sensor, so that t has 2·(n − 1) degrees of freedom, as all of them come from the same
    recordings; at its share of the false alarms of a comparison (repeats.py)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from math import sqrt

import numpy as np
from scipy.special import stdtrit

from twin.assessment import Modulation
from twin.baseline.learned import Baseline
from twin.baseline.reading import ChannelLines, WindowReading
from twin.baseline.repeats import MODULATION, share_of
from twin.features.lines import order_of
from twin.features.modulation import MULTIPLES, Line, depth_of
from twin.features.window_features import Key
from twin.thresholds import deciding


@dataclass(frozen=True, slots=True, kw_only=True)
class NewModulationThresholds:
    """When a modulation is deeper than that of the healthy machine."""

    ratio: float = deciding(
        1.5,
        of="deepest in the baseline",
        meaning="depth from which a modulation is new",
        source="set above 1.34, the largest ratio of a healthy recording to the six others of the broken-tooth set "
        "(every channel, shaft and multiple); broken teeth reach 1.33 to 1.74",
    )
    more: float = deciding(
        0.04,
        meaning="how much deeper it must be, too",
        source="ModulationThresholds.least_amplitude",
    )


DEFAULT = NewModulationThresholds()
SHAFTS = ("pinion", "gear")


def against_baseline(
    found: Iterable[Modulation], baseline: Baseline, limits: NewModulationThresholds = DEFAULT
) -> tuple[Modulation, ...]:
    """The modulations with the range that the baseline's recordings show, and whether they are new."""
    return tuple(_compared(one, baseline, limits) for one in found)


def _compared(one: Modulation, baseline: Baseline, limits: NewModulationThresholds) -> Modulation:
    known = _known(baseline, one.sensor)
    if not known.size:
        return one
    shown, bounds = known
    at = SHAFTS.index(one.shaft) * len(MULTIPLES) + MULTIPLES.index(one.multiple)
    over = one.depth / least_new(bounds, len(baseline.std), limits)[at]
    healthy = float(shown[:, at].min()), float(shown[:, at].max())
    return replace(one, healthy=healthy, new=bool(over > baseline.repeats.factor(MODULATION, one.sensor)))


def least_new(known: np.ndarray, sensors: int, limits: NewModulationThresholds = DEFAULT) -> np.ndarray:
    """Depths from which modulations of one of so many sensors are new, from the most of recordings; (n, m) → (m,)."""
    count, measures = known.shape
    most = known.max(axis=0)
    least = np.maximum(limits.ratio * most, most + limits.more)
    if count < 2:
        return least
    variance = known.var(axis=0, ddof=1)
    spread = np.sqrt(0.5 * (variance + variance.mean()) * (1 + 1 / count))
    t = float(-stdtrit(2 * (count - 1), share_of(sensors * measures)))
    return np.asarray(np.maximum(least, known.mean(axis=0) + t * spread))


def deepest_over(reading: WindowReading, baseline: Baseline, sensor: str) -> float:
    """The modulation of one sensor that is most over its limit, by the lines of a reading."""
    known = _known(baseline, sensor)
    depth, _, reported = np.array(_depths(reading, sensor, baseline.rig.teeth)).T
    return float(np.max(depth * reported / least_new(known[1], len(baseline.std)))) if known.size else 0.0


def _known(baseline: Baseline, sensor: str) -> np.ndarray:
    """Depth of every modulation of one sensor in the healthy recordings, and what it is at most (2, n, m)."""
    own = [r for r in baseline.readings if sensor in r.channels]
    found = np.array([_depths(r, sensor, baseline.rig.teeth) for r in own])
    return np.moveaxis(found[..., :2], 2, 0) if own else found


@lru_cache(maxsize=4096)  # of the same recordings, beside baselines of all others of them
def _depths(reading: WindowReading, sensor: str, teeth: tuple[int, int]) -> tuple[tuple[float, float, bool], ...]:
    """Every modulation of one sensor, by `depth_of`."""
    read = partial(_line, reading.channels[sensor], teeth, reading.period)
    return tuple(depth_of(read, shaft, n) for shaft in SHAFTS for n in MULTIPLES)


def _line(lines: ChannelLines, teeth: tuple[int, int], period: int, key: Key) -> Line | None:
    """One line of a reading; None where it was not read."""
    i = round(order_of(key, teeth) * period) - 1
    if not 0 <= i < lines.lines.size:
        return None
    return complex(lines.lines[i]), sqrt(float(lines.floor[i]) / 2)
