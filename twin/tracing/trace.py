"""From the history of a machine to the effects that its twin lacks.

The order of work is that in which effects hide one another: rattle, what no gear makes, teeth (pitch errors, a
crack), eccentricity, the mesh, the sensor, what turns with a shaft. Each step sees what those before it have found.
Windows held out take no part in any fit; errors before and after are those of the held-out windows.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from twin.effects.addition import Addition, name_of
from twin.effects.extended import extend, window_lines
from twin.effects.response import Effect
from twin.errors import NotAvailable, TwinError
from twin.model import Calibration, Condition, Model
from twin.rig import Rig
from twin.tracing.candidates import REPORTED, TRIALS, started
from twin.tracing.eccentricities import Beside as EccentricWindow
from twin.tracing.eccentricities import fit_eccentricity
from twin.tracing.joint_fit import Trial
from twin.tracing.mesh_block import GAIN, QUIET, MeshBlock, MeshFindings
from twin.tracing.observed import Observed, chosen, observed
from twin.tracing.path import fit_sensor, quotients
from twin.tracing.strangers import Strangers, strangers
from twin.tracing.teeth import find_crack, find_pitch_errors
from twin.tracing.turning import find_turning, rattling
from twin.updating.again import Taken
from twin.wear.curve import MasterCurve
from twin.wear.profile import WornProfile

MOST_WINDOWS = 8  # that the mesh lines are fitted on
HELD_OUT = 3  # of so many windows one is kept from all fits
LEAST_TO_HOLD_OUT = 4  # measurement windows
GAIN_EVIDENCE, OTHER_EVIDENCE = 6.0, 2.0  # nats: against a good sensor, and against a structure of another kind
LEAST_GAIN = 0.06  # of ln g
RUN_OUT_WITH_PITCH = 5e-6  # run-out that pitch errors do not imitate [m]
TOOTH_EVIDENCE = 25.0  # nats for pitch errors
LEAST_WITHOUT_RUN_OUT = 10e-6  # of an eccentricity that only sidebands show [m]
BESIDE_UNBALANCE = 10e-6  # run-out that an unbalance does not make [m]
TOOTHED = ("pitch_error", "tooth_crack")
MOVED = 15e-6  # jump of the mean transmission error that is a disc's: an edge of 10,000 is 30 µm


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """An effect with what speaks for it."""

    addition: Addition
    parameters: dict[str, tuple[float, str, float]]  # value, unit, std
    log_evidence: float
    runner_up: str | None = None
    over_runner_up: float | None = None
    detail: str = ""
    numbers: tuple[float, ...] = ()  # of an effect on the mesh: as fitted, in units of the priors

    @property
    def name(self) -> str:
        return self.addition.name

    @property
    def kept(self) -> Trial | None:
        """The trial that starts from here; None of effects that are not fitted to the mesh lines."""
        if not self.numbers:
            return None
        return started(TRIALS[self.name], np.array(self.numbers), self.addition.onset_revolutions)

    def to_dict(self) -> dict[str, Any]:
        """JSON-safe and exact."""
        return {
            "addition": self.addition.to_dict(),
            "parameters": {name: list(figures) for name, figures in self.parameters.items()},
            "log_evidence": self.log_evidence,
            "runner_up": self.runner_up,
            "over_runner_up": self.over_runner_up,
            "detail": self.detail,
            "numbers": list(self.numbers),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Found:
        return cls(
            addition=Addition.from_dict(data["addition"]),
            parameters={name: (v, unit, std) for name, (v, unit, std) in data["parameters"].items()},
            log_evidence=data["log_evidence"],
            runner_up=data["runner_up"],
            over_runner_up=data["over_runner_up"],
            detail=data["detail"],
            numbers=tuple(data["numbers"]),
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Traced:
    """What a trace found."""

    found: tuple[Found, ...]
    strangers: Strangers
    table: tuple[tuple[str, float], ...] = ()  # candidates on the mesh and their gain
    other_structure: bool = False  # whether the path to the housing is not the rig file's
    misfit_before: float | None = None
    misfit_after: float | None = None
    held_out: tuple[int, ...] = ()  # indices of windows
    fitted: tuple[int, ...] = ()
    notes: tuple[str, ...] = field(default=())


def held_out(measurement: Sequence[int]) -> set[int]:
    """Indices of the windows that are kept from all fits: by their number, so that they stay the same."""
    return {i for i in measurement if i % HELD_OUT == HELD_OUT - 1} if len(measurement) >= LEAST_TO_HOLD_OUT else set()


def trace(
    rig: Rig,
    history: Sequence[Taken],
    depths: dict[int, float],
    phase: float | None,
    *,
    rejected: Collection[str] = (),
    kept: Sequence[Found] = (),
    tolerated: float = 0.0,
    since_ns: int = 0,
) -> Traced:
    """The effects that the history shows; NotAvailable where it does not suffice.

    depths     wear depth of each window by index [m], as a start
    phase      of the mesh against the encoder's zero [rad]
    rejected   names that an engineer has ruled out
    kept       effects that the mesh lines are fitted with from the start
    tolerated  misfit of the mesh lines up to which no more effects are sought
    since_ns   when the pinion's disc was last turned: the mesh phase of what was recorded before is another [Unix ns]
    """
    every: list[tuple[Taken, Observed]] = []
    for taken in history:
        if taken.features.start_time_ns < since_ns:
            continue
        try:
            every.append((taken, observed(rig, taken.features, taken.index, taken.level_fault)))
        except NotAvailable:
            continue
    # below a tenth of the usual speed lie calibration tests: no sideband, no impact is sought there
    usual = np.median([o.condition.speed_hz for _, o in every]) if every else 0.0
    measured = [(t, o) for t, o in every if o.condition.speed_hz > 0.5 * usual]
    if phase is None or len(measured) < 2:
        raise NotAvailable("effects are not traced before two measurement windows with their mesh phase")
    out = held_out([o.index for _, o in measured])
    fitting = [(t, o) for t, o in measured if o.index not in out]
    model = Model.of(rig, Calibration.prior(rig))
    features = [t.features for t, _ in fitting]
    condition = fitting[0][1].condition
    found: list[Found] = []

    def add(item: Found) -> None:
        if item.name not in rejected:
            found.append(item)

    rattle = rattling([t.features for t, _ in measured])
    if rattle:
        for turning in find_turning(model, features, condition, model.unworn, phase):
            add(_turning(turning))
        heard = strangers([], True)
        return Traced(
            found=tuple(found), strangers=heard, held_out=tuple(out), fitted=tuple(o.index for _, o in fitting)
        )

    deepest = max((depths.get(o.index, 0.0) for _, o in every), default=0.0)
    curve = MasterCurve.build(model, condition, model.unworn, max(1.2 * deepest, 20e-6))
    profiles = {
        o.index: curve.profile(max(depths.get(o.index, 0.0), float(curve.depth[0]))) if o.worn else model.unworn
        for _, o in every
    }
    every = _mounted(model, every, profiles)
    fitting = [(t, o) for t, o in every if o.index in {o.index for _, o in fitting}]
    pitch = None if "pitch_error" in rejected else find_pitch_errors(model, features, condition, model.unworn, phase)
    crack = None
    if "tooth_crack" not in rejected:
        crack = find_crack(
            model, features, [o.condition for _, o in fitting], [profiles[o.index] for _, o in fitting], phase
        )
    if crack is not None and crack.onset == 0 and pitch is not None:
        pitch = None  # a local pattern from the start is the crack's own
    elif crack is not None and pitch is not None and crack.log_evidence < pitch.log_evidence:
        crack = None if crack.onset == 0 else crack
    if pitch is not None and pitch.log_evidence > TOOTH_EVIDENCE:
        add(_pitch(pitch))
    if crack is not None:
        add(_crack(crack))
    toothed = {f.name for f in found}

    def present(o: Observed) -> tuple[Effect, ...]:
        return tuple(f.addition.effect for f in found if f.addition.onset_revolutions <= o.revolutions)

    beside = [(t.features.revolutions or 0.0, t.beside) for t, _ in measured if t.beside is not None]
    heard = strangers(beside, "pitch_error" in toothed, "tooth_crack" in toothed)
    if heard.defect is not None:
        if abs(heard.defect.effect.order - round(heard.defect.effect.order)) < 0.02:  # type: ignore[attr-defined]
            heard = strangers([], True)
        else:
            add(_defect(heard))

    eccentric = [
        EccentricWindow(features=t.features, condition=o.condition, profile=profiles[o.index], worn=o.worn)
        for t, o in [fitting[i] for i in sorted({0, len(fitting) // 2, len(fitting) - 1})]
    ]
    turns = [] if toothed else find_turning(model, features, condition, model.unworn, phase)
    unbalanced = any(name_of(t.effect) == "mass_unbalance" for t in turns)
    taken_orders: set[int] = set()
    for shaft in (0, 1):
        result = fit_eccentricity(model, eccentric, phase, shaft)
        if result is None or not result.proven:
            continue
        if toothed and not (result.run_out is not None and result.run_out > RUN_OUT_WITH_PITCH):
            continue
        if result.run_out is None and result.eccentricity < LEAST_WITHOUT_RUN_OUT:
            continue
        if shaft == 0 and unbalanced and result.eccentricity < BESIDE_UNBALANCE:
            continue
        taken_orders |= {1} if shaft == 0 else set()
        add(
            Found(
                addition=Addition(effect=result.effect),
                parameters={
                    "eccentricity": (result.eccentricity, "m", result.std),
                    "high_point": (result.high_point, "rad", min(result.std / max(result.eccentricity, 1e-9), 3.0)),
                    "shift_share": (result.shift_share, "", 0.2),
                },
                log_evidence=result.log_evidence,
                detail=""
                if result.run_out is None
                else f"run-out {result.run_out * 1e6:.1f} µm in the transmission error, with its sidebands",
            )
        )

    fresh = [o for _, o in every if o.index not in out]
    picked = chosen(fresh, MOST_WINDOWS)
    start = np.array([depths.get(o.index, 0.0) for o in picked])
    factors = _factors(model, picked, profiles, [f.addition for f in found if f.name in TOOTHED])
    block = MeshBlock(model, picked, start, phase, factors)
    trials = [t for t in (f.kept for f in kept if f.name not in rejected) if t is not None]
    findings = block.explained(skip=tuple(rejected), quiet=max(QUIET, tolerated), kept=trials)
    if factors is not None and findings.found:
        findings = _with_teeth(findings, picked, profiles, found, tuple(rejected))
    for item in _mesh(findings, kept):
        add(item)

    other = False
    if not any(o.pinion_only for o in picked) and "pitch_error" not in toothed:
        sensors = fit_sensor(
            rig, model.calibration.modal_damping, quotients(findings.best, picked, model.mesh.pair.teeth[0])
        )
        if sensors:
            other = max(s.over_other for s in sensors) < OTHER_EVIDENCE
            best = max(sensors, key=lambda s: s.log_evidence)
            size = abs(np.log(getattr(best.effect, "gain", 2.0)))
            if best.log_evidence > GAIN_EVIDENCE and best.over_other > OTHER_EVIDENCE and size > LEAST_GAIN:
                rest = [s for s in sensors if s is not best]
                add(_sensor(best, rest))
    for turning in turns:
        if not (name_of(turning.effect) == "torque_ripple" and getattr(turning.effect, "order", 0) in taken_orders):
            add(_turning(turning))
    return Traced(
        found=tuple(found),
        strangers=heard,
        table=findings.table,
        other_structure=other,
        misfit_before=findings.base.misfit,
        misfit_after=findings.best.misfit,
        held_out=tuple(sorted(out)),
        fitted=tuple(o.index for _, o in fitting),
    )


def _with_teeth(
    findings: MeshFindings,
    windows: Sequence[Observed],
    profiles: Mapping[int, WornProfile],
    found: Sequence[Found],
    rejected: tuple[str, ...],
) -> MeshFindings:
    """The mesh lines explained once more, with what the teeth's differences make of them beside what was found."""
    best = findings.best
    model = findings.model
    beside = [
        Addition(effect=_plain(e), onset_revolutions=t.onset) for t, e in zip(best.trials, best.effects(), strict=True)
    ]
    teeth = [f.addition for f in found if f.name in TOOTHED]
    factors = _factors(model, windows, profiles, teeth, beside)
    block = MeshBlock(model, windows, best.depth, best.phase, factors)
    trials = [started(t, best.numbers(t)[0], t.onset) for t in best.trials]
    again = block.explained(skip=rejected, kept=trials)
    return replace(again, table=findings.table, runner_up={**findings.runner_up, **again.runner_up})


