"""From the history of a machine to the effects that its twin lacks.

The order of work is that in which effects hide one another: rattle, what no gear makes, teeth (pitch errors, a
crack), eccentricity, the mesh, the sensor, what turns with a shaft. Each step sees what those before it have found.
Windows held out take no part in any fit; errors before and after are those of the held-out windows.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects.addition import Addition, name_of
from twin.errors import NotAvailable
from twin.model import Model
from twin.rig import Rig
from twin.tracing.attribution import (
    AttributedEffect,
    of_crack,
    of_defect,
    of_eccentricity,
    of_gain_step,
    of_mesh,
    of_pitch,
    of_sensor,
    of_turning,
)
from twin.tracing.eccentricities import EccentricityWindow as EccentricWindow
from twin.tracing.eccentricities import fit_eccentricity
from twin.tracing.joint_fit import JointFit
from twin.tracing.mesh_search import AlikeTeeth, DifferingTeeth, Fits, MeshFindings, search_mesh
from twin.tracing.mesh_wear import plain_curve
from twin.tracing.mesh_windows import MeshWindows
from twin.tracing.non_gear import NonGearContent, find_non_gear_content
from twin.tracing.observed import Observed, chosen, observed
from twin.tracing.scatter import LineScatter
from twin.tracing.shaft_forces import find_turning, run_out_of, swung_by, without_order
from twin.tracing.teeth import FIRST, find_crack, find_pitch_errors
from twin.tracing.tooth_factors import factors_of
from twin.tracing.transfer_path import fit_sensor, gain_step, quotients
from twin.updating.history import WindowInput
from twin.updating.model_cache import nominal_model_of
from twin.wear.profile import WornProfile

MOST_WINDOWS = 8  # that the mesh lines are fitted on
HELD_OUT = 3  # of so many windows one is kept from all fits
LEAST_TO_HOLD_OUT = 4  # measurement windows
STEP_EVIDENCE = 15.0  # nats of a gain that changes in mid-campaign
GAIN_EVIDENCE, OTHER_EVIDENCE = 6.0, 2.0  # nats: against a good sensor, and against a structure of another kind
OUT_OF_PROPORTION = 30.0  # nats a misfit: friction reaches 2.5, other structures 200 and more
PLAIN_MISFIT = 5.0  # at least that much is granted
QUIET_ELSEWHERE = 10.0  # misfit of the encoders' lines that another structure may leave
LEAST_GAIN = 0.06  # of ln g
RUN_OUT_WITH_PITCH = 5e-6  # run-out that pitch errors do not imitate [m]
BEYOND_HEALTHY = 5.0  # energy of pitch errors' lines beyond that of a healthy machine's, over it
LEAST_WITHOUT_RUN_OUT = 10e-6  # of an eccentricity that only sidebands show [m]
ALONE_EVIDENCE = 60.0  # nats of a bearing defect without a mesh phase: what is none reaches 49 there, a small one 64
OF_SHAFT = 0.02  # of an order of the pinion: what repeats there is no bearing
TOOTHED = ("pitch_error", "tooth_crack")
MOVED = 15e-6  # jump of the mean transmission error that is a disc's: an edge of 10,000 is 30 µm


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Traced:
    """What a trace found."""

    found: tuple[AttributedEffect, ...]
    non_gear: NonGearContent
    table: tuple[tuple[str, float], ...] = ()  # candidates on the mesh and their gain
    other_structure: bool = False  # whether the path to the housing is not the rig file's
    misfit_before: float | None = None
    misfit_after: float | None = None
    held_out: tuple[int, ...] = ()  # indices of windows
    fitted: tuple[int, ...] = ()
    waiting: bool = False  # whether only the latest window breaks off: one more must show it


def held_out(measurement: Sequence[int]) -> set[int]:
    """Indices of the windows that are kept from all fits: by their number, so that they stay the same."""
    return {i for i in measurement if i % HELD_OUT == HELD_OUT - 1} if len(measurement) >= LEAST_TO_HOLD_OUT else set()


def trace(
    rig: Rig,
    history: Sequence[WindowInput],
    depths: dict[int, float],
    phase: float | None,
    *,
    rejected: Collection[str] = (),
    kept: Sequence[AttributedEffect] = (),
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
    every: list[tuple[WindowInput, Observed]] = []
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
    if len(measured) < 2:
        raise NotAvailable("effects are not traced before two measurement windows")
    out = held_out([o.index for _, o in measured])
    fitting = [(t, o) for t, o in measured if o.index not in out]
    if phase is None:
        return _heard_alone(measured, out, rejected)
    model = nominal_model_of(rig)
    features = [t.features for t, _ in fitting]
    condition = fitting[0][1].condition
    found: list[AttributedEffect] = []

    def add(item: AttributedEffect) -> None:
        if item.name not in rejected:
            found.append(item)

    turns = find_turning(model, features, [o.condition for _, o in fitting], phase)
    turned = {name_of(t.effect): t for t in turns}
    if "backlash_rattle" in turned:
        add(of_turning(turned["backlash_rattle"]))
        heard = find_non_gear_content([], True)
        return Traced(
            found=tuple(found), non_gear=heard, held_out=tuple(out), fitted=tuple(o.index for _, o in fitting)
        )
    deepest = max((depths.get(o.index, 0.0) for _, o in every), default=0.0)
    curve = plain_curve(model, [o for _, o in every if o.index not in out], deepest)
    profiles = {
        o.index: curve.profile(max(depths.get(o.index, 0.0), float(curve.depth[0]))) if o.worn else model.unworn
        for _, o in every
    }
    every = _mounted(model, every, profiles, phase)
    fitting = [(t, o) for t, o in every if o.index in {o.index for _, o in fitting}]
    teeth = features
    pitch = None if "pitch_error" in rejected else find_pitch_errors(model, features, condition, model.unworn, phase)
    if "torque_ripple" in turned:
        order = int(turned["torque_ripple"].parameters["order"][0])
        if pitch is not None and swung_by(model, features[:FIRST], condition, (pitch.effect,), phase, order):
            del turned["torque_ripple"]
        else:
            teeth = without_order(features, order)
            pitch = pitch and find_pitch_errors(model, teeth, condition, model.unworn, phase)
    crack = None
    if "tooth_crack" not in rejected:
        crack = find_crack(
            model, teeth, [o.condition for _, o in fitting], [profiles[o.index] for _, o in fitting], phase
        )
    if crack is not None and crack.onset == 0 and pitch is not None:
        pitch = None  # a local pattern from the start is the crack's own
    if pitch is not None and pitch.over_healthy > BEYOND_HEALTHY:
        add(of_pitch(pitch))
    if crack is not None:
        add(of_crack(crack))
    toothed = {f.name for f in found}

    beside = [(t.features.revolutions or 0.0, t.non_gear) for t, _ in measured if t.non_gear is not None]
    heard = _of_no_shaft(find_non_gear_content(beside, "pitch_error" in toothed, "tooth_crack" in toothed))
    if heard.defect is not None:
        add(of_defect(heard.defect))

    eccentric = [
        EccentricWindow(features=t.features, condition=o.condition, profile=profiles[o.index], worn=o.worn)
        for t, o in [fitting[i] for i in sorted({0, len(fitting) // 2, len(fitting) - 1})]
    ]
    unbalanced = "mass_unbalance" in turned and not toothed
    swung = run_out_of(model, condition, turned["mass_unbalance"].effect) if unbalanced else 0.0
    taken_orders: set[int] = set()
    for shaft in (0, 1):
        result = fit_eccentricity(model, eccentric, phase, shaft, swung if shaft == 0 else 0.0)
        if result is None or not result.proven:
            continue
        if toothed and not (result.run_out is not None and result.run_out > RUN_OUT_WITH_PITCH):
            continue
        if result.run_out is None and result.eccentricity < LEAST_WITHOUT_RUN_OUT:
            continue
        taken_orders |= {1} if shaft == 0 else set()
        add(of_eccentricity(result))

    fresh = [o for _, o in every if o.index not in out]
    picked = chosen(fresh, MOST_WINDOWS)
    start = np.array([depths.get(o.index, 0.0) for o in picked])
    factors = factors_of(model, picked, profiles, [f.addition for f in found if f.name in TOOTHED])
    mesh = MeshWindows(
        model=model, windows=tuple(picked), depth=start, phase=phase, factors=factors, scatter=LineScatter.of_rig(rig)
    )
    base = mesh.plain()
    trials = [t for t in (f.kept for f in kept if f.name not in rejected) if t is not None]
    elsewhere = _other_structure(rig, model, mesh.windows, base.fit)
    if elsewhere:
        mesh = replace(mesh, channels=("encoder",))
        base = mesh.plain()
    fits: Fits = AlikeTeeth(windows=mesh)
    if factors is not None:

        def anew(beside: Sequence[Addition]) -> list[Addition]:
            """The teeth's effects, pitch errors fitted anew beside others that were there from the start."""
            early = tuple(a.effect for a in beside if a.onset_revolutions == 0)
            fitted = find_pitch_errors(model, teeth, condition, model.unworn, phase, early) if early else None
            return [
                Addition(effect=fitted.effect) if f.name == "pitch_error" and fitted is not None else f.addition
                for f in found
                if f.name in TOOTHED
            ]

        fits = DifferingTeeth(windows=mesh, profiles=profiles, teeth=anew)
    tolerated = max(QUIET_ELSEWHERE if elsewhere else 0.0, tolerated)
    findings = search_mesh(fits, skip=tuple(rejected), tolerated=tolerated, kept=trials, base=base)
    if factors is not None and pitch is not None and findings.found:
        best = findings.best
        early = tuple(e for t, e in zip(best.trials, best.effects(), strict=True) if t.onset == 0)
        fitted = find_pitch_errors(model, teeth, condition, model.unworn, phase, early)
        found = [of_pitch(fitted) if f.name == "pitch_error" and fitted is not None else f for f in found]
    for item in of_mesh(findings, kept):
        add(item)

    other = elsewhere
    if not elsewhere and not any(o.pinion_only for o in picked) and "pitch_error" not in toothed:
        sensor, other = _sensor(rig, model, findings, picked)
        if sensor is not None:
            add(sensor)
    for name, turning in turned.items():
        if name == "mass_unbalance" and toothed:
            continue
        if name == "torque_ripple" and turning.parameters["order"][0] in taken_orders:
            continue
        add(of_turning(turning))
    return Traced(
        found=tuple(found),
        non_gear=heard,
        table=findings.table,
        other_structure=other,
        misfit_before=findings.base.misfit,
        misfit_after=findings.best.misfit,
        held_out=tuple(sorted(out)),
        fitted=tuple(o.index for _, o in fitting),
        waiting=findings.waiting,
    )


