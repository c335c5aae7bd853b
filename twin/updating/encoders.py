"""What is learned from the encoders: depth gauge, mesh phase, the discs' offset, the path to the accelerometer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.errors import NotAvailable
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.model import Condition, Model
from twin.thresholds import deciding
from twin.updating.depth import DEPTH, HARMONICS, DepthEstimate, Gauge
from twin.updating.line_scatter import line_scatter
from twin.updating.memory import Line, MeanOffset, Memory
from twin.updating.prediction import MESH, Expectation, parts
from twin.wear.curve import LINES

DEPTH_HARMONICS = range(1, HARMONICS + 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderScatter:
    """How far what encoders show changes without wear, and which lines are worth learning from."""

    offset_drift: float = deciding(
        1.5e-6,
        unit="m",
        meaning="drift of the discs' zeros from window to window, at the base radius",
        source="not derived: heat, and creep of a mounting",
    )
    compliance: float = deciding(
        0.05,
        of="mean transmission error per torque",
        meaning="relative uncertainty of the compliance outside the mesh",
        source="not derived: shaft stiffnesses within the tolerance of a rig file",
    )
    mean_noise: float = deciding(
        0.3e-6,
        unit="m",
        meaning="noise of the mean transmission error of one window",
        source="not derived: as much as 0.04 N·m of torque wander on the reference rig",
    )
    same_speed: float = deciding(
        0.05,
        of="speed",
        meaning="difference up to which lines of two windows may be subtracted from one another",
        source="not derived: the change of speed that starts a new segment",
    )
    same_torque: float = deciding(
        0.10,
        of="torque",
        meaning="difference up to which lines of two windows may be subtracted from one another",
        source="not derived: the change of torque that starts a new segment",
    )
    unworn_phase: float = deciding(
        0.6,
        unit="rad",
        meaning="standard deviation of the mesh phase from unworn teeth",
        source="not derived: friction and pitch errors turn the lines of unworn teeth",
    )
    phase: float = deciding(
        0.015,
        unit="rad",
        meaning="standard deviation of the mesh phase from window to window",
        source="not derived: scatter of the phase of worn windows",
    )
    least_phase: float = deciding(
        0.01,
        unit="rad",
        meaning="standard deviation of the mesh phase however many windows have been averaged",
        source="not derived: keeps a phase that creeps followed",
    )
    worn_enough: float = deciding(
        3e-6,
        unit="m",
        meaning="depth from which wear sets the phase of the mesh lines",
        source="not derived: line 1 of the reference rig is then 1.1 µm, some twenty times the unworn floor",
    )
    graduation: float = deciding(
        0.03e-6,
        unit="m",
        meaning="error of a disc's graduation and of real teeth at one mesh line",
        source="not derived: noise at mesh lines of the reference campaigns is 0.017 µm; with room for real teeth",
    )
    learn_signal: float = deciding(
        8.0,
        of="standard deviation of the line",
        meaning="amplitude from which a line of acceleration teaches the path",
        source="not derived: the factor is then known to an eighth",
    )
    learn_scatter: float = deciding(
        0.02,
        of="the learned factor",
        meaning="scatter of a learned factor from window to window, beyond noise",
        source="clean reference campaigns: ratio to the model 1.007 ± 0.024 at mesh harmonics 2 and 3",
    )


ENCODERS = EncoderScatter()


def encoder_lines(features: WindowFeatures) -> MeasuredLines | None:
    """Transmission error where both encoders are there, else the pinion's own motion; in metres or None."""
    lines = features.transmission_error or features.pinion_motion
    return lines if lines is not None and lines.unit == "m" else None


def _lines_of(features: WindowFeatures) -> MeasuredLines:
    """As `encoder_lines`; NotAvailable where there are none."""
    lines = encoder_lines(features)
    if lines is None:
        raise NotAvailable("the window has no encoder lines")
    return lines


def gauge_of(features: WindowFeatures, memory: Memory, model: Model, condition: Condition) -> Gauge | None:
    """What the window's encoders measure of the depth; None where there are none."""
    seen = encoder_lines(features)
    if seen is None:
        return None
    if not has_depth_lines(seen):
        return None
    mean, mean_std = None, float("nan")
    raw = mean_less_load(features, memory, model, condition)
    if memory.offset is not None and raw is not None:
        strain = ENCODERS.compliance * model.compliance_outside_mesh * (condition.torque - memory.offset.torque)
        mean = raw - memory.offset.value
        mean_std = float(np.sqrt(memory.offset.var + ENCODERS.offset_drift**2 + ENCODERS.mean_noise**2 + strain**2))
    pinion_only = features.transmission_error is None
    lines = np.array([seen.at(k) for k in DEPTH_HARMONICS])
    std = np.array([seen.std_at(k) for k in DEPTH_HARMONICS])
    unworn = unworn_like(features, memory)
    if unworn is not None:
        start = _lines_of(unworn)
        lines = lines - np.array([start.at(k) for k in DEPTH_HARMONICS])
        std = np.hypot(std, [start.std_at(k) for k in DEPTH_HARMONICS])
    return Gauge(
        lines=lines,
        from_unworn=unworn is not None,
        lines_std=std,
        mean=mean,
        mean_std=mean_std,
        phase=memory.phase,
        phase_std=memory.phase_std,
        pinion_only=pinion_only,
        structure=line_scatter(model.rig, condition.speed_hz, pinion_only),
    )


def has_depth_lines(lines: MeasuredLines) -> bool:
    return all(lines.get(k) is not None for k in DEPTH_HARMONICS)


def _near(a: float | None, b: float | None, tolerance: float) -> bool:
    """Whether two values are known and equal within a relative tolerance."""
    return a is not None and b is not None and abs(a / b - 1) < tolerance