def _mounted(
    model: Model, windows: list[tuple[Taken, Observed]], profiles: dict[int, WornProfile]
) -> list[tuple[Taken, Observed]]:
    """The windows, with a new mounting from each on whose mean transmission error has jumped as no wear can."""
    out: list[tuple[Taken, Observed]] = []
    last, mounting = None, 0
    for taken, o in windows:
        if o.mean is not None and o.torque_known:
            steady = model.steady(profiles[o.index], o.condition)
            offset = o.mean - model.mean_transmission_error(steady, o.condition)
            if last is not None and abs(offset - last) > MOVED:
                mounting += 1
            last = offset
        out.append((taken, replace(o, mounting=mounting)))
    return out


def _factors(
    model: Model,
    windows: Sequence[Observed],
    profiles: Mapping[int, WornProfile],
    additions: Sequence[Addition],
    beside: Sequence[Addition] = (),
) -> list[dict[str, np.ndarray]] | None:
    """What effects of longer periods make of each window's mesh lines, beside those of the mesh's own period.

    None where there are none.
    """
    if not additions:
        return None
    out: list[dict[str, np.ndarray]] = []
    for o in windows:
        there = tuple(a.effect for a in additions if a.onset_revolutions <= o.revolutions)
        mesh = tuple(a.effect for a in beside if a.onset_revolutions <= o.revolutions)
        if not there:
            out.append({})
            continue
        try:
            whole = window_lines(extend(model, (*there, *mesh)), profiles[o.index], o.condition).lines
            part = window_lines(extend(model, mesh), profiles[o.index], o.condition).lines
        except TwinError:
            out.append({})
            continue
        error = whole.transmission_error / part.transmission_error
        if o.pinion_only:
            error = whole.pinion_motion / part.pinion_motion
        out.append(
            {"encoder": error[:5], "torque": error[:3], "acceleration": (whole.acceleration / part.acceleration)[:10]}
        )
    return out