def _of_no_shaft(heard: NonGearContent) -> NonGearContent:
    """Nothing at all where the defect repeats with the pinion: what strikes then is a tooth."""
    defect = heard.defect
    at_shaft = defect is not None and abs(defect.effect.order - round(defect.effect.order)) < OF_SHAFT
    return find_non_gear_content([], True) if at_shaft else heard


def _heard_alone(measured: Sequence[tuple[WindowInput, Observed]], out: set[int], rejected: Collection[str]) -> Traced:
    """What needs no mesh phase; an angle that wanders makes lines at orders of no shaft by itself."""
    beside = [(t.features.revolutions or 0.0, t.non_gear) for t, _ in measured if t.non_gear is not None]
    heard = _of_no_shaft(replace(find_non_gear_content(beside, False), orders=()))
    if heard.defect is not None and heard.defect.log_evidence < ALONE_EVIDENCE:
        heard = replace(heard, defect=None)
    named = heard.defect is not None and "bearing_defect" not in rejected
    return Traced(
        found=(of_defect(heard.defect),) if heard.defect is not None and named else (),
        non_gear=heard,
        held_out=tuple(sorted(out)),
        fitted=tuple(o.index for _, o in measured if o.index not in out),
    )


def _sensor(
    rig: Rig, model: Model, findings: MeshFindings, windows: Sequence[Observed]
) -> tuple[AttributedEffect | None, bool]:
    """What is wrong with the accelerometer, and whether the structure is not the rig file's."""
    seen = quotients(findings.best, windows, model.mesh.pair.teeth[0])
    step = gain_step(seen)
    if step is not None and step.log_evidence > STEP_EVIDENCE and abs(np.log(step.gain)) > LEAST_GAIN:
        return of_gain_step(step), False
    fits = fit_sensor(rig, model.calibration.modal_damping, seen)
    if not fits:
        return None, False
    best = max(fits, key=lambda s: s.log_evidence)
    size = abs(np.log(getattr(best.effect, "gain", 2.0)))
    other = max(s.over_other for s in fits) < OTHER_EVIDENCE
    if best.log_evidence > GAIN_EVIDENCE and best.over_other > OTHER_EVIDENCE and size > LEAST_GAIN:
        return of_sensor(best, [s for s in fits if s is not best]), other
    return None, other


