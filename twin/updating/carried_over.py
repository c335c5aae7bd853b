"""How far a wear coefficient that was learned holds for other gears, and after a change of oil.

A coefficient is a prior for the next pair of the same kind: its value, with the spread between pairs added to its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.thresholds import deciding
from twin.updating.memory import Memory, RatePrior
from twin.updating.rms_update import RmsTrack
from twin.updating.tracker import WearTrack


@dataclass(frozen=True, slots=True, kw_only=True)
class CarriedOver:
    """How far what was learned before a change of the machine holds after it."""

    pair_to_pair: float = deciding(
        0.5,
        of="the wear coefficient learned on the gears before",
        meaning="standard deviation of the wear coefficient of the next pair of the same kind",
        source="not derived: wear coefficients of nominally equal pairs differ by a factor of about two",
    )
    oil_to_oil: float = deciding(
        0.5,
        of="the wear coefficient before",
        meaning="change of the wear coefficient by other oil, one standard deviation",
        source="not derived: the same spread as between two pairs",
    )
    calibration_windows: int = deciding(
        3,
        unit="windows",
        meaning="calibration windows of the earlier gears that take part in the calibration of the next ones",
        source="not derived: half of those that a calibration rests on at most, so that the new flanks weigh as much",
    )


CARRIED = CarriedOver()


def for_next_pair(memory: Memory, carried: CarriedOver = CARRIED) -> Memory:
    """The memory with unworn flanks of the same kind: what was learned of the structure and the path is kept."""
    track, rms = memory.track, memory.rms_track
    by_level = not track.windows and rms.updates > 0
    learned = rms.rate if by_level else track.rate
    prior = WearTrack.unworn(learned)
    if by_level or track.windows:
        own = 0.0 if by_level else track.rate_std
        prior = replace(prior, var_rate=float(np.hypot(carried.pair_to_pair * learned, own)) ** 2)
    unworn = memory.unworn[: carried.calibration_windows]
    return Memory(
        fit=memory.fit,
        compliance_scale=memory.compliance_scale,
        unworn=unworn,
        unworn_before=len(unworn),
        prior=RatePrior(rate=learned, std=prior.rate_std) if learned > 0 else None,
        track=prior,
        rms_track=RmsTrack(rate=learned),
        path=memory.path,
    )


def with_wider_rate(memory: Memory, carried: CarriedOver = CARRIED) -> Memory:
    """The memory with a wear rate that other oil may have changed."""
    track = memory.track
    wider = replace(track, var_rate=track.var_rate + (carried.oil_to_oil * track.rate) ** 2)
    return replace(memory, track=wider)
