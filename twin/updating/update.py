"""One window's features into the twin's memory: prediction, comparison, update.

Both ways of updating are always computed. The fused way takes the depth from the encoders and the wear coefficient
from the slope of depth over revolutions, then learns the path from the mesh to the accelerometer at that depth; the
paper's way takes the wear coefficient from the RMS alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from twin.errors import NotAvailable
from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.rig import Rig
from twin.updating import encoders, half_width, rms_update
from twin.updating.calibration import calibrate, compliance_scale
from twin.updating.conditions import MATCH, Measured, refuse_falling_count
from twin.updating.depth import MODEL_SCATTER, SHAPE_SCATTER, DepthEstimate, estimate_depth
from twin.updating.disc_remount import settled
from twin.updating.memory import KEPT_SEGMENTS, Memory, Segment, StoredProfile, with_lines
from twin.updating.model_cache import curve_of, model_of, start_of_curve, with_profiles
from twin.updating.prediction import Expectation, band_rms, predicted_lines
from twin.updating.rms_update import RmsResult, RmsTrack
from twin.updating.tracker import WearTrack
from twin.wear.curve import LINES, MasterCurve

SPEED_STEP, TORQUE_STEP = 0.05, 0.10  # relative change of condition that starts a new segment
MOST_UNWORN = 6
DEPTH_SCATTER = 0.007  # of the depth from window to window, beyond noise: speed and torque off the mean
DEPTH_FLOOR = 0.15e-6  # [m]
RMS_DEPTH_LOW, RMS_DEPTH_HIGH = 0.75, 1.75  # 5–95 % of true depth over that from the RMS alone (24 % low, ± 35 %)
Z95 = 1.6449


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateOutcome:
    """What a window did to the twin."""

    memory: Memory
    model: Model
    curve: MasterCurve
    condition: Condition
    kind: str
    rms_measured: float | None  # [m/s²], None without a usable accelerometer
    rms_predicted: float  # before any update [m/s²]
    rms_after: float
    updated: bool
    depth: float  # combined, by the method in use [m]
    depth_band: tuple[float, float]  # 5 and 95 % [m]
    method: str  # what set the depth: "transmission error", "pinion encoder", "rms", "projection" or "unworn"
    estimate: DepthEstimate | None  # by the encoders, where they were there
    rms_result: RmsResult | None
    rms_depth: float
    expectation: Expectation | None
    lines: np.ndarray  # predicted acceleration lines after the update (LINES,) [m/s²]
    notes: tuple[str, ...] = ()


NEEDED = (
    "gears.module", "gears.pressure_angle_deg", "gears.face_width", "gears.addendum", "gears.dedendum",
    "gears.youngs_modulus", "gears.poisson_ratio", "gears.pinion.bore_radius", "gears.gear.bore_radius",
    "inertias.J5", "masses.m5", "bearings.ky_input", "shafts.bending_stiffness_input", "torsional_stiffness.k_3_5",
    "damping.modal_ratio", "mesh.relative_damping_time", "mesh.stiffness_scale", "wear.K", "wear.dwell_time",
    "wear.contact_half_width", "sensors.accelerometer", "operating.pinion_speed_hz",
)  # fmt: skip


def reference_rate(rig: Rig) -> float:
    """τ·ω1 of the rig file's dwell time [rad]: the same at any speed."""
    τ, f = rig.require("the wear coefficient", "wear.dwell_time", "operating.pinion_speed_hz")
    return τ * 2 * pi * f


def _started(rig: Rig, memory: Memory) -> Memory:
    """The memory with tracks at the rig file's wear coefficient."""
    if memory.track.rate > 0:
        return memory
    (K,) = rig.require("the wear coefficient", "wear.K")
    rate = K * reference_rate(rig)
    return replace(memory, track=WearTrack.unworn(rate), rms_track=RmsTrack(rate=rate))


