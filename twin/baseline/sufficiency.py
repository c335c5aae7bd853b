"""What a healthy baseline suffices for, and what cannot be judged with it yet.

Two things make a baseline thin. The scatter of its lines is what recordings miss of one another: with few of them it is
known poorly, a fault has to be very large to be seen, and what it does to several sensors may pass for changed sensors.
And where all recordings were made at one load and speed, what differs at another may be the load.

Holds    for the number of recordings as for that of their operating points: recordings at one point show its scatter
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import isfinite

import numpy as np

from twin.assessment import BaselineSufficiency, Compared, LeftOut, NotJudged
from twin.baseline.learned import Baseline
from twin.baseline.operating import DEFAULT as OPERATING
from twin.baseline.operating import UNITS
from twin.baseline.repeats import (
    BY_PATTERN,
    EXCHANGED,
    IMPACTS,
    LINES,
    MISFIT,
    MODULATION,
    NOISE,
    OFF_LINES,
    PATHS,
    PATTERN,
    RAW,
    SPACINGS,
)
from twin.baseline.repeats import DEFAULT as REPEATS
from twin.thresholds import deciding

BY_CHANNEL = (LINES, PATHS, OFF_LINES, NOISE, MODULATION)  # what is compared in every channel by itself
TOGETHER = (EXCHANGED, MISFIT, IMPACTS, SPACINGS, RAW)
RATED_LOAD = "operating.input_torque"  # of the rig file


@dataclass(frozen=True, slots=True, kw_only=True)
class SufficiencyLimits:
    """What a baseline must have before a kind of change can be judged with it."""

    least_recordings: int = deciding(
        5, meaning="healthy recordings from which a change of single teeth can be judged",
        source="broken-tooth set, every baseline of so many of its seven loads: with four, 4 of 35 baselines miss the "
        "shaft behind the pair, and the fault is found in 177 of 203 cases at or between the learned loads; with five, "
        "none does, and it is found in 132 of 133",
    )  # fmt: skip
    same_speed: float = deciding(
        0.002, of="mean speed", meaning="range of the recordings' speeds up to which they are one speed",
        source="not derived: a tenth of the usual slip of an induction motor at full load",
    )  # fmt: skip


LIMITS = SufficiencyLimits()


def sufficiency_of(baseline: Baseline, limits: SufficiencyLimits = LIMITS) -> BaselineSufficiency:
    """What a baseline suffices for."""
    return BaselineSufficiency(
        recordings=baseline.counted.recordings,
        recordings_needed=limits.least_recordings,
        load=load_range(baseline),
        not_judged=tuple(_not_judged(baseline, limits)),
        windows=baseline.counted.windows,
        days=baseline.counted.days,
        loads=baseline.counted.loads,
    )


def _not_judged(baseline: Baseline, limits: SufficiencyLimits) -> Iterator[NotJudged]:
    thin = thin_for_teeth(baseline, limits)
    if thin is not None:
        yield NotJudged(what="single teeth", reason=thin)
        yield NotJudged(
            what="changes of a sensor or its mount",
            reason="a fault of the teeth, which cannot be judged yet, may change the lines of several sensors alike",
        )
    if _one_point(baseline, limits):
        yield NotJudged(
            what="recordings at another load or speed",
            reason=f"all recordings were made at one operating point, {range_of(baseline)}",
        )


def thin_for_teeth(baseline: Baseline, limits: SufficiencyLimits = LIMITS) -> str | None:
    """Why single teeth cannot be judged yet, as a sentence; None where they can."""
    known = baseline.counted
    if known.recordings >= limits.least_recordings:
        return None
    many = known.windows > known.recordings
    windows = f" ({known.windows} windows: those of one source, day and load count once)" if many else ""
    return (
        f"{known.recordings} of at least {limits.least_recordings} recordings{windows}, {range_of(baseline)}: teeth "
        "cannot be judged yet"
    )


def left_out_of(baseline: Baseline) -> LeftOut:
    """What is compared with a baseline and what not, by what leaving each recording out has shown."""
    repeats = baseline.repeats
    channels = sorted(baseline.std)
    return LeftOut(
        recordings=repeats.left_out,
        false_alarms=repeats.false_alarms,
        raw_false_alarms=repeats.raw_false_alarms,
        meant=REPEATS.false_alarms,
        compared=(
            _compared(baseline, PATTERN, ""),
            *(_compared(baseline, kind, channel) for kind in BY_CHANNEL for channel in channels),
            *(_compared(baseline, kind, "") for kind in TOGETHER),
        ),
    )


def _compared(baseline: Baseline, kind: str, channel: str) -> Compared:
    """One kind of comparison."""
    repeats = baseline.repeats
    unlike = kind == PATTERN or kind in BY_PATTERN
    if unlike and not repeats.pattern_compared:
        reason = (
            f"the healthy recordings do not repeat their tooth pattern: {repeats.unlike} has a correlation of "
            f"{min(repeats.pattern):.2f} with the others, median {float(np.median(repeats.pattern)):.2f}"
        )
        return Compared(what=kind, channel=channel, factor=None, reason=reason)
    factor = repeats.factor(kind, channel)
    if not isfinite(factor):
        reason = "most healthy recordings, left out, differ from the others by more than the limit"
        return Compared(what=kind, channel=channel, factor=None, reason=reason)
    return Compared(what=kind, channel=channel, factor=factor)


def load_range(baseline: Baseline) -> tuple[float, float] | None:
    """Least and largest load learned, over the rated one; None without a torque meter or a rated torque."""
    rated, torques = baseline.rig.get(RATED_LOAD), [r.torque_nm for r in baseline.readings]
    if not rated or any(t is None for t in torques):
        return None
    loads = np.array(torques, dtype=float) / rated
    return float(loads.min()), float(loads.max())


def range_of(baseline: Baseline, at: Iterable[float] = ()) -> str:
    """The learned operating points in words: the load in per cent of the rated one where that is known.

    at  a point on the baseline's axes from which the ends of the range are to be told
    """
    load = load_range(baseline)
    axes = [axis for axis in baseline.axes if axis != "torque_nm" or load is None]
    points = dict(zip(baseline.axes, at, strict=False))
    parts = []
    for axis, ends in baseline.range.items():
        if axis in axes:
            digits = digits_apart(*ends, *((points[axis],) if axis in points else ()))
            parts.append(" to ".join(f"{end:.{digits}g}" for end in ends) + f" {UNITS[axis]}")
    if load is not None:
        parts.insert(0, f"load {100 * load[0]:.0f}–{100 * load[1]:.0f} %")
    return ", ".join(parts)


def digits_apart(*values: float) -> int:
    """Significant digits, at least 5, with which numbers that differ are written differently."""
    return next((n for n in range(5, 12) if len({f"{v:.{n}g}" for v in values}) == len(set(values))), 12)


def _one_point(baseline: Baseline, limits: SufficiencyLimits) -> bool:
    """Whether all recordings were made at one load and speed."""
    speed = np.array([r.speed_hz for r in baseline.readings])
    if np.ptp(speed) > limits.same_speed * speed.mean():
        return False
    torques = [r.torque_nm for r in baseline.readings]
    if any(t is None for t in torques):
        return True
    torque = np.array(torques, dtype=float)
    return bool(np.ptp(torque) <= OPERATING.torque_varies * abs(torque.mean()))
