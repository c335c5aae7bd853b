"""A window of the campaign: predict, measure the depth, learn, and judge by the method in use.

The two methods of updating are always computed. The fused method takes the depth from the encoders and the wear
coefficient from the slope of depth over revolutions, then learns the path from the mesh to the accelerometer at that
depth; the RMS method takes the wear coefficient from the RMS alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.errors import NotAvailable
from twin.features.window_features import WindowFeatures
from twin.model import Model
from twin.quantiles import Z95
from twin.rig import Rig
from twin.structure_spread import is_estimated
from twin.thresholds import deciding
from twin.updating import encoders, half_width, rms_update
from twin.updating.conditions import Measured
from twin.updating.depth import DEPTH, DepthEstimate
from twin.updating.depth_search import depth_from
from twin.updating.disc_remount import SettledDepth, settled
from twin.updating.joint_update import of_known_depth, of_unknown_depth, settled_jointly
from twin.updating.memory import Memory, with_lines
from twin.updating.model_cache import curve_of, model_of
from twin.updating.outcome import UpdateOptions, UpdateOutcome, depth_band, stated_std
from twin.updating.prediction import Expectation, band_rms, predicted_lines
from twin.updating.rms_update import RmsResult
from twin.updating.tracker import WearTrack
from twin.updating.wear_points import WearPoint, with_point
from twin.wear.curve import LINES, MasterCurve


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthScatter:
    """How a depth scatters from window to window beyond its noise, and how far the RMS alone leads astray."""

    relative: float = deciding(
        0.007,
        of="the depth",
        meaning="scatter from window to window, beyond noise",
        source="not derived: speed and torque of a window off their mean",
    )
    floor: float = deciding(
        0.15e-6,
        unit="m",
        meaning="scatter of a small depth from window to window",
        source="not derived: the same of a depth near zero",
    )
    rms_low: float = deciding(
        0.75,
        of="the depth by the RMS alone",
        meaning="5 % quantile of the true depth",
        source="blind trials on D00, D01 and D09: the RMS gives a depth 24 % too small in the median, ± 35 %",
    )
    rms_high: float = deciding(
        1.75, of="the depth by the RMS alone", meaning="95 % quantile of the true depth", source="as rms_low"
    )
    rms_own: float = deciding(
        0.05,
        of="the depth by the RMS alone",
        meaning="scatter from window to window of a depth by the RMS alone",
        source="derivation: the error of the level up to which a window does not update the twin",
    )


SCATTER = DepthScatter()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prediction:
    """What the twin expects of a window before it looks at it."""

    model: Model
    unworn: Model | None  # the model of the time when the flanks were new, None where it had no effects
    curve: MasterCurve
    base: float  # work at the start of the curve [rad/N]
    revolutions: float  # of the window, never fewer than seen before
    track: WearTrack  # carried on to the window
    depth: float  # by the track [m]
    expectation: Expectation
    lines: np.ndarray  # acceleration lines (LINES,) [m/s²]
    frequencies: np.ndarray  # of the lines [Hz]
    rms: float  # in the rig's band [m/s²]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Verdict:
    """What one method of updating says of a window."""

    method: str
    depth: float
    depth_band: tuple[float, float]
    rms_predicted: float
    rms_after: float
    updated: bool
    lines: np.ndarray
    notes: tuple[str, ...] = ()


def unworn_model(rig: Rig, memory: Memory) -> Model | None:
    """The model of the time when the flanks were new; None where it had no effects."""
    return model_of(rig, memory) if memory.active(0.0) else None


def projected_std(track: WearTrack, depth: float) -> float:
    """Standard deviation of a depth [m] carried on from earlier windows: the track's, and what all depths share."""
    relative = track.work_std / track.work if track.work > 0 else 0.0
    return depth * float(np.hypot(relative, np.hypot(DEPTH.model_scatter[0], DEPTH.shape_scatter * depth)))