def _with_segment(rig: Rig, memory: Memory, condition: Condition, revolutions: float = 0.0) -> Memory:
    """The memory with a segment that fits the condition and the effects, a new one from the present depth else."""
    last = memory.segments[-1] if memory.segments else None
    if last is not None:
        same = abs(condition.speed_hz / last.speed_hz - 1) < SPEED_STEP
        same = same and memory.active(revolutions) == memory.active(last.start_revolutions)
        if same and abs(condition.torque / last.torque - 1) < TORQUE_STEP:
            return memory
    speed, torque = condition.speed_hz, condition.torque
    nominal = rig.get("operating.pinion_speed_hz"), rig.get("operating.input_torque")
    if nominal[0] and abs(speed / nominal[0] - 1) < SPEED_STEP:
        speed = nominal[0]
    if nominal[1] and abs(torque / nominal[1] - 1) < TORQUE_STEP:
        torque = nominal[1]
    depth = work = 0.0
    profile = None
    if last is not None and memory.track.windows:
        work = memory.track.work
        onsets = [a.onset_revolutions for a in memory.effects if a.onset_revolutions <= revolutions]
        if onsets and max(onsets) > max(memory.track.revolutions, last.start_revolutions):
            work = memory.track.predicted(max(onsets)).work
        curve = curve_of(rig, memory)
        depth = curve.depth_at(work - last.start_work)
        if depth > 0:
            profile = StoredProfile.of(curve.profile(max(depth, curve.start_depth)))
    if last is not None and _tilted(memory, last.start_revolutions, revolutions):
        memory = replace(memory, offset=None)
    segment = Segment(
        speed_hz=speed,
        torque=torque,
        start_depth=depth,
        start_work=work,
        start_revolutions=revolutions,
        start_profile=profile,
    )
    return replace(memory, segments=(*memory.segments, segment)[-KEPT_SEGMENTS:] if depth > 0 else (segment,))


def _tilted(memory: Memory, before: float, now: float) -> bool:
    """Whether a shaft has tilted between two counts of revolutions, which moves the mean by an unknown step."""
    there = sum(e.facts.tilts_shaft for e in memory.active(before))
    return sum(e.facts.tilts_shaft for e in memory.active(now)) > there


def _calibrated(rig: Rig, memory: Memory, features: WindowFeatures) -> Memory:
    """The memory with the calibration refitted on one more unworn window."""
    memory = replace(memory, unworn=(*memory.unworn, features))
    then = features.revolutions or 0.0
    memory = replace(memory, fit=calibrate(model_of(rig, replace(memory, fit=None), then), memory.unworn))
    return replace(memory, compliance_scale=compliance_scale(model_of(rig, memory, then), memory.unworn))


def update_twin(
    rig: Rig,
    memory: Memory,
    features: WindowFeatures,
    index: int,
    *,
    threshold: float,
    update: str,
    update_until: float,
    level_fault: str | None = None,
) -> UpdateOutcome:
    """Takes one window into the twin; NotAvailable where the rig file or the window does not suffice."""
    rig.require("wear", *NEEDED)
    window = Measured.of(features, rig, level_fault)
    refuse_falling_count(window.revolutions, memory.track.revolutions)
    memory = with_profiles(rig, _started(rig, memory))
    unworn = window.kind == "calibration" or window.revolutions < MATCH.unworn_revolutions
    known_load = window.kind == "measurement" or features.torque_nm is not None
    known = known_load and window.level_fault is None
    if unworn and known and memory.track.windows == 0 and len(memory.unworn) < MOST_UNWORN:
        memory = _calibrated(rig, memory, features)
    if window.kind == "calibration":
        return _take_calibration(rig, memory, window, index)
    memory = _with_segment(rig, memory, window.condition, window.revolutions)
    return _take_measurement(rig, memory, window, index, threshold=threshold, update=update, update_until=update_until)


def _take_calibration(rig: Rig, memory: Memory, window: Measured, index: int) -> UpdateOutcome:
    """A low-speed window: it calibrates, and shows how the calibrated twin meets it; it wears nothing."""
    features, condition, track = window.features, window.condition, memory.track
    if not memory.segments:
        speed, torque = rig.require("the wear curve", "operating.pinion_speed_hz", "operating.input_torque")
        memory = _with_segment(rig, memory, Condition(speed_hz=speed, torque=torque))
    model = model_of(rig, memory, window.revolutions)
    curve = curve_of(rig, memory) if track.windows else start_of_curve(rig, memory)
    depth = curve.depth_at(track.work - memory.segments[-1].start_work)
    expectation = Expectation.at(model, curve, condition, depth, _when_new(rig, memory))
    lines, _ = predicted_lines(memory, expectation, depth, index, rig.teeth[0])
    rms = expectation.rms(lines, rig.teeth[0], rig.band, window.noise)
    gauge = encoders.gauge_of(features, memory, model, condition)
    estimate = None
    if gauge is not None:
        width = max(1e-6, 0.02 * depth)
        low = max(depth - width, curve.start_depth)
        pinion_only = features.transmission_error is None
        estimate = estimate_depth(
            replace(gauge, mean=None), lambda d: expectation.gauge(d, pinion_only, gauge.from_unworn), low, low + width
        )
        memory = encoders.learn(memory, features, model, expectation, estimate, depth, DEPTH_FLOOR)
    return UpdateOutcome(
        memory=memory, model=model, curve=curve, condition=condition, kind="calibration",
        rms_measured=window.rms, rms_predicted=rms,
        rms_after=rms, updated=False, depth=depth, depth_band=_band(depth, _projected_std(track, depth)),
        method="projection" if track.windows else "unworn", estimate=estimate, rms_result=None, rms_depth=depth,
        expectation=expectation, lines=lines,
    )  # fmt: skip


