"""Measured wear depths change the estimate: depth, wear rate, and with them the remaining life.

A depth d that was measured on one flank is one of both flanks together, d/share; as work it is x = x(d) on the wear
curve. updating/inspected_wear.py weighs it against what the windows measured. Where the windows' band is wider than the
method's own (a doubted calibration, an estimated rig), all depths may be off by one factor beyond the method's own
scatter: the doubt is the same at all depths, so the growth since an inspection is known as well as the windows measured
it.

A depth that is preliminary is established once the inspections have taken most of its uncertainty away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt

import numpy as np

from twin.assessment import FLANKS, InspectedDepth, InspectionResult, Interval, Life, Preliminary, Unavailable, Wear
from twin.established import LIMITS as ESTABLISHED
from twin.grounds import MORE_WINDOWS, counted
from twin.model import Condition
from twin.quantiles import Z95
from twin.rig import Rig
from twin.thresholds import deciding
from twin.updating.depth import DEPTH
from twin.updating.inspected_wear import FAULTS, InspectedWear, InspectedWork, wear_with_inspections
from twin.updating.inspections import MEASURED_DEPTH, Inspection
from twin.updating.life import life_of_track
from twin.updating.memory import Memory, RatePrior
from twin.updating.model_cache import curve_of
from twin.updating.tracker import RATE, WearTrack
from twin.updating.update import reference_rate
from twin.updating.wear_now import profile_along, wear_shares
from twin.updating.wear_points import Points, WearPoint
from twin.wear.archard import specific_wear_rate
from twin.wear.curve import MasterCurve


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionLimits:
    """When inspections establish a depth."""

    settled: float = deciding(
        0.5,
        of="width of the depth's band without inspections",
        meaning="width of the band with inspections below which a preliminary depth is established",
        source="derivation: three quarters of the information are then from the inspections",
    )


LIMITS = InspectionLimits()


def with_inspections(
    rig: Rig,
    memory: Memory,
    wear: Wear | Unavailable,
    life: Life | Unavailable,
    inspections: Sequence[Inspection],
    age_known: bool = True,
) -> tuple[Wear | Unavailable, Life | Unavailable]:
    """Wear and life as inspections leave them; as they are where there are none, or no wear by a model.

    wear, life  by the windows; or with earlier inspections, which are then taken out first
    age_known   whether the revolutions count from new flanks
    """
    if not inspections or not isinstance(wear, Wear) or not memory.segments:
        return wear, life
    by_rms = _by_rms(wear, memory)
    depth = _by_windows(wear)
    scale = _Scale.of(rig, memory, by_rms, depth)
    shares = wear_shares(rig)
    before = 0.0 if age_known else _unseen(memory, scale.points)
    works = [scale.inspected(i, shares[i.flank]) for i in inspections]
    track = _track_by_windows(memory, depth, scale, by_rms)
    found = wear_with_inspections(
        tuple(replace(p, revolutions=p.revolutions + before) for p in scale.points),
        [replace(w, revolutions=w.revolutions + before) for w in works],
        memory.prior or _prior_of_rig(rig, memory.track.rate),
        replace(track, revolutions=track.revolutions + before),
        FAULTS.alike_rms if by_rms else FAULTS.alike_fused,
        scale.doubt,
    )
    median, low, high = (scale.depth(found.work_quantile(p)) for p in (0.5, 0.05, 0.95))
    combined = Interval(median=median, p05=low, p95=high)
    result = _result(wear, life, depth, inspections, scale, shares, found)
    agrees = not any(c.contradicts for c in result.compared)
    settled = agrees and _width(combined) < LIMITS.settled * _width(depth)
    wear = _wear(rig, scale, wear, combined, found, result)
    wear = replace(wear, preliminary=None if settled else result.depth_preliminary)
    first_rate = agrees and not by_rms and not memory.track.windows  # no worn window has given one
    if isinstance(life, Unavailable) and not (settled or first_rate):
        return wear, life
    return wear, _life(rig, memory, life, scale, found, result, settled)


def _unseen(memory: Memory, points: Points) -> float:
    """Revolutions before the count's zero that gears of unknown age would have made at their present wear rate."""
    if not points or not memory.track.rate > 0:
        return 0.0
    return max(points[0].work / memory.track.rate - points[0].revolutions, 0.0)