def predict(rig: Rig, memory: Memory, window: Measured, index: int) -> Prediction:
    """What the twin expects of a window."""
    model, curve = model_of(rig, memory, window.revolutions), curve_of(rig, memory)
    unworn, base = unworn_model(rig, memory), memory.segments[-1].start_work
    revolutions = max(window.revolutions, memory.track.revolutions)
    track = memory.track.predicted(revolutions)
    depth = max(curve.depth_at(track.work - base), curve.start_depth)
    expectation = Expectation.at(model, curve, window.condition, depth, unworn)
    lines, frequencies = predicted_lines(memory, expectation, depth, index, rig.teeth[0])
    return Prediction(
        model=model, unworn=unworn, curve=curve, base=base, revolutions=revolutions, track=track, depth=depth,
        expectation=expectation, lines=lines, frequencies=frequencies,
        rms=expectation.rms(lines, rig.teeth[0], rig.band, window.noise),
    )  # fmt: skip


def measurement_window(
    rig: Rig, memory: Memory, window: Measured, index: int, options: UpdateOptions, scatter: DepthScatter = SCATTER
) -> UpdateOutcome:
    """Updates the twin by a window of the campaign; NotAvailable where the method in use lacks what it needs."""
    features, condition = window.features, window.condition
    allowed = window.revolutions <= options.update_until
    telling = allowed and not window.unworn  # unworn teeth show no wear rate
    expected = predict(rig, memory, window, index)
    found = _measured(rig, memory, window, expected)
    estimate, expectation = None, expected.expectation
    notes: tuple[str, ...] = ()
    if found is not None:
        expectation, estimate, notes = found.expectation, found.estimate, found.notes
        memory = found.memory if allowed else memory
    rms_result = _by_level(rig, memory, window, expected, expectation, options, telling)
    if rms_result is not None:
        memory = replace(memory, rms_track=rms_result.track)
        memory = _with_rms_point(memory, expected, scatter) if telling else memory
    rms_depth = expected.curve.depth_at(memory.rms_track.work - expected.base)
    track = expected.track
    if estimate is not None and allowed:
        if telling:
            track = _followed(memory, expected, estimate, scatter, features.age_known)
            memory = _with_point(memory, expected, estimate, scatter)
        memory = _learned(rig, memory, window, expected.model, expectation, estimate, index)
    memory = replace(memory, track=track)
    if estimate is not None and allowed and not telling and not is_estimated(rig):
        memory = replace(memory, zero_std=estimate.stated_std)
    if options.update == "fused" and estimate is not None:
        verdict = _by_encoders(rig, memory, window, index, expected, expectation, estimate, allowed, options)
    else:
        verdict = _by_rms(window, expectation, rms_result, rms_depth, allowed, options, scatter)
    memory = replace(memory, updates=memory.updates + verdict.updated, depth=verdict.depth)
    if estimate is not None and allowed:
        memory = half_width.refitted(rig, memory, features, condition, estimate.depth)
    return UpdateOutcome(
        memory=memory, model=expected.model, curve=expected.curve, condition=condition, kind="measurement",
        rms_measured=window.rms, rms_predicted=verdict.rms_predicted, rms_after=verdict.rms_after,
        updated=verdict.updated, depth=verdict.depth, depth_band=verdict.depth_band, method=verdict.method,
        estimate=estimate, rms_result=rms_result, rms_depth=rms_depth, expectation=expectation, lines=verdict.lines,
        torque_fault=window.torque_fault, unworn=window.unworn, age_known=features.age_known,
        notes=(*notes, *_notes_on(window), *verdict.notes, *_notes_on_depth(estimate, expectation)),
    )  # fmt: skip


def _measured(rig: Rig, memory: Memory, window: Measured, expected: Prediction) -> SettledDepth | None:
    """The depth that the encoders show; None where there are none."""
    features, condition, near = window.features, window.condition, expected.expectation
    if not is_estimated(rig):
        return settled(
            memory, features, expected.model, condition,
            lambda gauge: depth_from(gauge, near, expected.model, expected.depth, expected.unworn),
        )  # fmt: skip
    search = (
        of_known_depth(near, expected.model, 0.0)
        if window.unworn
        else of_unknown_depth(near, expected.model, expected.depth, expected.unworn)
    )
    return settled_jointly(rig, memory, features, condition, search)


