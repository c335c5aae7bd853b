"""One window's features into the twin's memory: prediction, comparison, update."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

from twin.features.window_features import WindowFeatures
from twin.model import Condition
from twin.rig import Rig
from twin.structure_spread import is_estimated
from twin.thresholds import deciding
from twin.updating import encoders
from twin.updating.calibration import calibrate, compliance_scale
from twin.updating.conditions import Measured
from twin.updating.depth_search import phase_of_known_depth
from twin.updating.joint_update import of_known_depth, settled_jointly
from twin.updating.measurement import SCATTER, measurement_window, projected_std, unworn_model
from twin.updating.memory import Memory
from twin.updating.model_cache import curve_of, model_of, start_of_curve
from twin.updating.outcome import UpdateOptions, UpdateOutcome, depth_band
from twin.updating.prediction import Expectation, predicted_lines
from twin.updating.rms_update import RmsTrack
from twin.updating.segments import with_segment
from twin.updating.tracker import WearTrack

__all__ = ["NEEDED", "UpdateOptions", "UpdateOutcome", "reference_rate", "update_twin"]

NEEDED = (
    "gears.module", "gears.pressure_angle_deg", "gears.face_width", "gears.addendum", "gears.dedendum",
    "gears.youngs_modulus", "gears.poisson_ratio", "gears.pinion.bore_radius", "gears.gear.bore_radius",
    "inertias.J5", "masses.m5", "bearings.ky_input", "shafts.bending_stiffness_input", "torsional_stiffness.k_3_5",
    "damping.modal_ratio", "mesh.relative_damping_time", "mesh.stiffness_scale", "wear.K", "wear.dwell_time",
    "wear.contact_half_width", "sensors.accelerometer", "operating.pinion_speed_hz",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationWindows:
    """Which windows the calibration rests on."""

    most: int = deciding(
        6,
        unit="windows",
        meaning="unworn windows that a calibration rests on at most, the first ones",
        source="not derived: chosen so that two tests at two loads and the first windows of the campaign are used",
    )


WINDOWS = CalibrationWindows()


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


def _calibrated(rig: Rig, memory: Memory, features: WindowFeatures) -> Memory:
    """The memory with the calibration refitted on one more unworn window."""
    memory = replace(memory, unworn=(*memory.unworn, features))
    then = features.revolutions or 0.0
    memory = replace(memory, fit=calibrate(model_of(rig, replace(memory, fit=None), then), memory.unworn))
    return replace(memory, compliance_scale=compliance_scale(model_of(rig, memory, then), memory.unworn))


def _calibrates(memory: Memory, window: Measured, windows: CalibrationWindows = WINDOWS) -> bool:
    """Whether a window is one of unworn flanks with a known load and a level, and the calibration still open."""
    known_load = window.kind == "measurement" or window.features.torque_nm is not None
    still_open = memory.track.windows == 0 and len(memory.unworn) < windows.most
    sound = window.level_fault is None and window.torque_fault is None
    return window.unworn and known_load and sound and still_open


def update_twin(
    rig: Rig,
    memory: Memory,
    features: WindowFeatures,
    index: int,
    options: UpdateOptions,
    *,
    level_fault: str | None = None,
    torque_fault: str | None = None,
) -> UpdateOutcome:
    """Updates the twin by one window.

    Raises NotAvailable where the rig file or the window does not suffice. That the revolution count continues the
    count seen before is the caller's to check (twin/fallen_count.py).
    """
    rig.require("wear", *NEEDED)
    window = Measured.of(features, rig, level_fault, torque_fault)
    if not (window.unworn or memory.track.windows):
        window = replace(window, kind="measurement")  # of flanks that nothing is known of, at whatever speed
    memory = _started(rig, memory)
    if _calibrates(memory, window):
        memory = _calibrated(rig, memory, features)
    if window.kind == "calibration":
        return _calibration_window(rig, memory, window, index)
    memory = with_segment(rig, memory, window.condition, window.revolutions)
    return measurement_window(rig, memory, window, index, options)


def _calibration_window(rig: Rig, memory: Memory, window: Measured, index: int) -> UpdateOutcome:
    """A low-speed window: it calibrates, and shows how the calibrated twin meets it; it wears nothing."""
    features, condition, track = window.features, window.condition, memory.track
    if not memory.segments:
        speed, torque = rig.require("the wear curve", "operating.pinion_speed_hz", "operating.input_torque")
        memory = with_segment(rig, memory, Condition(speed_hz=speed, torque=torque))
    model = model_of(rig, memory, window.revolutions)
    curve = curve_of(rig, memory) if track.windows else start_of_curve(rig, memory)
    depth = curve.depth_at(track.work - memory.segments[-1].start_work)
    expectation = Expectation.at(model, curve, condition, depth, unworn_model(rig, memory))
    lines, _ = predicted_lines(memory, expectation, depth, index, rig.teeth[0])
    rms = expectation.rms(lines, rig.teeth[0], rig.band, window.noise)
    gauge = None if is_estimated(rig) else encoders.gauge_of(features, memory, model, condition)
    estimate = None
    if is_estimated(rig):
        found = settled_jointly(rig, memory, features, condition, of_known_depth(expectation, model, depth))
        memory, estimate = (memory, None) if found is None else (found.memory, found.estimate)
    elif gauge is not None:
        estimate = phase_of_known_depth(gauge, expectation, depth)
        memory = encoders.learn(memory, features, model, expectation, estimate, depth, SCATTER.floor)
    return UpdateOutcome(
        memory=memory, model=model, curve=curve, condition=condition, kind="calibration",
        rms_measured=window.rms, rms_predicted=rms,
        rms_after=rms, updated=False, depth=depth, depth_band=depth_band(depth, projected_std(track, depth)),
        method="projection" if track.windows else "unworn", estimate=estimate, rms_result=None, rms_depth=depth,
        expectation=expectation, lines=lines, torque_fault=window.torque_fault,
        unworn=window.unworn, age_known=features.age_known,
    )  # fmt: skip