def _mesh(findings: MeshFindings, kept: Sequence[Found]) -> list[Found]:
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
        for (parameter, unit, scale), u, s in zip(REPORTED[name], numbers, std * widen, strict=True):
            value = scale(float(u))
            parameters[parameter] = (value, unit, float(np.hypot(abs(scale(float(u + s)) - value), 0.05 * abs(value))))
        other = findings.runner_up.get(name)
        evidence = candidate.gain
        if name in before and other is None:
            known = before[name]
            if known.runner_up is not None and known.over_runner_up is not None:
                other = (known.runner_up, known.over_runner_up)
            if len(before) > 1:
                evidence = known.log_evidence
        if name in before and evidence < GAIN:
            continue
        out.append(
            Found(
                addition=Addition(effect=_plain(effect), onset_revolutions=float(trial.onset)),
                parameters=parameters,
                log_evidence=float(evidence),
                runner_up=None if other is None else other[0],
                over_runner_up=None if other is None else float(other[1]),
                numbers=tuple(float(u) for u in numbers),
            )
        )
    return out


def _plain(effect: Effect) -> Effect:
    """The effect with plain numbers."""
    values = {p.name: getattr(effect, p.name) for p in effect.parameters}
    plain = {k: float(v) if isinstance(v, (float, np.floating)) else v for k, v in values.items()}
    return type(effect)(**plain)


