"""Pitch errors: do teeth differ from one another, from the first window on?

The lines at whole orders of both gears in the first windows are compared with those of a healthy machine. Displacements
of all teeth are fitted by linear least squares to those windows whose flanks are new, or to all of the first ones with
the flanks that such teeth have by then; the response is not linear once errors reach what the load deflects, so the fit
goes on with the whole response. The lowest orders get the scatter of run-out and graduation.

A torque ripple makes one such line, too. Where pitch errors do not explain the torque's line, the transmission error's
line at its order proves no pitch errors; they are fitted to what the ripple leaves of it. A run-out of the pinion is no
pitch error either: where the line at its own order is beyond what a disc may be off, it is that of an eccentricity.
The lines of a force with harmonics that moves the housing itself, as a misaligned coupling does, are left out: teeth
cannot make them (twin/tracing/shaft_remainder.py).

Source   twin/effects/pitch_error.py; patterns: twin/tracing/tooth_patterns.py
Holds    both encoders; windows that resolve the orders (8 turns and more)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from twin.effects import EFFECTS
from twin.effects.addition import Addition
from twin.effects.kept import RESPONSES
from twin.effects.response import Effect, ResponseLines
from twin.errors import NotConverged
from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.rig_tolerances import Tolerances
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.beside_ripple import BesideRipple, beside_ripple
from twin.tracing.context import TracingContext
from twin.tracing.detectors.shaft_forces import THRESHOLDS as FORCES
from twin.tracing.detectors.shaft_forces import tooth_errors_explain
from twin.tracing.findings import Findings
from twin.tracing.scatter import MODELLED
from twin.tracing.tooth_patterns import (
    NAMES,
    PATTERNS,
    Pattern,
    ToothFinding,
    patterns,
    pinion_orders,
    rms_of,
    tooth_shifts,
)
from twin.wear.profile import WornProfile

PRIOR = next(p.prior for p in EFFECTS["pitch_error"].parameters)  # of a tooth's displacement [m]
STEPS = 3  # of the fit with the whole response


@dataclass(frozen=True, slots=True, kw_only=True)
class ToothErrorThresholds:
    """When lines at a gear's own orders are pitch errors, and how well they are known."""

    energy_over_healthy: float = deciding(
        5.0,
        of="energy of a healthy machine's pattern",
        meaning="energy beyond it from which pitch errors are reported",
        source="tuned on D00–D13 and T01–T58; not derived",
    )
    new_flanks: float = deciding(
        1.0,
        of="static mesh deflection",
        meaning="depth below which flanks are new: where there are such windows, the errors are fitted to them",
        source="derivation: the load of teeth that differ evens out within such a depth (twin/wear/differing_teeth.py)",
    )
    line_noise: float = deciding(
        0.05, of="pinion graduation error", meaning="noise of a line", source="measured: 0.03 µm on the reference rig"
    )
    line_scatter: float = deciding(
        0.05, of="line", meaning="what the modelled response may be off", source="not derived: chosen"
    )
    force_scatter: float = deciding(
        0.15,
        of="what a torque ripple makes of the line",
        meaning="what that may be off, where pitch errors are fitted to the rest of the line",
        source="the torque meter's path at its lowest harmonic (twin/tracing/scatter.py)",
    )


THRESHOLDS = ToothErrorThresholds()


def detect(context: TracingContext, limits: ToothErrorThresholds = THRESHOLDS) -> Findings:
    """The findings with pitch errors, and without a torque ripple that they explain."""
    findings = context.findings
    if "pitch_error" in context.rejected:
        return findings
    ripple = findings.force("torque")
    found = _fitted(context.with_findings(findings.without(ripple.name)) if ripple else context, limits)
    if ripple is not None and found is not None:
        first = context.fitting[: PATTERNS.first_windows]
        features, worn = [w.features for w in first], [(w.condition, context.profiles[w.index]) for w in first]
        if tooth_errors_explain(
            context.model, features, worn, (found.effect,), context.mesh_phase, round(ripple.order)
        ):
            findings = findings.without(ripple.name)
        else:
            found = _fitted(context, limits)
    if found is None or found.over_healthy <= limits.energy_over_healthy:
        return findings
    return findings.adding(attributed(found), rejected=context.rejected)


def refit(context: TracingContext) -> Findings:
    """The findings with pitch errors fitted anew together with those effects of the mesh that act from the start."""
    findings = context.findings
    if findings.mesh is None or not findings.mesh.found or not findings.has("pitch_error"):
        return findings
    best = findings.mesh.best
    early = tuple(e for t, e in zip(best.trials, best.effects(), strict=True) if t.onset == 0)
    found = _fitted(context, THRESHOLDS, early)
    if found is None:
        return findings
    again = attributed(found)
    return replace(findings, effects=tuple(again if f.name == "pitch_error" else f for f in findings.effects))


