"""Wear after a window: coefficient, depths of both flanks, profile, and how far the model holds.

depth of a flank = combined depth · share of the flank        shares as wear/archard.py: pinion_share
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin.assessment import (
    FLANKS,
    FlankProfile,
    FusedEstimate,
    Interval,
    Life,
    MethodEstimates,
    ModelValidity,
    RmsEstimate,
    Unavailable,
    Wear,
    WearProfile,
)
from twin.geometry import GearPair
from twin.geometry.involute import roll_angle
from twin.rig import Rig
from twin.updating.growth import growth_of
from twin.updating.inspections import MEASURED_DEPTH
from twin.updating.update import UpdateOutcome, reference_rate
from twin.wear.archard import pinion_share, specific_wear_rate
from twin.wear.profile import WornProfile

PROFILE_POINTS = 65
NO_LIFE = (
    "remaining life is not available: the age of the gears is not known, so what had worn before the first window is "
    f"not known either; {MEASURED_DEPTH}"
)


def wear_of(rig: Rig, outcome: UpdateOutcome) -> Wear:
    """Wear after a window that was updated by the model."""
    pair = outcome.model.mesh.pair
    shares = wear_shares(rig)
    combined = depth_of(outcome)
    K = wear_coefficient(rig, outcome)
    τ, f = rig.require("the wear coefficient", "wear.dwell_time", "operating.pinion_speed_hz")
    loss = outcome.curve.loss_from
    return Wear(
        wear_coefficient=K,
        specific_wear_rate=float(specific_wear_rate(pair, K, τ, f)),
        dwell_time=τ,
        dwell_time_speed=f,
        depth={flank: combined.scaled(shares[flank]) for flank in FLANKS},
        profile=profile_along(pair, outcome.curve.profile(outcome.depth)),
        method=outcome.method,
        methods=methods_of(rig, outcome),
        validity=ModelValidity(
            contact_loss_from=None if loss is None else float(loss),
            steady_state_to=float(outcome.curve.valid_to),
            valid=bool(outcome.depth <= outcome.curve.valid_to and (loss is None or outcome.depth < loss)),
        ),
    )


def as_age_allows(
    outcome: UpdateOutcome, wear: Wear | Unavailable, life: Life | Unavailable
) -> tuple[Wear | Unavailable, Life | Unavailable]:
    """Wear and life with the growth since the first window, where no window has seen the gears new.

    Where their age is not known either, that growth is all that is known: the depth is not below it, and there is no
    life. As they are where an inspection has measured the depth.
    """
    growth = None if outcome.memory.unworn else growth_of(outcome.memory)
    if growth is None or not isinstance(wear, Wear):
        return wear, life
    if outcome.age_known or wear.inspected is not None:
        return replace(wear, growth=growth), life
    depth = wear.depth["combined"]
    return replace(
        wear,
        depth={flank: Interval(median=None, p05=known.p05, p95=None) for flank, known in wear.depth.items()},
        profile=None,
        methods=MethodEstimates(fused=None, rms=None),
        growth=replace(growth, by_model=depth),
    ), Unavailable(reason=NO_LIFE)


def wear_shares(rig: Rig) -> dict[str, float]:
    """The share of the combined depth that lies on each flank."""
    share = pinion_share(rig.gear_pair())
    return {"combined": 1.0, "pinion": share, "gear": 1 - share}


def depth_of(outcome: UpdateOutcome) -> Interval:
    """The combined depth of a window [m]."""
    low, high = outcome.depth_band
    return Interval(median=float(outcome.depth), p05=float(low), p95=float(high))


def wear_coefficient(rig: Rig, outcome: UpdateOutcome) -> float:
    """K [1/N] by the method in use."""
    rate = outcome.memory.rms_track.rate if outcome.method == "rms" else outcome.memory.track.rate
    return float(rate / reference_rate(rig))


def methods_of(rig: Rig, outcome: UpdateOutcome) -> MethodEstimates:
    """What either method of updating gives for the window."""
    reference = reference_rate(rig)
    fused = rms = None
    if outcome.estimate is not None:
        fused = FusedEstimate(
            wear_coefficient=float(outcome.memory.track.rate / reference),
            depth=float(outcome.estimate.depth),
            depth_std=float(outcome.estimate.std) if np.isfinite(outcome.estimate.std) else None,
            depth_from_lines=float(outcome.estimate.from_lines),
            misfit=float(outcome.estimate.misfit),
        )
    if outcome.rms_result is not None:
        found = outcome.rms_result
        rms = RmsEstimate(
            wear_coefficient=float(outcome.memory.rms_track.rate / reference),
            depth=float(outcome.rms_depth),
            rms_predicted=float(found.rms_predicted),
            rms_after=float(found.rms_after),
            updated=bool(found.updated),
            converged=bool(found.converged),
            iterations=found.iterations,
        )
    return MethodEstimates(fused=fused, rms=rms)


def profile_along(pair: GearPair, profile: WornProfile) -> WearProfile:
    """Depth of both flanks along the nominal path, by path position, radius and roll angle."""
    share = pinion_share(pair)
    s = np.linspace(pair.path_start, pair.path_end, PROFILE_POINTS)
    depth, _ = profile.at(s)
    flanks = []
    for rb, ρ, part in zip(pair.base_radius, pair.curvature_radius(s), (share, 1 - share), strict=True):
        radius = np.hypot(rb, ρ)
        flanks.append(
            FlankProfile(
                radius=tuple(radius.tolist()),
                roll_angle=tuple(roll_angle(radius, rb).tolist()),
                depth=tuple((depth * part).tolist()),
            )
        )
    return WearProfile(path_position=tuple(s.tolist()), pinion=flanks[0], gear=flanks[1])