def _pitch(finding) -> Found:
    effect = finding.effect
    parameters = {}
    for gear in ("pinion", "gear"):
        values = np.array(getattr(effect, gear))
        if values.size:
            rms = float(np.sqrt(np.mean(values**2)))
            parameters[f"{gear}_rms"] = (rms, "m", float(finding.std / np.sqrt(2 * values.size) + 0.1 * rms))
    return Found(
        addition=Addition(effect=effect),
        parameters=parameters,
        log_evidence=finding.log_evidence,
        detail=finding.detail,
    )


def _crack(finding) -> Found:
    effect = finding.effect
    return Found(
        addition=Addition(effect=effect, onset_revolutions=finding.onset),
        parameters={
            "stiffness_loss": (float(effect.stiffness_loss), "", finding.std),
            "tooth": (float(effect.tooth), "", 0.5),
        },
        log_evidence=finding.log_evidence,
        runner_up="pitch_error" if finding.onset == 0 else None,
        detail=f"one tooth of the {effect.on}" + (f"; {finding.detail}" if finding.detail else ""),
    )


def _defect(heard: Strangers) -> Found:
    assert heard.defect is not None
    effect = heard.defect.effect
    return Found(
        addition=Addition(effect=effect, onset_revolutions=heard.defect.onset),
        parameters={
            "order": (float(effect.order), "", heard.defect.order_std),  # type: ignore[attr-defined]
            "slip": (float(effect.slip), "", 0.01),  # type: ignore[attr-defined]
        },
        log_evidence=heard.defect.log_evidence,
        detail="the impacts' own force is not known: the path from the bearing to the sensor is not in the rig file",
    )


def _sensor(best, rest) -> Found:
    effect = best.effect
    if best.name == "sensor_gain":
        parameters = {"gain": (float(effect.gain), "", float(effect.gain * best.std))}
    else:
        parameters = {
            "frequency": (float(effect.frequency), "Hz", float(effect.frequency * best.std)),
            "damping_ratio": (float(effect.damping_ratio), "", 0.03),
        }
    other = max(rest, key=lambda s: s.log_evidence, default=None)
    return Found(
        addition=Addition(effect=effect),
        parameters=parameters,
        log_evidence=best.log_evidence,
        runner_up=None if other is None else other.name,
        over_runner_up=None if other is None else best.log_evidence - other.log_evidence,
    )


def _turning(turning) -> Found:
    return Found(
        addition=Addition(effect=turning.effect),
        parameters=dict(turning.parameters),
        log_evidence=turning.log_evidence,
    )


__all__ = ["Condition", "Found", "Traced", "held_out", "name_of", "trace"]
