"""What changes the mesh lines of all teeth alike? The mesh search over the effects that declare this detector.

The windows are fitted together with wear alone, then with candidates; where teeth differ from one another, with what
they make of the mesh lines. A machine whose path to the accelerometer is not the rig file's is judged by its encoders
alone: what acts in the mesh moves the mesh lines first, another structure moves the path out of all proportion.

Source   the search: twin/tracing/mesh_search.py; the path: twin/tracing/transfer_path.py
Holds    windows with both encoders, or with the accelerometer and a known structure
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import TracingContext
from twin.tracing.detectors.tooth_errors import tooth_additions
from twin.tracing.findings import Findings
from twin.tracing.joint_fit import JointFit
from twin.tracing.joint_problem import EffectTrial
from twin.tracing.mesh_fits import AlikeTeeth, DifferingTeeth, Fits
from twin.tracing.mesh_search import MeshFindings, search_mesh
from twin.tracing.mesh_trials import fitted_numbers, plain
from twin.tracing.mesh_windows import MeshWindows
from twin.tracing.observed import Observed, chosen
from twin.tracing.scatter import MODELLED, HealthyScatter
from twin.tracing.size_laws import interval_std
from twin.tracing.tooth_factors import factors_of
from twin.tracing.transfer_path import fit_sensor, quotients


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshThresholds:
    """Which windows the mesh search fits, and when the structure is taken to be another than the rig file's."""

    most_windows: int = deciding(
        8, meaning="windows that the mesh lines are fitted on", source="not derived: chosen for the time of a search"
    )
    out_of_proportion: float = deciding(
        30.0,
        unit="nat per misfit",
        meaning="evidence of another structure, over the misfit of the mesh lines, from which it is believed",
        source="between two observed values: friction reaches 2.5, other structures 200 and more",
    )
    granted_misfit: float = deciding(
        5.0, meaning="misfit that the comparison above assumes at least", source="not derived: chosen"
    )
    quiet_with_other_structure: float = deciding(
        10.0,
        meaning="misfit of the encoders' lines that another structure may leave",
        source="tuned on D00–D13 and T01–T58; not derived",
    )


THRESHOLDS = MeshThresholds()


def detect(context: TracingContext, limits: MeshThresholds = THRESHOLDS) -> Findings:
    """The findings with the effects on the mesh, and whether the path to the housing is the rig file's."""
    mesh = mesh_windows(context, limits)
    base = mesh.plain()
    trials = [t for t in (f.kept for f in context.kept if f.name not in context.rejected) if t is not None]
    elsewhere = _other_structure(context, mesh, base.fit, limits)
    if elsewhere:
        mesh = replace(mesh, channels=("encoder",))
        base = mesh.plain()
    fits: Fits = AlikeTeeth(windows=mesh)
    if mesh.factors is not None:
        fits = DifferingTeeth(
            windows=mesh, profiles=context.profiles, teeth=lambda effects: tooth_additions(context, effects)
        )
    tolerated = max(limits.quiet_with_other_structure if elsewhere else 0.0, context.tolerated)
    found = search_mesh(fits, skip=context.rejected, tolerated=tolerated, kept=trials, fixed=context.fixed, base=base)
    effects = attributed(found, context.kept)
    return replace(context.findings.adding(*effects, rejected=context.rejected), mesh=found, other_structure=elsewhere)


def mesh_windows(context: TracingContext, limits: MeshThresholds = THRESHOLDS) -> MeshWindows:
    """The windows that mesh lines are fitted on, with what teeth that differ make of them."""
    fresh = [_heard_well(w.observed, context) for w in context.mounted if w.index not in context.held_out]
    picked = chosen(fresh, limits.most_windows)
    start = np.array([context.depths.get(o.index, 0.0) for o in picked])
    teeth = [f.addition for f in context.findings.tooth_errors]
    factors = factors_of(context.model, picked, context.profiles, teeth)
    return MeshWindows(
        model=context.model,
        windows=tuple(picked),
        depth=start,
        phase=context.mesh_phase,
        factors=factors,
        scatter=HealthyScatter.of_rig(context.rig, context.scales),
        required=context.required,
    )


