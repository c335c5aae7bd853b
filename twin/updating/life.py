"""Remaining life to the rig file's end-of-life criterion, at the operating condition of the latest window.

    time left = revolutions left / speed

By the RMS alone, the wear rate is known twice: over the latest interval, which scatters with the level, and as the mean
since the gears were new, which knows nothing of a change. The truth is assumed between them: their geometric mean is
used, and half the logarithm of their ratio is its standard deviation, with RMS_SPREAD.

Source   remaining_life.py, which gives the revolutions with their interval
Limits   the condition stays as it is
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.assessment import Interval, Life, Unavailable
from twin.model import Condition
from twin.quantiles import Z95
from twin.rig import Rig
from twin.thresholds import deciding
from twin.updating.outcome import UpdateOutcome, stated_std
from twin.updating.remaining_life import NORMAL, RemainingLife, WorkCurve, remaining_life
from twin.updating.rms_update import RmsTrack
from twin.updating.tracker import WearTrack
from twin.updating.wear_forecast import forecast_of

PROBABILITIES = (0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)  # of the quantiles stated
SCORES = np.array([0.0, -Z95, Z95, *(NORMAL.inv_cdf(p) for p in PROBABILITIES)])  # of median and band, and of these
NO_LIMIT = "remaining life is not available: the rig file gives no end_of_life.max_depth"
NO_LEVEL_RATE = (
    "the wear rate by the vibration level alone is too uncertain, so only a lower bound of the remaining life is known"
)
NO_RATE = "the wear rate cannot be distinguished from zero yet, so only a lower bound of the remaining life is known"


@dataclass(frozen=True, slots=True, kw_only=True)
class LifeSpread:
    """Spread of a life that rests on the RMS alone."""

    rms_spread: float = deciding(
        0.35,
        of="work and rate",
        meaning="relative standard deviation of work and rate by the RMS method",
        source="reference campaigns: true depth over that from the RMS alone scatters by ±35 %",
    )


LIFE_SPREAD = LifeSpread()


@dataclass(frozen=True, slots=True, kw_only=True)
class LifeDoubt:
    """What a life is uncertain by beyond its own scatter, as relative standard deviations (twin/preliminary.py)."""

    of_depth: float = 0.0  # of all depths together
    of_rate: float = 0.0  # of the wear rate
    level_factor: float = 1.0  # on the spread of the RMS method


NO_DOUBT = LifeDoubt()


def life_of(rig: Rig, outcome: UpdateOutcome, doubt: LifeDoubt) -> Life | Unavailable:
    """The remaining life after a window, or why it is not available."""
    found = life_after(rig, outcome, doubt)
    if isinstance(found, Unavailable):
        return found
    life = _stated(rig, found, outcome.condition)
    return replace(life, reason=NO_LEVEL_RATE) if life.reason is not None and outcome.method == "rms" else life


def life_after(
    rig: Rig, outcome: UpdateOutcome, doubt: LifeDoubt = NO_DOUBT, spread: LifeSpread = LIFE_SPREAD
) -> RemainingLife | Unavailable:
    """The distribution of the revolutions left after a window."""
    limit = rig.get("end_of_life.max_depth")
    if limit is None:
        return Unavailable(reason=NO_LIMIT)
    memory, track = outcome.memory, outcome.memory.track
    by_rms = outcome.method == "rms"
    if not (memory.rms_track.updates if by_rms else track.windows):
        return Unavailable(reason="remaining life is not available: no worn window has been seen yet")
    common, forecast = 0.0, None
    if by_rms:
        track = _by_level(track, memory.rms_track, spread.rms_spread * doubt.level_factor)
    elif outcome.estimate is not None and outcome.estimate.depth > 0:
        stated = stated_std(outcome.estimate, memory) / outcome.estimate.depth
        forecast = forecast_of(memory.points, track.revolutions)
        held = 0.0 if forecast is None else stated  # by the points that the forecast rests on
        common = float(np.sqrt(max(min(max(stated, doubt.of_depth), 1.0) ** 2 - held**2, 0.0)))
    start = memory.segments[-1].start_work
    return remaining_life(track, outcome.curve, start, limit, common, doubt.of_rate, forecast)


def life_of_track(
    rig: Rig, track: WearTrack, curve: WorkCurve, start_work: float, condition: Condition, rate_doubt: float
) -> Life | Unavailable:
    """The remaining life of a track that holds what all depths are off by together, on a curve, under a condition."""
    limit = rig.get("end_of_life.max_depth")
    if limit is None:
        return Unavailable(reason=NO_LIMIT)
    return _stated(rig, remaining_life(track, curve, start_work, limit, None, rate_doubt), condition)


def _stated(rig: Rig, found: RemainingLife, condition: Condition) -> Life:
    median, p05, p95, *quantiles = (bound(n) for n in found.at(SCORES))
    assert p05 is not None
    revolutions = Interval(median=median, p05=p05, p95=p95)
    return Life(
        criterion=rig.get("end_of_life.criterion", "max_depth"),
        limit=rig.get("end_of_life.max_depth"),
        reached=found.reached,
        revolutions=revolutions,
        time=revolutions.scaled(1 / condition.speed_hz),
        speed=condition.speed_hz,
        torque=condition.torque,
        reason=None if found.measurable else NO_RATE,
        distribution=tuple(zip(PROBABILITIES, quantiles, strict=True)),
    )


def bound(value: float) -> float | None:
    """A value, or None where it is infinite."""
    return float(value) if np.isfinite(value) else None


def _by_level(track: WearTrack, own: RmsTrack, relative: float) -> WearTrack:
    """The track of the RMS method, its rate between that of the latest interval and the mean since the start."""
    mean = own.work / own.revolutions if own.revolutions > 0 else own.rate
    rate = float(np.sqrt(own.rate * mean))
    apart = 0.5 * abs(float(np.log(own.rate / mean)))
    return replace(
        track, work=own.work, rate=rate, var_work=(relative * own.work) ** 2, cov=0.0,
        var_rate=(float(np.hypot(relative, apart)) * rate) ** 2,
    )  # fmt: skip
