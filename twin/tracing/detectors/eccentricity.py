"""Is a gear eccentric? Its run-out in the transmission error and its sidebands about the mesh lines must agree.

    E = e·e^{iφ}        TE at the shaft's own order = E + graduation        sidebands k·z1 ± o: S⁺_k·E, S⁻_k·conj(E)

S    by the harmonic balance with a reference eccentricity, scaled by the measured over the predicted mesh line, so that
     neither the path to the housing nor what softens the mesh has to be known
o    order of the shaft: 1 or z1/z2

An encoder disc sits off its own centre by a micrometre or two, which looks like run-out but moves no tooth: the
order of the shaft alone never proves an eccentricity, its sidebands must agree with it. The mesh's sidebands of a
healthy machine are not zero: teeth differ, the speed wanders. Worn flanks show less of the contact's shift than flanks
that end sharply where the nominal path does; how much less, the sidebands of the worn windows say.

Source   twin/effects/eccentricity.py; R. B. Randall, J. Mech. Des. 104 (1982) 259–267 (sidebands of gear vibration)
Holds    shafts whose sidebands are resolved in the window: 1.2/(z1/z2) turns or more
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from twin.effects import EFFECTS
from twin.effects.kept import RESPONSES
from twin.effects.response import Effect, ResponseLines
from twin.errors import NotConverged
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.model import Condition, Model
from twin.required_evidence import DEFAULT, RequiredEvidence
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import TracedWindow, TracingContext
from twin.tracing.detectors.shaft_forces import run_out_of
from twin.tracing.findings import Findings
from twin.wear.profile import WornProfile

TUNED = "tuned on D00–D13 and T01–T58; not derived"
NAMES = ("pinion_eccentricity", "gear_eccentricity")
KINDS = tuple(EFFECTS[name] for name in NAMES)
PRIOR = next(p.prior for p in KINDS[0].parameters if p.name == "eccentricity")  # of e [m]
REFERENCE = 0.4 * PRIOR  # at which the linear response is taken [m]
UNIT = 0.2 * PRIOR  # of the minimisation [m]
HARMONICS = (1, 2, 3, 4, 5)
CHANNELS = ("acceleration", "transmission_error")
ANYWHERE = float(np.pi / np.sqrt(3))  # standard deviation of an angle of which nothing is known [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class EccentricityThresholds:
    """When run-out and sidebands are an eccentricity, and what a healthy machine's are."""

    healthy_sideband: float = deciding(
        0.004,
        of="mesh line",
        meaning="sideband of a healthy worn machine",
        source="measured: some 0.4 % on worn healthy campaigns of the reference rig",
    )
    acceleration_floor: float = deciding(
        1.5, of="acceleration noise floor", meaning="noise of a sideband of the acceleration", source=TUNED
    )
    error_floor: float = deciding(
        0.0667,
        of="pinion graduation error",
        meaning="noise of a sideband of the transmission error",
        source="0.04 µm on the reference rig; " + TUNED,
    )
    sideband_scatter: float = deciding(0.3, of="predicted sideband", meaning="what it may be off", source=TUNED)
    clear_line: float = deciding(
        5.0, of="standard deviation", meaning="mesh line that the prediction is scaled by", source="not derived: chosen"
    )
    believable_scale: tuple[float, float] = deciding(
        (0.1, 10.0), meaning="measured over predicted mesh line that the prediction is scaled by", source="not derived"
    )
    least_evidence: float = deciding(
        10.0, unit="nat", meaning="evidence of the sidebands alone, and of all lines", source=TUNED
    )
    least_run_out: float = deciding(
        4.0,
        of="once-per-turn error",
        meaning="run-out that is not the disc's own",
        source="between two observed values: a poor disc's own reaches 4 µm; 6 µm on the reference rig",
    )
    run_out_with_tooth_errors: float = deciding(
        3.33,
        of="once-per-turn error",
        meaning="run-out that pitch errors or a crack do not imitate",
        source="5 µm on the reference rig; " + TUNED,
    )
    least_without_run_out: float = deciding(
        0.00169,
        of="base pitch",
        meaning="eccentricity where only sidebands show it",
        source="10 µm on the reference rig; " + TUNED,
    )
    most_disagreement: float = deciding(
        3.0, meaning="difference of run-out and sidebands over what both may be off", source=TUNED
    )
    run_out_scatter: float = deciding(
        2.0, of="once-per-turn error", meaning="what a run-out may be off where both are compared", source=TUNED
    )
    size_scatter: float = deciding(
        0.5, of="larger of both", meaning="what both may be off where they are compared", source=TUNED
    )
    largest: float = deciding(
        500e-6, unit="m", meaning="eccentricity beyond which lines have another cause", source="bound of the parameter"
    )
    most_shift_share: float = deciding(
        1.5, of="contact's shift", meaning="most that worn windows' sidebands show", source="bound of the parameter"
    )