def _by_level(
    rig: Rig,
    memory: Memory,
    window: Measured,
    expected: Prediction,
    expectation: Expectation,
    options: UpdateOptions,
    telling: bool,
) -> RmsResult | None:
    """The update by the RMS alone; None where there is no level."""
    if window.rms is None:
        return None

    def level(work: float) -> float:
        """RMS [m/s²] at a work [rad/N] by the calibrated twin alone, without what encoders taught."""
        lines = expectation.lines(expected.curve.depth_at(work - expected.base)).acceleration
        return expectation.rms(lines, rig.teeth[0], rig.band, window.noise)

    return rms_update.update(
        memory.rms_track,
        expected.revolutions,
        window.rms,
        level,
        options.threshold,
        allowed=telling and window.level_fault is None,
    )


def _followed(
    memory: Memory, expected: Prediction, estimate: DepthEstimate, scatter: DepthScatter, age_known: bool
) -> WearTrack:
    """The track after a window whose depth the encoders gave."""
    curve, depth = expected.curve, estimate.depth
    work = expected.base + curve.work_at(depth)
    std = _own_std(estimate, scatter)
    std *= curve.work_per_depth(depth)
    if not memory.track.windows and not age_known:
        return memory.track.first_seen(expected.revolutions, work, std)
    return memory.track.followed(expected.revolutions, work, std)


def _own_std(estimate: DepthEstimate, scatter: DepthScatter) -> float:
    """What of a depth is independent from window to window [m]."""
    return float(np.hypot(estimate.noise_std, np.hypot(scatter.relative * estimate.depth, scatter.floor)))


def _with_point(memory: Memory, expected: Prediction, estimate: DepthEstimate, scatter: DepthScatter) -> Memory:
    """The memory with what the encoders measured of the wear; unchanged without a measure, or where a window is late.

    A window that comes after a later one was measured at another count of revolutions than the present.
    """
    if not np.isfinite(estimate.std) or (memory.points and expected.revolutions <= memory.points[-1].revolutions):
        return memory
    stated = stated_std(estimate, memory)
    shared = float(np.sqrt(max(stated**2 - (estimate.stated * estimate.noise_std) ** 2, 0.0)))
    point = _point(expected, estimate.depth, shared, _own_std(estimate, scatter))
    return replace(memory, points=with_point(memory.points, point))


def _with_rms_point(memory: Memory, expected: Prediction, scatter: DepthScatter) -> Memory:
    """The memory with what the RMS alone gave of the wear."""
    depth = max(expected.curve.depth_at(memory.rms_track.work - expected.base), expected.curve.start_depth)
    shared = depth * (scatter.rms_high - scatter.rms_low) / (2 * Z95)
    point = _point(expected, depth, shared, scatter.rms_own * depth)
    return replace(memory, rms_points=with_point(memory.rms_points, point))


def _point(expected: Prediction, depth: float, shared: float, own: float) -> WearPoint:
    slope = expected.curve.work_per_depth(depth)
    return WearPoint(
        revolutions=expected.revolutions, depth=depth, work=expected.base + expected.curve.work_at(depth),
        shared_std=shared * slope, own_std=own * slope,
    )  # fmt: skip


def _learned(
    rig: Rig,
    memory: Memory,
    window: Measured,
    model: Model,
    expectation: Expectation,
    estimate: DepthEstimate,
    index: int,
) -> Memory:
    """The memory with phase, disc offset and factors of path and mesh as the window shows them at its depth."""
    features = window.features
    if memory.line_factors is None:
        memory = encoders.learn(memory, features, model, expectation, estimate, estimate.from_lines, None)
    usable = features if window.level_fault is None else replace(features, acceleration=None)
    path, mesh = encoders.factors(usable, expectation, estimate.depth, estimate.phase, index, rig.teeth[0])
    return replace(memory, path=with_lines(memory.path, path), mesh=with_lines(memory.mesh, mesh))


