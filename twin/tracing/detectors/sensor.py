"""Is the accelerometer wrong? Its gain or a resonance of its mount, from the acceleration over the transmission error.

A change of gain between two windows, or a drift of it, by which all lines change alike, is the sensor's whatever the
structure; one along the curve of a resonance is its mount's; where each line changes by a factor of its own, the
structure has changed. A gain or a resonance that was
there from the start must stand out from the rig file's tolerance of the structure, and from a structure of another
kind.

Source   twin/tracing/transfer_path.py; twin/effects/sensor_gain.py, sensor_resonance.py
Holds    both encoders; whatever excites the mesh, teeth that differ from one another too: the quotient cancels it
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects.sensor_gain import SensorGain
from twin.effects.sensor_resonance import SensorResonance
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import TracingContext
from twin.tracing.detectors.mesh import wear_alone
from twin.tracing.findings import Findings
from twin.tracing.gain_change import DRIFT, GainChange, Mounted, change_of_lines, gain_change, mount_change
from twin.tracing.transfer_path import PathFit, fit_sensor, quotients

TUNED = "tuned on D00–D13 and T01–T58; not derived"


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorThresholds:
    """When the accelerometer is taken to be wrong."""

    step_evidence: float = deciding(
        15.0, unit="nat", meaning="evidence of a gain that changes between two windows", source=TUNED
    )
    least_evidence: float = deciding(
        6.0, unit="nat", meaning="evidence of a wrong sensor against a good one", source=TUNED
    )
    over_other_structure: float = deciding(
        6.0,
        unit="nat",
        meaning="evidence of a wrong sensor against a structure of another kind",
        source="as against a good one; tuned on the wide evaluation's first draw: a loose bearing reaches 5, changed "
        "gains and resonances 16 and more",
    )
    least_gain: float = deciding(
        0.06,
        meaning="|ln gain| at the latest window that is reported",
        source="not derived: 6 %, twice a good sensor's tolerance",
    )


THRESHOLDS = SensorThresholds()


def detect(context: TracingContext, limits: SensorThresholds = THRESHOLDS) -> Findings:
    """The findings with what is wrong with the accelerometer, and whether the structure is not the rig file's."""
    findings = context.findings
    if findings.other_structure:
        return findings
    mesh = wear_alone(context) if findings.mesh is None else findings.mesh
    if any(o.pinion_only for o in mesh.windows):
        return findings
    shown = {w.index: w.observed for w in context.mounted}  # not as a sound accelerometer would have shown them
    windows = [shown[o.index] for o in mesh.windows]
    seen = quotients(mesh.best, windows, context.model.mesh.pair.teeth[0], context.scales.graduation[0])
    tolerance = context.rig.tolerances.accelerometer_gain
    resonant = mount_change(seen, context.rig.band[1], tolerance)
    needed = context.required.least("sensor_resonance", limits.least_evidence)
    if resonant is not None and resonant.mount.log_evidence > needed:
        return findings.adding(_of_mount(resonant), rejected=context.rejected)
    change = gain_change(seen, tolerance)
    if change is not None:
        drifts = change.law.kind == "linear"
        midway = 0.5 * (change.onset + max(q.revolutions for q in seen))
        lines = change_of_lines(seen, midway if drifts else change.onset, tolerance)
        if lines.apart > lines.shared and lines.apart > limits.least_evidence:
            return replace(findings, other_structure=True)
        needed = context.required.least("sensor_gain", DRIFT.least_evidence if drifts else limits.step_evidence)
        clear = change.log_evidence > needed and lines.shared > lines.apart
        if clear and abs(np.log(change.gain)) > limits.least_gain:
            return findings.adding(_of_change(change), rejected=context.rejected)
    fits = fit_sensor(context.rig, context.model.calibration.modal_damping, seen)
    if not fits:
        return findings
    best = max(fits, key=lambda s: s.log_evidence)
    size = abs(np.log(best.effect.gain)) if isinstance(best.effect, SensorGain) else np.inf
    other = max(s.over_other for s in fits) < limits.over_other_structure
    needed = context.required.least(best.name, limits.least_evidence)
    known = best.log_evidence > needed and best.over_other > limits.over_other_structure
    if known and size > limits.least_gain:
        findings = findings.adding(_of_fit(best, [s for s in fits if s is not best]), rejected=context.rejected)
    return replace(findings, other_structure=other)


def _of_fit(best: PathFit, others: Sequence[PathFit]) -> AttributedEffect:
    effect = best.effect
    if isinstance(effect, SensorGain):
        parameters = {"gain": (float(effect.gain), "", float(effect.gain * best.std))}
    else:
        assert isinstance(effect, SensorResonance)
        parameters = _of_resonance(effect, best.std, best.damping_std)
    other = max(others, key=lambda s: s.log_evidence, default=None)
    return AttributedEffect.of(
        effect,
        parameters=parameters,
        log_evidence=best.log_evidence,
        runner_up=None if other is None else other.name,
        over_runner_up=None if other is None else best.log_evidence - other.log_evidence,
    )


def _of_change(change: GainChange) -> AttributedEffect:
    drifts = change.law.kind == "linear"
    how = "has drifted evenly over several windows" if drifts else "has changed between two windows"
    return AttributedEffect.of(
        SensorGain(gain=change.gain),
        onset=change.onset,
        law=change.law,
        onset_std=change.onset_std,
        parameters={"gain": (change.gain, "", change.gain * change.std)},
        log_evidence=change.log_evidence,
        detail=f"the gain {how}: no structure does that",
    )


def _of_mount(change: Mounted) -> AttributedEffect:
    mount = change.mount
    return AttributedEffect.of(
        mount.effect,
        onset=change.onset,
        onset_std=change.onset_std,
        parameters=_of_resonance(mount.effect, mount.std, mount.damping_std),
        log_evidence=mount.log_evidence,
        detail="the lines have changed between two windows along the curve of one resonance: no gain and no structure "
        "does that",
    )


def _of_resonance(effect: SensorResonance, std: float, damping_std: float) -> dict[str, tuple[float, str, float]]:
    """Its numbers; `std` is that of ln of the frequency."""
    return {
        "frequency": (float(effect.frequency), "Hz", float(effect.frequency * std)),
        "damping_ratio": (float(effect.damping_ratio), "", damping_std),
    }
