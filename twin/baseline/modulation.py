"""Modulation of the mesh by a shaft against that of the healthy machine: its depth in every recording of a baseline."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from math import sqrt

from twin.assessment import Modulation
from twin.baseline.learned import Baseline
from twin.baseline.reading import ChannelLines, WindowReading
from twin.baseline.repeats import MODULATION
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


def against_baseline(
    found: Iterable[Modulation], baseline: Baseline, limits: NewModulationThresholds = DEFAULT
) -> tuple[Modulation, ...]:
    """The modulations with the range that the baseline's recordings show, and whether they are new."""
    return tuple(_compared(one, baseline, limits) for one in found)


def _compared(one: Modulation, baseline: Baseline, limits: NewModulationThresholds) -> Modulation:
    teeth = baseline.rig.teeth
    depths = [
        depth_of(partial(_line, reading.channels[one.sensor], teeth, reading.period), one.shaft, one.multiple)
        for reading in baseline.readings
        if one.sensor in reading.channels
    ]
    if not depths:
        return one
    most = max(depths)
    new = over_of(one.depth, most, limits) > baseline.repeats.factor(MODULATION, one.sensor)
    return replace(one, healthy=(min(depths), most), new=new)


def over_of(depth: float, most: float, limits: NewModulationThresholds = DEFAULT) -> float:
    """A depth over the limit from which it is new, where healthy recordings reach a depth at most."""
    return depth / max(limits.ratio * most, most + limits.more)


def deepest_over(reading: WindowReading, baseline: Baseline, sensor: str) -> float:
    """The modulation of one sensor that is most over its limit, by the lines of a reading."""
    teeth = baseline.rig.teeth
    known = [_depths(r, sensor, teeth) for r in baseline.readings if sensor in r.channels]
    here = _depths(reading, sensor, teeth)
    return max(over_of(depth, max((d[i] for d in known), default=0.0)) for i, depth in enumerate(here))


@lru_cache(maxsize=4096)  # of the same recordings, beside baselines of all others of them
def _depths(reading: WindowReading, sensor: str, teeth: tuple[int, int]) -> tuple[float, ...]:
    """Depth of every modulation of one sensor."""
    read = partial(_line, reading.channels[sensor], teeth, reading.period)
    return tuple(depth_of(read, shaft, n) for shaft in ("pinion", "gear") for n in MULTIPLES)


def _line(lines: ChannelLines, teeth: tuple[int, int], period: int, key: Key) -> Line | None:
    """One line of a reading; None where it was not read."""
    i = round(order_of(key, teeth) * period) - 1
    if not 0 <= i < lines.lines.size:
        return None
    return complex(lines.lines[i]), sqrt(float(lines.floor[i]) / 2)