def _take_measurement(
    rig: Rig,
    memory: Memory,
    window: Measured,
    index: int,
    *,
    threshold: float,
    update: str,
    update_until: float,
) -> UpdateOutcome:
    """A window of the campaign: predict, compare, update."""
    features, condition, noise = window.features, window.condition, window.noise
    band, teeth = rig.band, rig.teeth[0]
    model, curve = model_of(rig, memory, window.revolutions), curve_of(rig, memory)
    new = _when_new(rig, memory)
    base = memory.segments[-1].start_work
    revolutions = max(window.revolutions, memory.track.revolutions)
    allowed = window.revolutions <= update_until
    heard = window.level_fault is None

    track = memory.track.predicted(revolutions)
    projected = max(curve.depth_at(track.work - base), curve.start_depth)
    expectation = Expectation.at(model, curve, condition, projected, new)
    lines, frequencies = predicted_lines(memory, expectation, projected, index, teeth)
    rms_predicted = expectation.rms(lines, teeth, band, noise)

    estimate = None
    notes: list[str] = []
    pinion_only, expected = features.transmission_error is None, expectation
    found = settled(
        memory, features, model, condition,
        lambda gauge: _depth_from(gauge, model, curve, expected, projected, pinion_only, new),
    )  # fmt: skip
    if found is not None:
        expectation, estimate = found.expectation, found.estimate
        notes += found.notes
        memory = found.memory if allowed else memory
    level = _level(expectation, curve, base, teeth, band, noise)
    telling = allowed and window.revolutions >= MATCH.unworn_revolutions  # unworn teeth tell nothing of the wear rate
    rms_result = None
    if window.rms is not None:
        rms_result = rms_update.update(
            memory.rms_track, revolutions, window.rms, level, threshold, allowed=telling and heard
        )
        memory = replace(memory, rms_track=rms_result.track)
    rms_depth = curve.depth_at(memory.rms_track.work - base)

    if estimate is not None and allowed:
        if telling:
            track = memory.track.followed(
                revolutions,
                base + curve.work_at(estimate.depth),
                float(np.hypot(estimate.noise_std, np.hypot(DEPTH_SCATTER * estimate.depth, DEPTH_FLOOR)))
                * curve.work_per_depth(estimate.depth),
            )
        memory = encoders.learn(memory, features, model, expectation, estimate, estimate.from_lines, None)
        learned_from = features if heard else replace(features, acceleration=None)
        path, mesh = encoders.factors(learned_from, expectation, estimate.depth, estimate.phase, index, teeth)
        memory = replace(memory, path=with_lines(memory.path, path), mesh=with_lines(memory.mesh, mesh))
    memory = replace(memory, track=track)

    if window.level_fault is not None:
        notes.append(f"the level was not compared: {window.level_fault}")
    if features.torque_nm is None:
        notes.append(f"no torque in this window: the rig's nominal {condition.torque:g} N·m is taken")
    if update == "fused" and estimate is not None:
        error = 0.0 if window.rms is None else rms_predicted / window.rms - 1
        updated = allowed and heard and abs(error) > threshold
        depth = estimate.depth if allowed else projected
        depth_band = _band(depth, estimate.std if allowed else _projected_std(track, projected))
        method = ("pinion encoder" if pinion_only else "transmission error") if allowed else "projection"
        after, _ = predicted_lines(memory, expectation, depth, index, teeth)
        if updated and window.rms is not None:
            lines, rms_after = after, expectation.rms(after, teeth, band, noise)
            if abs(rms_after / window.rms - 1) > threshold:
                notes.append(_why_not(features, after, frequencies, band))
        else:
            rms_after = rms_predicted
    elif rms_result is None:
        raise NotAvailable(f"the depth is not available: {window.level_fault}, and update = {update} needs the level")
    else:
        rms_predicted, rms_after, updated = rms_result.rms_predicted, rms_result.rms_after, rms_result.updated
        depth, method = rms_depth, "rms" if allowed else "projection"
        depth_band = (RMS_DEPTH_LOW * depth, RMS_DEPTH_HIGH * depth)
        lines = expectation.lines(depth).acceleration
        if updated and not rms_result.converged:
            notes.append("no wear coefficient brings the twin's RMS within the threshold")
    if estimate is not None and estimate.at_limit:
        notes.append("the depth stands at the end of the master curve: beyond, no steady state is known")
    if not expectation.solved:
        notes.append("no steady state was found at this window's condition: its response follows the master curve")
    memory = replace(memory, updates=memory.updates + updated, depth=depth)
    if estimate is not None and allowed:
        memory = half_width.refitted(rig, memory, features, condition, estimate.depth)
    return UpdateOutcome(
        memory=memory, model=model, curve=curve, condition=condition, kind="measurement",
        rms_measured=window.rms, rms_predicted=rms_predicted, rms_after=rms_after, updated=bool(updated), depth=depth,
        depth_band=depth_band, method=method, estimate=estimate, rms_result=rms_result, rms_depth=rms_depth,
        expectation=expectation, lines=lines, notes=tuple(notes),
    )  # fmt: skip