def _other_structure(rig: Rig, model: Model, windows: Sequence[Observed], base: JointFit) -> bool:
    """Whether the way to the accelerometer alone says that the structure is not the rig file's.

    What acts in the mesh moves the mesh lines first; friction moves the way a little, too. Another structure moves the
    way out of all proportion.
    """
    if any(o.pinion_only for o in windows):
        return False
    fits = fit_sensor(rig, model.calibration.modal_damping, quotients(base, windows, model.mesh.pair.teeth[0]))
    return bool(fits) and max(s.over_other for s in fits) < -OUT_OF_PROPORTION * max(base.misfit, PLAIN_MISFIT)


def _mounted(
    model: Model, windows: list[tuple[WindowInput, Observed]], profiles: dict[int, WornProfile], phase: float
) -> list[tuple[WindowInput, Observed]]:
    """The windows, with a new mounting from each on whose mean transmission error has jumped as no wear can.

    Whoever moved a disc may have turned it: the mesh lines of every mounting are turned back to the first one's phase.
    """
    predicted, mounting = {}, {}
    last, count = None, 0
    for _, o in windows:
        steady = model.steady(profiles[o.index], o.condition)
        predicted[o.index] = model.transmission_error_lines(steady)
        if o.mean is not None and o.torque_known:
            offset = o.mean - model.mean_transmission_error(steady, o.condition)
            if last is not None and abs(offset - last) > MOVED:
                count += 1
            last = offset
        mounting[o.index] = count
    if count == 0:
        return windows

    def turn(number: int) -> float:
        """By how much the lines of a mounting are ahead of the phase [rad]."""
        seen = [o for _, o in windows if mounting[o.index] == number and o.worn and not o.pinion_only]
        angles = np.linspace(-np.pi, np.pi, 720, endpoint=False)
        score = np.zeros_like(angles)
        for o in seen:
            for k in (1, 2, 3):
                z, m = o.lines["encoder"][k - 1], predicted[o.index][k - 1]
                if np.isfinite(z):
                    score += (np.conj(m) * z * np.exp(-1j * k * (phase + angles))).real
        return float(angles[np.argmax(score)])

    turns = [turn(number) for number in range(count + 1)]
    out = []
    for taken, o in windows:
        back = turns[mounting[o.index]] - turns[0]
        lines = {name: y * np.exp(-1j * back * np.arange(1, y.size + 1)) for name, y in o.lines.items()}
        out.append((taken, replace(o, mounting=mounting[o.index], lines=lines)))
    return out
