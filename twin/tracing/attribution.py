"""An effect that was found, with what speaks for it, from the fits of every kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.effects.addition import Addition
from twin.effects.sensor_gain import SensorGain
from twin.effects.sensor_resonance import SensorResonance
from twin.effects.tooth_crack import ToothCrack
from twin.tracing.eccentricities import EccentricityFit
from twin.tracing.joint_problem import EffectTrial
from twin.tracing.mesh_search import ALIKE, MeshFindings
from twin.tracing.mesh_trials import fitted_numbers, plain, started, trial_of
from twin.tracing.non_gear import Defect
from twin.tracing.scatter import MODELLED
from twin.tracing.shaft_forces import Turning
from twin.tracing.teeth import ToothFinding
from twin.tracing.transfer_path import GainStep, PathFit

ANYWHERE = float(np.pi / np.sqrt(3))  # std of an angle of which nothing is known [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class AttributedEffect:
    """An effect with what speaks for it."""

    addition: Addition
    parameters: dict[str, tuple[float, str, float]]  # value, unit, std
    log_evidence: float
    runner_up: str | None = None
    over_runner_up: float | None = None
    alike: tuple[str, ...] = ()  # what the channels there are cannot tell it from
    detail: str = ""
    numbers: tuple[float, ...] = ()  # of an effect on the mesh: as fitted, in units of the priors

    @property
    def name(self) -> str:
        return self.addition.name

    @property
    def kept(self) -> EffectTrial | None:
        """The trial that starts from here; None of effects that are not fitted to the mesh lines."""
        if not self.numbers:
            return None
        return started(trial_of(self.name), np.array(self.numbers), self.addition.onset_revolutions)

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        return {
            "addition": self.addition.to_dict(),
            "parameters": {name: list(figures) for name, figures in self.parameters.items()},
            "log_evidence": self.log_evidence,
            "runner_up": self.runner_up,
            "over_runner_up": self.over_runner_up,
            "alike": list(self.alike),
            "detail": self.detail,
            "numbers": list(self.numbers),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> AttributedEffect:
        return cls(
            addition=Addition.from_dict(data["addition"]),
            parameters={name: (v, unit, std) for name, (v, unit, std) in data["parameters"].items()},
            log_evidence=data["log_evidence"],
            runner_up=data["runner_up"],
            over_runner_up=data["over_runner_up"],
            alike=tuple(data["alike"]),
            detail=data["detail"],
            numbers=tuple(data["numbers"]),
        )


def of_mesh(findings: MeshFindings, kept: Sequence[AttributedEffect]) -> list[AttributedEffect]:
    """What the mesh lines show; those kept from before with the evidence that they had then."""
    before = {f.name: f for f in kept}
    out = []
    effects = findings.best.effects()
    widen = max(1.0, float(np.sqrt(findings.best.misfit)))
    for candidate in findings.found:
        name = candidate.trial.name
        trial = next(t for t in findings.best.trials if t.name == name)
        numbers, std = findings.best.numbers(trial)
        effect = effects[findings.best.trials.index(trial)]
        parameters = {}
        for number, u, s in zip(fitted_numbers(name), numbers, std * widen, strict=True):
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
            if len(before) > 1:
                evidence = known.log_evidence
        if name in before and evidence < ALIKE.least_gain:
            continue
        out.append(
            AttributedEffect(
                addition=Addition(effect=plain(effect), onset_revolutions=float(trial.onset)),
                parameters=parameters,
                log_evidence=float(evidence),
                runner_up=None if other is None else other[0],
                over_runner_up=None if other is None else float(other[1]),
                alike=alike,
                numbers=tuple(float(u) for u in numbers),
            )
        )
    return out


def of_pitch(finding: ToothFinding) -> AttributedEffect:
    effect = finding.effect
    parameters = {}
    for gear in ("pinion", "gear"):
        values = np.array(getattr(effect, gear))
        if values.size:
            rms = float(np.sqrt(np.mean(values**2)))
            parameters[f"{gear}_rms"] = (
                rms,
                "m",
                float(np.hypot(finding.std / np.sqrt(2 * values.size), MODELLED * rms)),
            )
    return AttributedEffect(
        addition=Addition(effect=effect),
        parameters=parameters,
        log_evidence=finding.log_evidence,
        detail=finding.detail,
    )


def of_crack(finding: ToothFinding) -> AttributedEffect:
    effect = finding.effect
    assert isinstance(effect, ToothCrack)
    return AttributedEffect(
        addition=Addition(effect=effect, onset_revolutions=finding.onset),
        parameters={
            "stiffness_loss": (float(effect.stiffness_loss), "", finding.std),
            "tooth": (float(effect.tooth), "", finding.tooth_std),
        },
        log_evidence=finding.log_evidence,
        runner_up="pitch_error" if finding.onset == 0 else None,
        detail=f"one tooth of the {effect.on}" + (f"; {finding.detail}" if finding.detail else ""),
    )


def of_defect(defect: Defect) -> AttributedEffect:
    effect = defect.effect
    return AttributedEffect(
        addition=Addition(effect=effect, onset_revolutions=defect.onset),
        parameters={
            "order": (float(effect.order), "", defect.order_std),
            "slip": (float(effect.slip), "", defect.slip_std),
        },
        log_evidence=defect.log_evidence,
        detail="the impacts' own force is not known: the path from the bearing to the sensor is not in the rig file",
    )


def of_sensor(best: PathFit, rest: Sequence[PathFit]) -> AttributedEffect:
    effect = best.effect
    if isinstance(effect, SensorGain):
        parameters = {"gain": (float(effect.gain), "", float(effect.gain * best.std))}
    else:
        assert isinstance(effect, SensorResonance)
        parameters = {
            "frequency": (float(effect.frequency), "Hz", float(effect.frequency * best.std)),
            "damping_ratio": (float(effect.damping_ratio), "", best.damping_std),
        }
    other = max(rest, key=lambda s: s.log_evidence, default=None)
    return AttributedEffect(
        addition=Addition(effect=effect),
        parameters=parameters,
        log_evidence=best.log_evidence,
        runner_up=None if other is None else other.name,
        over_runner_up=None if other is None else best.log_evidence - other.log_evidence,
    )


def of_gain_step(step: GainStep) -> AttributedEffect:
    return AttributedEffect(
        addition=Addition(effect=SensorGain(gain=step.gain), onset_revolutions=step.onset),
        parameters={"gain": (step.gain, "", step.gain * step.std)},
        log_evidence=step.log_evidence,
        detail="the gain has changed between two windows: no structure does that",
    )


def of_turning(turning: Turning) -> AttributedEffect:
    return AttributedEffect(
        addition=Addition(effect=turning.effect),
        parameters=dict(turning.parameters),
        log_evidence=turning.log_evidence,
    )


def of_eccentricity(fit: EccentricityFit) -> AttributedEffect:
    told = (
        ""
        if fit.run_out is None
        else f"run-out {fit.run_out * 1e6:.1f} µm in the transmission error, with its sidebands"
    )
    return AttributedEffect(
        addition=Addition(effect=fit.effect),
        parameters={
            "eccentricity": (fit.eccentricity, "m", fit.std),
            "high_point": (fit.high_point, "rad", min(fit.std / max(fit.eccentricity, 1e-9), ANYWHERE)),
            "shift_share": (fit.shift_share, "", fit.shift_share_std),
        },
        log_evidence=fit.log_evidence,
        detail=told,
    )