def _by_encoders(
    rig: Rig,
    memory: Memory,
    window: Measured,
    index: int,
    expected: Prediction,
    expectation: Expectation,
    estimate: DepthEstimate,
    allowed: bool,
    options: UpdateOptions,
) -> Verdict:
    """The fused method: the depth of the encoders, the level with what was learned of path and mesh."""
    error = 0.0 if window.rms is None else expected.rms / window.rms - 1
    updated = allowed and window.level_fault is None and abs(error) > options.threshold
    unworn = allowed and window.unworn
    depth, std = estimate.depth, estimate.stated_std if unworn else stated_std(estimate, memory)
    method = "pinion encoder" if window.features.transmission_error is None else "transmission error"
    if not allowed:
        depth, std, method = expected.depth, projected_std(expected.track, expected.depth), "projection"
    lines, rms_after, notes = expected.lines, expected.rms, []
    if updated and window.rms is not None:
        lines, _ = predicted_lines(memory, expectation, depth, index, rig.teeth[0])
        rms_after = expectation.rms(lines, rig.teeth[0], rig.band, window.noise)
        if abs(rms_after / window.rms - 1) > options.threshold:
            notes.append(_remaining_difference(window.features, lines, expected.frequencies, rig.band))
    return Verdict(
        method=method,
        depth=depth,
        depth_band=estimate.band if allowed and estimate.band else depth_band(depth, std),
        rms_predicted=expected.rms,
        rms_after=rms_after,
        updated=updated,
        lines=lines,
        notes=tuple(notes),
    )


def _by_rms(
    window: Measured,
    expectation: Expectation,
    result: RmsResult | None,
    depth: float,
    allowed: bool,
    options: UpdateOptions,
    scatter: DepthScatter,
) -> Verdict:
    """The RMS method; NotAvailable where there is no level."""
    if result is None:
        needs = "update = rms needs the level" if options.update == "rms" else "no encoder measures the depth"
        raise NotAvailable(f"the depth is not available: {window.level_fault}, and {needs}")
    notes: tuple[str, ...] = ()
    if result.updated and not result.converged:
        notes = ("no wear coefficient brings the predicted RMS within the threshold",)
    return Verdict(
        method="rms" if allowed else "projection",
        depth=depth,
        depth_band=(scatter.rms_low * depth, scatter.rms_high * depth),
        rms_predicted=result.rms_predicted,
        rms_after=result.rms_after,
        updated=bool(result.updated),
        lines=expectation.lines(depth).acceleration,
        notes=notes,
    )


def _notes_on(window: Measured) -> list[str]:
    """What the window lacks."""
    notes = []
    if window.level_fault is not None:
        notes.append(f"the level was not compared: {window.level_fault}")
    if window.torque_fault is not None:
        notes.append(f"the torque of {window.condition.torque:.4g} N·m is doubtful: {window.torque_fault}")
    if window.features.torque_nm is None:
        notes.append(f"no torque in this window: the rig file's nominal {window.condition.torque:g} N·m is used")
    return notes


def _notes_on_depth(estimate: DepthEstimate | None, expectation: Expectation) -> list[str]:
    """Where the model ends."""
    notes = []
    if estimate is not None and estimate.at_limit:
        notes.append("the depth is at the end of the wear curve: no steady state is known beyond it")
    if not expectation.solved:
        notes.append("no steady state was found at this window's condition: its response follows the wear curve")
    return notes


def _remaining_difference(features: WindowFeatures, lines: np.ndarray, frequencies: np.ndarray, band) -> str:
    """Why the RMS still differs after an update: what the mesh lines make, of the model and measured.

    The lines of the model alone may exceed all that was measured in the band.
    """
    mesh, own = band_rms(lines, frequencies, band, 0.0), ""
    if features.acceleration is not None:
        k, y, _ = features.acceleration.mesh()
        at = frequencies[np.minimum(k, LINES) - 1]
        inside = (k <= LINES) & (at >= band[0]) & (at <= band[1])
        own = f" (its mesh lines: {float(np.sqrt(0.5 * np.sum(np.abs(y[inside]) ** 2))):.3g} m/s²)"
    predicted = f"after the update the mesh lines of the model make {mesh:.3g} m/s²"
    assert features.rms is not None  # the level was compared
    if mesh > features.rms:
        return f"{predicted}, which is more than all that was measured in the band: {features.rms:.3g} m/s²{own}"
    return f"{predicted}; the vibration measured in the band is {features.rms:.3g} m/s²{own}"