THRESHOLDS = EccentricityThresholds()


def detect(context: TracingContext, limits: EccentricityThresholds = THRESHOLDS) -> Findings:
    """The findings with the eccentricities of pinion and gear."""
    findings, model = context.findings, context.model
    fitting = context.fitting_mounted
    chosen = [fitting[i] for i in sorted({0, len(fitting) // 2, len(fitting) - 1})]
    windows = [_window(context, w) for w in chosen]
    explained = {0: 0j, 1: 0j}  # run-out that the forces make which are suspected at the order of a shaft
    ratio = model.mesh.pair.teeth[0] / model.mesh.pair.teeth[1]
    for force in findings.forces_beside_teeth(context.shaft_lines) if findings.forces else ():
        if force.order in (1, ratio):
            made = run_out_of(model, context.fitting[0].condition, force.effect, force.order)
            explained[0 if force.order == 1 else 1] += made
    orders: set[int] = set()
    found, differ = [], bool(findings.tooth_errors)
    for shaft in (0, 1):
        fit = fit_eccentricity(
            model, windows, context.mesh_phase, shaft, context.scales, differ, explained[shaft], limits
        )
        if fit is None or not is_proven(fit, context.scales, differ, limits, context.required):
            continue
        if shaft == 0:
            orders.add(1)
        found.append(attributed(fit))
    return replace(findings.adding(*found, rejected=context.rejected), run_out_orders=frozenset(orders))


def _window(context: TracingContext, window: TracedWindow) -> EccentricityWindow:
    return EccentricityWindow(
        features=window.features,
        condition=window.condition,
        profile=context.profiles[window.index],
        worn=window.observed.worn,
    )


def attributed(fit: EccentricityFit) -> AttributedEffect:
    """An eccentricity as an effect of the twin."""
    detail = ""
    if fit.run_out is not None:
        detail = f"run-out {fit.run_out * 1e6:.1f} µm in the transmission error, with its sidebands"
    return AttributedEffect.of(
        fit.effect,
        parameters={
            "eccentricity": (fit.eccentricity, "m", fit.std),
            "high_point": (fit.high_point, "rad", min(fit.std / max(fit.eccentricity, 1e-9), ANYWHERE)),
            "shift_share": (fit.shift_share, "", fit.shift_share_std),
        },
        log_evidence=fit.log_evidence,
        detail=detail,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    """One measured line and what E does to it: m = s·E or s·conj(E)."""

    measured: complex
    std: float  # of noise, per complex value
    per_metre: complex
    lower: bool
    worn: bool

    def predicted(self, E: complex) -> complex:
        return self.per_metre * (E.conjugate() if self.lower else E)


@dataclass(frozen=True, slots=True, kw_only=True)
class EccentricityFit:
    """What the lines of one shaft say."""

    shaft: int  # 0 pinion, 1 gear
    eccentricity: float  # e [m]
    high_point: float  # φ [rad], in the twin's angle
    std: float  # of e [m]
    log_evidence: float  # against none
    by_sidebands: float  # the part of it that the sidebands alone give
    run_out: float | None  # |E| at the shaft's own order in the transmission error [m]
    disagreement: float  # of run-out and sidebands, over what both may be off
    shift_share: float  # of the contact's shift that the worn windows' sidebands show
    shift_share_std: float

    @property
    def effect(self) -> Effect:
        return KINDS[self.shaft](
            eccentricity=self.eccentricity, high_point=self.high_point, shift_share=self.shift_share
        )


def is_proven(
    fit: EccentricityFit,
    scales: Scales,
    tooth_errors: bool,
    limits: EccentricityThresholds = THRESHOLDS,
    required: RequiredEvidence = DEFAULT,
) -> bool:
    """Whether teeth, not a disc, run out; `tooth_errors` tells whether teeth differ, which imitates a small run-out."""
    least = required.least(NAMES[fit.shaft], limits.least_evidence)
    if min(fit.by_sidebands, fit.log_evidence) <= least or fit.eccentricity > limits.largest:
        return False
    if fit.run_out is None:
        return not tooth_errors and fit.eccentricity >= limits.least_without_run_out * scales.base_pitch
    beyond = _beyond_discs(fit.run_out, fit.shaft, scales, tooth_errors, limits)
    return beyond and fit.disagreement <= limits.most_disagreement


def _beyond_discs(
    run_out: float, shaft: int, scales: Scales, tooth_errors: bool, limits: EccentricityThresholds
) -> bool:
    """Whether a run-out [m] is more than that of an encoder's disc, and than teeth that differ imitate."""
    disc = scales.once_per_turn[shaft]
    if tooth_errors and run_out <= limits.run_out_with_tooth_errors * disc:
        return False
    return run_out >= limits.least_run_out * disc


def _key(k: int, side: int, shaft: int) -> tuple[int, int, int]:
    return (k, side, 0) if shaft == 0 else (k, 0, side)


def _sidebands(
    window: EccentricityWindow,
    channel: str,
    response: ResponseLines,
    shaft: int,
    ψ: float,
    scales: Scales,
    limits: EccentricityThresholds,
) -> list[_Line]:
    """The sidebands of one channel that were read, with what the response has there."""
    lines: MeasuredLines | None = getattr(window.features, channel)
    if lines is None:
        return []
    teeth = response.model.mesh.pair.teeth
    z1, own = teeth[0], (1.0, teeth[0] / teeth[1])[shaft]
    at, floor = response.transmission_error, limits.error_floor * scales.graduation[0]
    if channel == "acceleration":
        at, floor = response.acceleration, limits.acceleration_floor * scales.acceleration
    out = []
    for k in HARMONICS:
        mesh, mesh_std = lines.get(k), lines.get_std(k)
        if mesh is None or mesh_std is None:
            continue
        (m,) = at([k * z1])
        factor = _scale(mesh * np.exp(-1j * k * ψ), mesh_std, m, limits)
        for side in (1, -1):
            y, std = lines.get(*_key(k, side, shaft)), lines.get_std(*_key(k, side, shaft))
            if y is None or std is None:
                continue
            order = k * z1 + side * own
            (s,) = at([order])
            healthy = limits.healthy_sideband * abs(mesh) * window.worn
            out.append(
                _Line(
                    measured=complex(y * np.exp(-1j * order * ψ / z1)),
                    std=float(np.sqrt(2 * std**2 + floor**2 + healthy**2)),
                    per_metre=complex(factor * s / REFERENCE),
                    lower=side < 0,
                    worn=window.worn,
                )
            )
    return out


def _scale(measured: complex, std: float, predicted: complex, limits: EccentricityThresholds) -> complex:
    """Measured over predicted mesh line; 1 where it is not clear enough to tell."""
    ratio = measured / predicted
    low, high = limits.believable_scale
    return ratio if abs(measured) > limits.clear_line * std and low < abs(ratio) < high else 1.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EccentricityWindow:
    """A window and the other effects that were in the machine when it was recorded."""

    features: WindowFeatures
    condition: Condition
    profile: WornProfile
    worn: bool
    effects: tuple[Effect, ...] = ()  # of the mesh's period


def _run_out(
    window: EccentricityWindow, response: ResponseLines, shaft: int, ψ: float, explained: complex
) -> complex | None:
    """What the transmission error shows of an eccentricity at the shaft's own order [m]; None where it was not read."""
    te = window.features.transmission_error
    if te is None or te.unit != "m" or te.get(*_key(0, 1, shaft)) is None:
        return None
    teeth = response.model.mesh.pair.teeth
    own = (1.0, teeth[0] / teeth[1])[shaft]
    (s,) = response.transmission_error([own])
    y = te.at(*_key(0, 1, shaft)) * np.exp(-1j * own * ψ / teeth[0])
    return complex((y - explained) / (s / REFERENCE))


def _with_reference(model: Model, windows: Sequence[EccentricityWindow], shaft: int) -> list[ResponseLines]:
    """Responses in all windows with a reference eccentricity in the model; NotConverged."""
    effect = KINDS[shaft](eccentricity=REFERENCE)
    out = [RESPONSES.get(model, (*w.effects, effect), w.profile, w.condition) for w in windows]
    if not all(response.converged for response in out):
        raise NotConverged("no steady state with an eccentricity")
    return out


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Likelihood:
    """−2·ln likelihood of E = (x0 + i·x1)·UNIT over that of E = 0; of the sidebands, and of the run-out where read."""

    measured: np.ndarray  # (n,) complex
    noise: np.ndarray  # variance (n,)
    lower: np.ndarray  # whether a line is a lower sideband (n,)
    per_metre: np.ndarray  # (n,) complex
    run_out: complex | None  # [m]
    disc: float  # std of the disc's once-per-turn error [m]
    scatter: float  # of a predicted sideband

    def cost(self, x: np.ndarray, with_run_out: bool = True) -> float:
        E = complex(x[0], x[1]) * UNIT
        m = self.per_metre * np.where(self.lower, np.conj(E), E)
        C = self.noise + (self.scatter * np.abs(m)) ** 2
        rest = np.abs(self.measured - m) ** 2 / C - np.abs(self.measured) ** 2 / self.noise
        total = np.sum(rest + np.log(C / self.noise))
        if with_run_out and self.run_out is not None:
            total += (abs(self.run_out - E) ** 2 - abs(self.run_out) ** 2) / self.disc**2
        return float(total)

    def starts(self) -> list[complex]:
        """Where the minimisation begins: linear least squares, and the run-out [m]."""
        gain = self.per_metre
        each = np.where(self.lower, gain * np.conj(self.measured), np.conj(gain) * self.measured)
        linear = complex(np.sum(each / self.noise) / np.sum(np.abs(gain) ** 2 / self.noise))
        return [linear] if self.run_out is None else [linear, self.run_out]

    def best(self, with_run_out: bool):
        """The least cost, as scipy's result."""
        tried = [
            minimize(
                self.cost,
                [E.real / UNIT, E.imag / UNIT],
                args=(with_run_out,),
                method="Nelder-Mead",
                options={"xatol": 1e-4},
            )
            for E in self.starts()
        ]
        return min(tried, key=lambda r: r.fun)


def fit_eccentricity(
    model: Model,
    windows: Sequence[EccentricityWindow],
    phase: float,
    shaft: int,
    scales: Scales,
    tooth_errors: bool,
    explained: complex = 0.0,
    limits: EccentricityThresholds = THRESHOLDS,
) -> EccentricityFit | None:
    """The eccentricity that explains the windows best; None where no window has the lines, or a disc's own run-out.

    phase         ψ [rad]
    shaft         0 pinion, 1 gear
    tooth_errors  whether teeth differ, which imitates a small run-out
    explained     run-out that something else makes, in the model's angle [m]
    """
    responses = _with_reference(model, windows, shaft)
    both = list(zip(windows, responses, strict=True))
    seen_here = [_run_out(window, response, shaft, phase, explained) for window, response in both]
    run_outs = [y for y in seen_here if y is not None]
    run_out = complex(np.mean(run_outs)) if run_outs else None
    if run_out is not None and not _beyond_discs(abs(run_out), shaft, scales, tooth_errors, limits):
        return None
    sidebands = [
        line
        for window, response in both
        for channel in CHANNELS
        for line in _sidebands(window, channel, response, shaft, phase, scales, limits)
    ]
    if not sidebands:
        return None
    disc = scales.once_per_turn[shaft]
    likelihood = _Likelihood(
        measured=np.array([line.measured for line in sidebands]),
        noise=np.array([line.std for line in sidebands]) ** 2,
        lower=np.array([line.lower for line in sidebands]),
        per_metre=np.array([line.per_metre for line in sidebands]),
        run_out=run_out,
        disc=disc,
        scatter=limits.sideband_scatter,
    )
    found, alone = likelihood.best(True), likelihood.best(False)
    E, E_alone = complex(*found.x) * UNIT, complex(*alone.x) * UNIT
    std = _std(likelihood.cost, found.x, abs(E))
    occam = float(np.log(max(std / PRIOR, 1e-6)) * 2 - 0.5 * (abs(E) / PRIOR) ** 2)
    disagreement = 0.0
    if run_out is not None:  # by size: where along the tip circle the contact begins turns the sidebands' phase
        larger = max(abs(run_out), abs(E_alone))
        allowed = np.hypot(limits.run_out_scatter * disc, limits.size_scatter * larger)
        disagreement = float(abs(abs(run_out) - abs(E_alone)) / allowed)
        std = min(std, disc)
    seen = E if run_out is None else run_out
    share, share_std = _shift_share([line for line in sidebands if line.worn], seen, limits.most_shift_share)
    return EccentricityFit(
        shaft=shaft,
        eccentricity=abs(seen),
        high_point=float(np.angle(seen)),
        std=std,
        log_evidence=-float(found.fun) + occam,
        by_sidebands=-float(alone.fun) + occam,
        run_out=None if run_out is None else abs(run_out),
        disagreement=disagreement,
        shift_share=share,
        shift_share_std=share_std,
    )


def _std(cost: Callable[[np.ndarray], float], x: np.ndarray, size: float) -> float:
    """Standard deviation of the eccentricity [m] from the curvature of the cost along it, no wider than the prior."""
    h = 1e-2
    curvature = (cost(x * (1 + h)) + cost(x * (1 - h)) - 2 * cost(x)) / (h * size) ** 2
    return float(1 / np.sqrt(max(curvature, 1 / PRIOR**2)))


def _shift_share(worn: Sequence[_Line], E: complex, most: float) -> tuple[float, float]:
    """How much of the predicted sidebands of worn windows is there, by linear least squares, and its std.

    Without any worn window the whole, give or take the range that it may lie in.
    """
    m, y = np.array([line.predicted(E) for line in worn]), np.array([line.measured for line in worn])
    weight = 1 / np.array([line.std for line in worn]) ** 2
    energy = float(np.sum(weight * np.abs(m) ** 2)) if worn else 0.0
    if energy == 0:
        return 1.0, most / np.sqrt(12)
    share = float(np.clip(np.sum(weight * (np.conj(m) * y).real) / energy, 0.0, most))
    misfit = float(np.sum(weight * np.abs(y - share * m) ** 2)) / len(worn)
    return share, float(np.sqrt(max(misfit, 1.0) / (2 * energy)))