def _band(depth: float, std: float) -> tuple[float, float]:
    """5 and 95 % of a depth [m]."""
    return max(depth - Z95 * std, 0.0), depth + Z95 * std


def _projected_std(track: WearTrack, depth: float) -> float:
    """Standard deviation of a depth [m] carried on from earlier windows: the track's, and what all depths share."""
    relative = track.work_std / track.work if track.work > 0 else 0.0
    return depth * float(np.hypot(relative, np.hypot(MODEL_SCATTER[0], SHAPE_SCATTER * depth)))


def _when_new(rig: Rig, memory: Memory) -> Model | None:
    """The model of the time when the flanks were new; None where it had no effects."""
    return model_of(rig, memory) if memory.active(0.0) else None


def _depth_from(gauge, model, curve, expectation, projected, pinion_only, new):
    """The depth that the encoders show, and the expectation solved near it.

    Searched to four times what was expected; to the curve's end where that does not hold it.
    """
    shallow = curve.start_depth
    sought = max(4 * projected, 40e-6)
    deep = max(min(curve.valid_within(min(sought, curve.limit)), sought), shallow + 1e-6)

    def found(near: Expectation) -> DepthEstimate:
        return estimate_depth(gauge, lambda d: near.gauge(d, pinion_only, gauge.from_unworn), shallow, deep)

    estimate = found(expectation)
    if estimate.at_limit and deep < curve.valid_to:
        deep = curve.valid_to
        estimate = found(expectation)
    if not expectation.solved or abs(estimate.depth - projected) > 0.1 * max(projected, 5e-6):
        again = Expectation.at(model, curve, expectation.condition, estimate.depth, new)
        if again.solved:
            return again, found(again)
    return expectation, estimate


def _level(
    expectation: Expectation, curve: MasterCurve, base: float, teeth: int, band, noise: float
) -> Callable[[float], float]:
    """RMS [m/s²] at a work by the calibrated twin alone, without what encoders taught."""

    def level(work: float) -> float:
        return expectation.rms(expectation.lines(curve.depth_at(work - base)).acceleration, teeth, band, noise)

    return level


def _why_not(features: WindowFeatures, lines: np.ndarray, frequencies: np.ndarray, band) -> str:
    """Why the RMS still differs after an update: where the difference stands."""
    mesh = band_rms(lines, frequencies, band, 0.0)
    heard = float("nan")
    if features.acceleration is not None:
        k, y, _ = features.acceleration.mesh()
        inside = (k <= LINES) & (frequencies[np.minimum(k, LINES) - 1] <= band[1])
        heard = float(np.sqrt(0.5 * np.sum(np.abs(y[inside]) ** 2)))
    return (
        f"after the update the twin's mesh lines make {mesh:.3g} m/s² against {heard:.3g} m/s² in the measured "
        f"ones, of {features.rms:.3g} m/s² measured in the band"
    )