def tooth_additions(context: TracingContext, mesh_effects: Sequence[Addition]) -> list[Addition]:
    """The teeth's effects found so far, pitch errors fitted anew together with effects of the mesh from the start."""
    early = tuple(a.effect for a in mesh_effects if a.onset_revolutions == 0)
    again = early and context.findings.has("pitch_error")
    found = _fitted(context, THRESHOLDS, early) if again else None
    return [
        Addition(effect=found.effect) if f.name == "pitch_error" and found is not None else f.addition
        for f in context.findings.tooth_errors
    ]


def _fitted(
    context: TracingContext, limits: ToothErrorThresholds, effects: Sequence[Effect] = ()
) -> ToothFinding | None:
    """Pitch errors fitted with effects of the mesh, and with a suspected ripple of the torque."""
    fitting = context.fitting
    return find_pitch_errors(
        context.model,
        context.tooth_features,
        [w.condition for w in fitting],
        [context.profiles[w.index] for w in fitting],
        context.mesh_phase,
        context.scales,
        context.rig.tolerances,
        effects,
        limits,
        beside_ripple(context, PATTERNS.first_windows, limits.force_scatter, FORCES.same_speed),
    )


def attributed(finding: ToothFinding) -> AttributedEffect:
    """Pitch errors as an effect of the twin."""
    parameters = {}
    for gear in NAMES:
        values = np.array(getattr(finding.effect, gear))
        if values.size:
            rms = float(np.sqrt(np.mean(values**2)))
            std = float(np.hypot(finding.rms_std.get(gear, finding.std / np.sqrt(2 * values.size)), MODELLED * rms))
            parameters[f"{gear}_rms"] = (rms, "m", std)
    return AttributedEffect.of(
        finding.effect,
        parameters=parameters,
        log_evidence=finding.log_evidence,
        detail=finding.detail,
        chance=finding.chance,
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _ToothFit:
    """The linear least squares of one gear's teeth."""

    gear: int
    pattern: Pattern  # of the first windows, from order 1 on
    matrix: np.ndarray  # whitened response and prior (2n + z, z)
    std: np.ndarray  # of each line (n,) [m]

    def rms_std(self, values: np.ndarray) -> float:
        """Standard deviation of the rms of displacements (z,) [m]: √(fᵀ·C·f)/(z·rms), C their covariance."""
        rms = float(np.sqrt(np.mean(values**2)))
        spread = float(values @ np.linalg.solve(self.matrix.T @ self.matrix, values))
        return float(np.sqrt(spread) / (values.size * rms)) if rms > 0 else 0.0

    def explained(self, values: np.ndarray) -> float:
        """Σ|R·f|²/σ², what displacements (z,) [m] make of the lines over their noise: χ² of z − 1 by noise alone."""
        return float(np.sum((self.matrix[: -values.size] @ values) ** 2))

    def correction(self, rest: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Change of the displacements (z,) that leaves the least of lines not yet explained (n,); its mean is none."""
        r = rest / self.std
        right = np.concatenate((r.real, r.imag, -values / PRIOR))
        found = np.linalg.lstsq(self.matrix, right, rcond=None)[0]
        return found - found.mean()


def find_pitch_errors(
    model: Model,
    windows: Sequence[WindowFeatures],
    conditions: Sequence[Condition],
    profiles: Sequence[WornProfile],
    phase: float,
    scales: Scales,
    tolerances: Tolerances,
    effects: Sequence[Effect] = (),
    limits: ToothErrorThresholds = THRESHOLDS,
    beside: BesideRipple | None = None,
) -> ToothFinding | None:
    """Pitch errors of both gears from the first windows; None where a healthy machine's lines explain them.

    windows, conditions, profiles  of measurement windows, the first first (n,); only the first few are used
    effects  of the mesh's period, that are in the twin already
    beside   what pitch errors are fitted to beside a torque ripple, whose line proves none
    """
    first, teeth = list(windows)[: PATTERNS.first_windows], model.mesh.pair.teeth
    shown = first if beside is None else list(beside.windows)
    new = _with_newest_flanks(profiles[: len(first)], limits.new_flanks * scales.deflection)
    strength, counts, measured = [], [], []
    for gear in (0, 1):
        lines = _mean_lines(patterns(first, teeth, phase, gear))
        strength.append(rms_of(lines) / (PATTERNS.healthy_pattern[gear] * scales.graduation[gear]))
        counts.append(lines.size)
        measured.append(_with_low_orders([shown[i] for i in new], teeth, phase, gear))
    if max(strength) < 1.0:
        return None

    def solved(i: int, effect: Effect, period: str | None = None) -> ResponseLines:
        """The response in a window with an effect, and with what it has made of the wear until then."""
        response = RESPONSES.get(model, (*effects, effect), profiles[i], conditions[i], period)
        if not response.converged:
            raise NotConverged("no steady state with displaced teeth")
        return response

    def made_by(effect: Effect, gear: int, orders: np.ndarray) -> np.ndarray:
        """Lines of a gear's own orders with an effect, in the first window that is fitted (n,) [m]."""
        return solved(new[0], effect, NAMES[gear]).transmission_error(pinion_orders(orders, gear, teeth))

    unit = 0.06 * PRIOR  # small against the deflection: the response is linear
    graduation = (tolerances.pinion_graduation, tolerances.gear_graduation)
    fits = []
    for gear, pattern in enumerate(measured):
        if strength[gear] <= 1.0 or pattern is None:
            continue
        m, z = pattern.orders, teeth[gear]
        one, following = (made_by(_one_tooth(gear, z, k, unit), gear, m) for k in (0, 1))
        response = (one / unit)[:, None] * tooth_shifts(z, m, one, following)
        noise = limits.line_noise * scales.graduation[0]
        std = np.hypot(noise, limits.line_scatter * np.abs(pattern.lines)) + _low_orders_std(
            pattern, PATTERNS.lowest_order[gear], graduation[gear], FORCES.run_out * scales.once_per_turn[gear]
        )
        if beside is not None and gear == 0:
            std = np.where(m == beside.order, np.hypot(std, beside.std), std)
        whitened = (response.real / std[:, None], response.imag / std[:, None], np.eye(z) / PRIOR)
        fits.append(_ToothFit(gear=gear, pattern=pattern, matrix=np.concatenate(whitened), std=std))
    values = _displacements(fits, teeth, lambda effect: [solved(i, effect) for i in new])
    B = fits[0].matrix
    # every line a circular Gaussian, of a healthy machine's variance or of its own
    evidence = sum(n * (s**2 - 1 - 2 * np.log(s)) for s, n in zip(strength, counts, strict=True) if s > 1)
    return ToothFinding(
        effect=_pitch_error(values),
        onset=0.0,
        log_evidence=float(evidence),
        std=float(np.sqrt(np.mean(np.diag(np.linalg.inv(B.T @ B))))),
        rms_std={NAMES[fit.gear]: fit.rms_std(values[NAMES[fit.gear]]) for fit in fits},
        chance=float(
            chdtrc(
                sum(v.size - 1 for v in values.values()), sum(fit.explained(values[NAMES[fit.gear]]) for fit in fits)
            )
        ),
        detail=", ".join(f"{n} {1e6 * float(np.std(v)):.2g} µm rms" for n, v in values.items()),
        over_healthy=float(sum(s**2 - 1 for s in strength if s > 1)),
    )


def _low_orders_std(pattern: Pattern, lowest: int, graduation: float, most: float) -> np.ndarray:
    """What the lowest orders may be off (n,) [m]: graduation, or all of a run-out beyond the most that a disc has."""
    size = np.abs(pattern.lines)
    run_out = (pattern.orders == 1) & (size > most)
    return np.where(pattern.orders < lowest, np.where(run_out, size, graduation), 0.0)


def _with_newest_flanks(profiles: Sequence[WornProfile], new: float) -> list[int]:
    """Which of the first windows are fitted: those whose flanks are worn less than a depth [m], all where none is."""
    return [i for i, p in enumerate(profiles) if p.max_depth < new] or list(range(len(profiles)))


def _displacements(fits: Sequence[_ToothFit], teeth: tuple[int, int], solved) -> dict[str, np.ndarray]:
    """Displacements of the teeth by gear, (z,) each [m]: a linear start, then corrected by the whole response.

    solved  the responses with pitch errors in the model, in every window that is fitted
    """
    values = {NAMES[fit.gear]: np.zeros(teeth[fit.gear]) for fit in fits}
    rest = {fit.gear: fit.pattern.lines for fit in fits}
    for step in range(STEPS):
        for fit in fits:
            name = NAMES[fit.gear]
            values[name] = values[name] + fit.correction(rest[fit.gear], values[name])
        if step == STEPS - 1:
            break
        try:
            responses = solved(_pitch_error(values))
        except NotConverged:
            break
        for fit in fits:
            orders = pinion_orders(fit.pattern.orders, fit.gear, teeth)
            rest[fit.gear] = fit.pattern.lines - np.mean([r.transmission_error(orders) for r in responses], axis=0)
    return values


def _pitch_error(values: dict[str, np.ndarray]) -> Effect:
    return EFFECTS["pitch_error"](**{n: tuple(v.tolist()) for n, v in values.items()})


def _one_tooth(gear: int, z: int, tooth: int, value: float) -> Effect:
    return EFFECTS["pitch_error"](**{NAMES[gear]: tuple(value if k == tooth else 0.0 for k in range(z))})


def _mean_lines(seen: Sequence[Pattern]) -> np.ndarray:
    return np.mean([p.lines for p in seen], axis=0) if seen else np.zeros(0)


def _with_low_orders(
    windows: Sequence[WindowFeatures], teeth: tuple[int, int], phase: float, gear: int
) -> Pattern | None:
    """The mean pattern of windows from order 1 on."""
    seen = patterns(windows, teeth, phase, gear, lowest=1)
    if not seen:
        return None
    return Pattern(revolutions=seen[0].revolutions, orders=seen[0].orders, lines=_mean_lines(seen))