def _by_windows(wear: Wear) -> Interval:
    """The combined depth by the windows alone [m]; of gears of unknown age that which the model alone gives."""
    if wear.inspected is not None:
        return wear.inspected.depth_by_windows
    if wear.growth is not None and wear.growth.by_model is not None:
        return wear.growth.by_model
    return wear.depth["combined"]


def _life(
    rig: Rig,
    memory: Memory,
    life: Life | Unavailable,
    scale: _Scale,
    found: InspectedWear,
    result: InspectionResult,
    settled: bool,
) -> Life | Unavailable:
    """The life of the inspected track; a young rate is doubted as without inspections."""
    young = _young(memory, len(result.compared))
    doubt = 0.0 if young is None else ESTABLISHED.young_rate
    after = life_of_track(rig, found.track, scale.curve, scale.base, _condition(memory, life), doubt)
    if not isinstance(after, Life):
        return after
    return replace(after, preliminary=None if settled and young is None else result.life_preliminary or young)


def _young(memory: Memory, inspections: int) -> Preliminary | None:
    """Why a wear rate is not established by worn windows, nor by inspections; None where it is."""
    windows, least = memory.track.steady, ESTABLISHED.least_worn_windows
    if _by_rms_alone(memory) or max(windows, inspections) >= least:
        return None
    return Preliminary(
        reasons=(
            f"the wear rate rests on {counted(windows, 'worn window')} and {counted(inspections, 'inspection')}, "
            f"of at least {least} of either",
        ),
        remedies=(MORE_WINDOWS, MEASURED_DEPTH),
    )


def _prior_of_rig(rig: Rig, measured: float) -> RatePrior:
    """What the rig file says of the rate: within a factor of about three, so its spread is that of the larger rate."""
    (K,) = rig.require("the wear coefficient", "wear.K")
    rate = K * reference_rate(rig)
    return RatePrior(rate=rate, std=RATE.prior * max(rate, measured))


def _width(band: Interval) -> float:
    """Of the 5-95 % band [m]; infinite where it has no upper bound."""
    return inf if band.p95 is None else band.p95 - band.p05


def _by_rms(wear: Wear, memory: Memory) -> bool:
    """Whether the depth rests on the RMS alone."""
    return wear.method == "rms" or _by_rms_alone(memory)


def _by_rms_alone(memory: Memory) -> bool:
    return not memory.points and not memory.track.windows and bool(memory.rms_points)


def _track_by_windows(memory: Memory, depth: Interval, scale: _Scale, by_rms: bool) -> WearTrack:
    """Work and rate now, as they are stated without inspections."""
    assert depth.median is not None
    rate = memory.rms_track.rate if by_rms else memory.track.rate
    return replace(memory.track, work=scale.work(depth.median), rate=rate)


def _condition(memory: Memory, life: Life | Unavailable) -> Condition:
    """The operating condition that a life is stated for."""
    if isinstance(life, Life):
        return Condition(speed_hz=life.speed, torque=life.torque)
    return Condition(speed_hz=memory.segments[-1].speed_hz, torque=memory.segments[-1].torque)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Scale:
    """Depth and work of one machine, one by the other."""

    curve: MasterCurve  # of the present condition
    base: float  # work at its start [rad/N]
    points: Points
    doubt: float  # relative standard deviation of all works together, beyond the method's own
    earlier: tuple[tuple[float, float], ...]  # depth and work of windows before its start, rising

    @classmethod
    def of(cls, rig: Rig, memory: Memory, by_rms: bool, stated: Interval) -> _Scale:
        """Of a machine whose depth now is stated with a band; the points are as uncertain as that."""
        curve, base = curve_of(rig, memory), memory.segments[-1].start_work
        points = memory.rms_points if by_rms else memory.points
        if not points and memory.track.windows and not by_rms:
            points = (_point_of_track(memory, curve, base),)
        doubt = _doubt(points, curve, _width(stated) / (2 * Z95))
        rising = [(0.0, 0.0)]
        for depth, work in sorted((p.depth, p.work) for p in points):
            if rising[-1][0] < depth < curve.start_depth and rising[-1][1] < work < base:
                rising.append((depth, work))
        earlier = (*rising, (curve.start_depth, base))
        return cls(curve=curve, base=base, points=points, doubt=doubt, earlier=earlier)

    def work(self, depth: float) -> float:
        """x [rad/N] of a largest depth [m]."""
        if depth >= self.curve.start_depth:
            return self.base + self.curve.work_at(depth)
        return float(np.interp(depth, [d for d, _ in self.earlier], [w for _, w in self.earlier]))

    def depth(self, work: float) -> float:
        """Largest depth [m] after x [rad/N], not below zero."""
        if work >= self.base:
            return self.curve.depth_at(work - self.base)
        return max(float(np.interp(work, [w for _, w in self.earlier], [d for d, _ in self.earlier])), 0.0)

    def inspected(self, inspection: Inspection, share: float) -> InspectedWork:
        """An inspection of a flank with a share of the depth as a work."""
        depth, std = inspection.depth / share, inspection.std / share
        low, high = max(depth - std, 0.0), depth + std
        slope = (self.work(high) - self.work(low)) / (high - low)
        return InspectedWork(revolutions=inspection.revolutions, work=self.work(depth), std=std * slope)