def _heard_well(window: Observed, context: TracingContext) -> Observed:
    """A window's lines as an accelerometer without its faults would have shown them."""
    faults = [f.addition for f in context.findings.effects if f.addition.effect.facts.acts_on == "sensor"]
    lines, std = window.lines["acceleration"], window.std["acceleration"]
    frequency = window.condition.speed_hz * context.rig.teeth[0] * np.arange(1, lines.size + 1)
    for fault in faults:
        effect: Any = fault.at(window.revolutions)
        if effect is not None:
            gain = effect.response(frequency)
            lines, std = lines / gain, std / np.abs(gain)
    if not faults:
        return window
    return replace(window, lines={**window.lines, "acceleration": lines}, std={**window.std, "acceleration": std})


def wear_alone(context: TracingContext) -> MeshFindings:
    """The mesh lines fitted with wear alone, where the mesh search has not run."""
    mesh = mesh_windows(context)
    base = mesh.plain().fit
    return MeshFindings(model=mesh.model, windows=mesh.windows, base=base, best=base, found=(), table=(), runner_up={})


def _other_structure(context: TracingContext, mesh: MeshWindows, base: JointFit, limits: MeshThresholds) -> bool:
    """Whether the path to the accelerometer alone says that the structure is not the rig file's."""
    if any(o.pinion_only for o in mesh.windows):
        return False
    seen = quotients(base, mesh.windows, context.model.mesh.pair.teeth[0], context.scales.graduation[0])
    fits = fit_sensor(context.rig, context.model.calibration.modal_damping, seen)
    least = limits.out_of_proportion * max(base.misfit, limits.granted_misfit)
    return bool(fits) and max(s.over_other for s in fits) < -least


def attributed(findings: MeshFindings, kept: Sequence[AttributedEffect]) -> list[AttributedEffect]:
    """What the mesh lines show; those kept from before with the rivals that they had then."""
    before = {f.name: f for f in kept}
    out = []
    additions = findings.best.additions()
    widen = max(1.0, float(np.sqrt(findings.best.misfit)))
    for candidate in findings.found:
        name = candidate.trial.name
        trial = next(t for t in findings.best.trials if t.name == name)
        numbers, std = findings.best.numbers(trial)
        addition = additions[findings.best.trials.index(trial)]
        parameters = {}
        for number, u, s in zip(fitted_numbers(name), numbers, std * widen, strict=False):  # of the first stage
            value = number.value(u)
            spread = abs(number.value(u + s) - value)
            std_with_model = float(np.hypot(spread, MODELLED * abs(value)))
            parameters[number.parameter.name] = (value, number.parameter.unit, std_with_model)
        other, alike = findings.runner_up.get(name), findings.alike.get(name, ())
        evidence = candidate.gain
        if name in before and other is None:
            known = before[name]
            alike = known.alike
            if known.runner_up is not None and known.over_runner_up is not None:
                other = (known.runner_up, known.over_runner_up)
        out.append(
            AttributedEffect.of(
                plain(addition.effect),
                onset=float(trial.onset),
                law=addition.law,
                onset_std=_onset_std(findings, trial, before.get(name)),
                change_std=_change_std(findings, trial, numbers, std * widen, before.get(name)),
                parameters=parameters,
                log_evidence=float(evidence),
                runner_up=None if other is None else other[0],
                over_runner_up=None if other is None else float(other[1]),
                alike=alike,
                numbers=tuple(float(u) for u in numbers),
            )
        )
    return out


def _onset_std(findings: MeshFindings, trial: EffectTrial, before: AttributedEffect | None) -> float | None:
    """Standard deviation of an onset [revolutions], the interval between the windows about it included."""
    if trial.onset == 0:
        return None
    if trial.name in findings.laws:
        return findings.laws[trial.name].onset_std
    if before is not None and before.addition.onset_revolutions == trial.onset:
        return before.onset_std
    turns = [w.revolutions for w in findings.windows]
    return interval_std(turns, trial.onset)


def _change_std(
    findings: MeshFindings, trial: EffectTrial, numbers: np.ndarray, std: np.ndarray, before: AttributedEffect | None
) -> tuple[float, float] | None:
    """Standard deviations of the second change's revolutions and of its factor; None where there is none."""
    if not trial.law.changes:
        return None
    law = findings.laws.get(trial.name)
    if law is None or law.second_std is None:
        return None if before is None else before.change_std
    first, second = numbers[0], numbers[1]
    factor = float(np.hypot(std[1], std[0] * second / first) / abs(first)) if first else 0.0
    return law.second_std, factor