def unworn_like(features: WindowFeatures, memory: Memory) -> WindowFeatures | None:
    """An unworn window of the same condition, recorded earlier on the present discs; None where there is none."""
    if len(memory.segments) > 1:
        return None
    for unworn in memory.unworn[memory.unworn_before :]:
        start = encoder_lines(unworn)
        if not memory.discs_since_ns <= unworn.start_time_ns < features.start_time_ns:
            continue
        if start is None or not has_depth_lines(start):
            continue
        same = _near(unworn.speed_hz, features.speed_hz, ENCODERS.same_speed)
        loaded = features.torque_nm is None or _near(unworn.torque_nm, features.torque_nm, ENCODERS.same_torque)
        if same and loaded:
            return unworn
    return None


def mean_less_load(features: WindowFeatures, memory: Memory, model: Model, condition: Condition) -> float | None:
    """Mean transmission error less what the measured compliance adds to the rig file's [m]."""
    te = features.transmission_error
    if te is None or te.get(0) is None or features.torque_nm is None:
        return None
    return te.at(0).real - (memory.compliance_scale - 1) * model.compliance_outside_mesh * condition.torque


def learn(
    memory: Memory,
    features: WindowFeatures,
    model: Model,
    expectation: Expectation,
    estimate: DepthEstimate,
    depth: float,
    depth_std: float | None,
) -> Memory:
    """Mesh phase and disc offset after a window whose depth [m] the lines gave, or which is known with a std [m]."""
    std = ENCODERS.unworn_phase
    if estimate.depth > ENCODERS.worn_enough:
        std = float(np.hypot(ENCODERS.phase, 2 * DEPTH.floor / abs(_lines_of(features).at(1))))
    phase = estimate.phase
    if memory.phase is not None:
        w_old, w_new = 1 / memory.phase_std**2, 1 / std**2
        phase = (w_old * memory.phase + w_new * phase) / (w_old + w_new)
        std = max(float(np.sqrt(1 / (w_old + w_new))), ENCODERS.least_phase)
    memory = replace(memory, phase=phase, phase_std=std)
    raw = mean_less_load(features, memory, model, expectation.condition)
    if raw is None:
        return memory
    if depth_std is None:
        depth_std = float(np.hypot(DEPTH.model_scatter[0] * depth, 0.2e-6))
    step = 1e-6
    slope = (expectation.lines(depth + step).mean - expectation.lines(depth).mean) / step
    seen, var = raw - expectation.lines(depth).mean, (slope * depth_std) ** 2 + ENCODERS.mean_noise**2
    torque = expectation.condition.torque
    if memory.offset is None:
        return replace(memory, offset=MeanOffset(value=seen, var=var, torque=torque))
    before = memory.offset.var + ENCODERS.offset_drift**2
    gain = before / (before + var)
    return replace(
        memory,
        offset=MeanOffset(
            value=memory.offset.value + gain * (seen - memory.offset.value),
            var=(1 - gain) * before,
            torque=memory.offset.torque + gain * (torque - memory.offset.torque),
        ),
    )


def _scatter(expectation: Expectation, depth: float, quantity: str) -> np.ndarray:
    """Scatter (LINES,) of what a line teaches at a depth [m], over the line: it grows where wear nearly cancels it."""
    unworn, worn = (getattr(expectation.curve.lines_at(d), quantity) for d in (0.0, depth))
    return np.asarray(ENCODERS.learn_scatter * np.maximum(parts(worn, unworn) / np.abs(worn), 1.0))


def factors(
    features: WindowFeatures, expectation: Expectation, depth: float, phase: float, index: int, teeth: int
) -> tuple[list[Line], list[Line]]:
    """Measured over predicted, line by line, at a depth [m]: the path to the accelerometer, and the mesh lines.

    A weak line of transmission error is mostly the discs' own graduation. So what goes through the path is the mean of
    the measured and the predicted line, weighted by what each is worth; the product of both factors is that of the
    measured and the predicted acceleration in any case.
    """
    lines = expectation.lines(depth)
    pinion_only = features.transmission_error is None
    model = lines.pinion_motion if pinion_only else lines.transmission_error
    seen, measured = _lines_of(features), features.acceleration
    quantity = "pinion_motion" if pinion_only else "transmission_error"
    scatter_mesh, scatter_path = (_scatter(expectation, depth, name) for name in (quantity, "acceleration"))
    path: list[Line] = []
    mesh: list[Line] = []
    for k in range(1, LINES + 1):
        f = k * teeth * expectation.condition.speed_hz
        predicted = model[k - 1] * np.exp(1j * k * phase)
        x, var = predicted, (MESH.spread * abs(predicted)) ** 2
        if seen.get(k) is not None:
            var_seen = ENCODERS.graduation**2 + seen.std_at(k) ** 2
            x = (predicted / var + seen.at(k) / var_seen) / (1 / var + 1 / var_seen)
            var = 1 / (1 / var + 1 / var_seen)
            scatter = float(np.hypot(np.sqrt(var) / abs(x), scatter_mesh[k - 1]))
            mesh.append((float(index), f, complex(x / predicted), scatter))
        if measured is None or measured.get(k) is None:
            continue
        y, y_std = measured.at(k), measured.std_at(k)
        if abs(y) > ENCODERS.learn_signal * y_std:
            ρ = complex((y / x) / (lines.acceleration[k - 1] / model[k - 1]))
            noise = float(np.hypot(scatter_path[k - 1], y_std / abs(y)))
            path.append((float(index), f, ρ, noise * max(abs(ρ), 0.1)))
    return path, mesh