def _doubt(points: Points, curve: MasterCurve, std: float) -> float:
    """By how much, relative, the latest work is stated [m] to be less certain than by the method's own scatter."""
    if not points or not isfinite(std):
        return 0.0
    last = points[-1]
    stated = std * curve.work_per_depth(max(last.depth, curve.start_depth))
    return sqrt(max(stated**2 - last.shared_std**2, 0.0)) / last.work if last.work > 0 else 0.0


def _point_of_track(memory: Memory, curve: MasterCurve, base: float) -> WearPoint:
    """The track as one window, where no window had a depth with a known uncertainty."""
    track = memory.track
    depth = max(curve.depth_at(track.work - base), curve.start_depth)
    shared = DEPTH.model_scatter[0] * track.work
    return WearPoint(
        revolutions=track.revolutions, depth=depth, work=track.work, shared_std=shared, own_std=track.work_std
    )


def _result(
    wear: Wear,
    life: Life | Unavailable,
    depth: Interval,
    inspections: Sequence[Inspection],
    scale: _Scale,
    shares: dict[str, float],
    found: InspectedWear,
) -> InspectionResult:
    compared = []
    for one, agreement in zip(inspections, found.agreements, strict=True):
        share = shares[one.flank]
        low, median, high = (
            share * scale.depth(agreement.work + score * agreement.work_std) for score in (-Z95, 0.0, Z95)
        )
        compared.append(
            InspectedDepth(
                revolutions=one.revolutions, flank=one.flank, depth=one.depth, std=one.std,
                by_windows=Interval(median=median, p05=low, p95=high),
                difference_in_std=agreement.difference, contradicts=agreement.contradicts,
            )
        )  # fmt: skip
    before = wear.inspected
    return InspectionResult(
        depth_by_windows=depth,
        coefficient_by_windows=wear.wear_coefficient if before is None else before.coefficient_by_windows,
        windows_wrong=found.windows_wrong,
        compared=tuple(compared),
        depth_preliminary=wear.preliminary if before is None else before.depth_preliminary,
        life_preliminary=before.life_preliminary if before else life.preliminary if isinstance(life, Life) else None,
    )


def _wear(
    rig: Rig, scale: _Scale, wear: Wear, combined: Interval, found: InspectedWear, result: InspectionResult
) -> Wear:
    assert combined.median is not None
    pair, shares = rig.gear_pair(), wear_shares(rig)
    K = found.track.rate / reference_rate(rig)
    depth, loss = combined.median, wear.validity.contact_loss_from
    return replace(
        wear,
        wear_coefficient=float(K),
        specific_wear_rate=float(specific_wear_rate(pair, K, wear.dwell_time, wear.dwell_time_speed)),
        depth={flank: combined.scaled(shares[flank]) for flank in FLANKS},
        profile=profile_along(pair, scale.curve.profile(max(depth, scale.curve.start_depth))),
        validity=replace(
            wear.validity, valid=depth <= wear.validity.steady_state_to and (loss is None or depth < loss)
        ),
        inspected=result,
    )
