"""Is a tooth cracked? One tooth softer than the others changes the lines of its gear at one place of the turn.

    q̂ = argmin Σ_m |Δ_m − R_m(q)·e^{−2πi·m·k/z}|²/σ_m²       over the loss q and the tooth k

Δ_m  change of the gear's lines from one window to the next, or the lines of the first windows     [m]
R_m  response to tooth 0 that has lost the share q of its stiffness, by the harmonic balance, with the flanks that the
     teeth have worn to since then                                                                 [m]

The change must be sudden: at the same teeth, against the step before it and the median of the other steps (errors of
all teeth that wear in change every tooth a little). A crack that grows makes one step after the other at the same
teeth: these are one change, against the steps before the first of them. The change must be larger than a floor, and
have its energy within two tooth pitches, more than a change of all teeth would have by chance. A local pattern in the
first windows is a crack from the start; a single displaced tooth would look alike.

Source   twin/effects/tooth_crack.py; P. D. McFadden, Mech. Syst. Signal Process. 1 (1987) 173–183
Holds    one cracked tooth; both encoders; windows that resolve the orders (8 turns and more)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from twin.effects import EFFECTS
from twin.effects.kept import RESPONSES
from twin.effects.size_law import SizeLaw
from twin.effects.tooth_crack import ToothCrack
from twin.features.window_features import WindowFeatures
from twin.model import Condition, Model
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import TracingContext
from twin.tracing.crack_growth import growing, losses_by_window
from twin.tracing.findings import Findings
from twin.tracing.scatter import MODELLED
from twin.tracing.size_laws import UNIFORM, LawFit
from twin.tracing.tooth_patterns import (
    FINE,
    NAMES,
    PATTERNS,
    Pattern,
    ToothFinding,
    local_share,
    near_energy,
    patterns,
    pinion_orders,
    rms_of,
    tooth_shifts,
)
from twin.wear.profile import WornProfile

TUNED = "tuned on D00–D13 and T01–T58; not derived"
LOSSES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # of stiffness, that are tried; refined by a parabola
NEIGHBOURS = 0.11  # of the grid above
NEAR = 2  # windows on either side of a change that are averaged


@dataclass(frozen=True, slots=True, kw_only=True)
class CrackThresholds:
    """When a local change is a crack."""

    healthy_local_pattern: tuple[float, float] = deciding(
        (0.2, 0.0625),
        of="graduation error of the gear's disc",
        meaning="rms of the lines of pinion and gear in the first windows that a local pattern from the start exceeds",
        source="measured: 0.12 and 0.10 µm on healthy campaigns of the reference rig; not verified on another",
    )
    local_share: float = deciding(
        0.6,
        of="energy of the pattern",
        meaning="share within two tooth pitches of a crack from the start",
        source=TUNED,
    )
    least_change: float = deciding(
        0.0395,
        of="static mesh deflection",
        meaning="rms of a change that a crack makes",
        source="0.08 µm on the reference rig; " + TUNED,
    )
    suddenness: float = deciding(
        3.0,
        of="change of the same teeth between the windows before, or median of the others",
        meaning="what a change has within two tooth pitches of its place",
        source=TUNED + ", by changes of the whole turn",
    )
    same_teeth: float = deciding(
        2.0, unit="tooth pitches", meaning="distance of two steps that are of one growing crack",
        source="derivation: what a softer tooth changes lies within two pitches",
    )  # fmt: skip
    least_quiet: float = deciding(
        0.0167,
        of="pinion graduation error",
        meaning="change from window to window, and noise of a line's change, that is assumed at least",
        source="0.01 µm on the reference rig; not derived: chosen",
    )
    response_scatter: float = deciding(
        0.15, of="line of the change", meaning="what the response to a softer tooth may be off", source=TUNED
    )
    least_evidence: float = deciding(
        12.0, unit="nat", meaning="half the squares of the change over its noise that the crack explains", source=TUNED
    )
    most_unexplained: float = deciding(
        0.6, of="squares of the change over its noise", meaning="share that the crack may leave", source=TUNED
    )


THRESHOLDS = CrackThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LocalChange:
    """A change of one gear's lines at one place of its turn."""

    window: int  # from which it is there; 0 from the start
    shown: tuple[int, ...]  # windows with it, of which the lines are the mean
    lines: np.ndarray  # (n,) complex [m]
    noise: float  # of a line [m]


def detect(context: TracingContext, limits: CrackThresholds = THRESHOLDS) -> Findings:
    """The findings with a cracked tooth; a local pattern from the start is the crack's own and not of pitch errors."""
    findings = context.findings
    if "tooth_crack" in context.rejected:
        return findings
    fitting = context.fitting_mounted
    found = find_crack(
        context.model,
        context.tooth_features,
        [w.condition for w in fitting],
        [context.profiles[w.index] for w in fitting],
        context.mesh_phase,
        context.scales,
        limits,
    )
    if found is None:
        return findings
    if found.onset == 0:
        findings = findings.without("pitch_error")
    return findings.adding(attributed(found))


def attributed(finding: ToothFinding) -> AttributedEffect:
    """A cracked tooth as an effect of the twin."""
    effect = finding.effect
    assert isinstance(effect, ToothCrack)
    return AttributedEffect.of(
        effect,
        onset=finding.onset,
        onset_std=finding.onset_std,
        law=finding.law,
        parameters={
            "stiffness_loss": (float(effect.stiffness_loss), "", finding.std),
            "tooth": (float(effect.tooth), "", finding.tooth_std),
        },
        log_evidence=finding.log_evidence,
        runner_up="pitch_error" if finding.onset == 0 else None,
        detail=f"one tooth of the {effect.on}" + (f"; {finding.detail}" if finding.detail else ""),
    )


def find_crack(
    model: Model,
    windows: Sequence[WindowFeatures],
    conditions: Sequence[Condition],
    profiles: Sequence[WornProfile],
    phase: float,
    scales: Scales,
    limits: CrackThresholds = THRESHOLDS,
) -> ToothFinding | None:
    """A tooth that has become softer, or was from the start; None where no local change stands out.

    windows, conditions, profiles  of measurement windows, (n,) each
    """
    teeth = model.mesh.pair.teeth
    best: ToothFinding | None = None
    for gear in (0, 1):
        seen = patterns(windows, teeth, phase, gear)
        if len(seen) < 2:
            continue
        change = local_change(seen, teeth[gear], gear, scales, limits)
        if change is None:
            continue
        at = change.window
        since = 0.5 * (profiles[at - 1].max_depth + profiles[at].max_depth) if at else 0.0
        flanks = [(conditions[i], profiles[i]) for i in change.shown]
        candidates = _Candidates(model, flanks, since, gear, seen[0].orders, limits)
        found = candidates.fitted(change)
        if found is None or (best is not None and found.log_evidence <= best.log_evidence):
            continue
        best = _finding(found, change, seen)
        if at and (law := _law(candidates, found, change, seen)) is not None:
            depths = [p.max_depth for p in profiles]
            best = _grown(best, found, law, seen, depths)
    return best


def _finding(found: _FittedCrack, change: LocalChange, seen: Sequence[Pattern]) -> ToothFinding:
    """A crack of constant size since the change."""
    at = change.window
    return ToothFinding(
        effect=found.effect,
        onset=0.0 if at == 0 else 0.5 * (seen[at - 1].revolutions + seen[at].revolutions),
        log_evidence=found.log_evidence,
        std=found.std,
        tooth_std=float(np.hypot(found.tooth_std, UNIFORM)),  # a whole number
        onset_std=None if at == 0 else (seen[at].revolutions - seen[at - 1].revolutions) * UNIFORM,
        detail="a single displaced tooth would look alike" if at == 0 else "",
    )


def _law(candidates: _Candidates, found: _FittedCrack, change: LocalChange, seen: Sequence[Pattern]) -> LawFit | None:
    """The growth of a crack over all windows; None where its size is constant."""
    responses = candidates.responses(found.effect.tooth)
    X = np.array([p.lines for p in seen])
    changes = X - X[: min(change.window, PATTERNS.first_windows)].mean(axis=0)
    losses, std = losses_by_window(changes, responses, change.noise, candidates.limits.response_scatter)
    return growing(np.array([p.revolutions for p in seen]), losses, std)


def _grown(
    finding: ToothFinding, found: _FittedCrack, law: LawFit, seen: Sequence[Pattern], depths: Sequence[float]
) -> ToothFinding:
    """The same crack with a size that grows; depths of the windows [m]."""
    turns = [p.revolutions for p in seen]
    crack = ToothCrack.parameters[0]
    effect = replace(
        found.effect,
        stiffness_loss=float(np.clip(law.sizes[0], crack.low, crack.high)),
        onset_depth=float(np.interp(law.onset, [0.0, *turns], [0.0, *depths])),
    )
    return replace(
        finding,
        effect=effect,
        onset=law.onset,
        onset_std=law.onset_std,
        std=float(np.hypot(law.std[0], MODELLED * law.sizes[0])),
        law=SizeLaw(kind="linear", revolutions=(float(turns[-1]),)),
    )


def local_change(
    seen: Sequence[Pattern], z: int, gear: int, scales: Scales, limits: CrackThresholds = THRESHOLDS
) -> LocalChange | None:
    """The window with a local change and the change that came with it; None where none stands out.

    The noise is what a line changes by from window to window otherwise, wear included.
    """
    m = seen[0].orders
    X = np.array([p.lines for p in seen])
    steps = np.array([rms_of(b - a) for a, b in pairwise(X)])
    least = limits.least_quiet * scales.graduation[0]
    noise = max(float(np.median(steps)) * np.sqrt(2 / m.size), least)
    begins = _changes(X, m, z, limits, least)
    candidates = []
    for at, before, size in begins:
        change = X[at : at + NEAR].mean(axis=0) - X[max(before - NEAR, 0) : before].mean(axis=0)
        large = rms_of(change) > limits.least_change * scales.deflection  # before wear adds its own
        if large and _is_local(X[at] - X[before - 1], m, z):
            candidates.append((size, before, at, change))
    latest = max(candidates, key=lambda c: c[0]) if candidates else None
    first = PATTERNS.first_windows
    start = X[: first if latest is None else min(latest[1], first)].mean(axis=0)
    floor = limits.healthy_local_pattern[gear] * scales.graduation[gear]
    # what was local before a change was there from the start: wear alone makes it change once more
    if rms_of(start) > floor and _is_local(start, m, z, limits.local_share):
        shown = tuple(range(min(first, len(seen))))
        widened = max(noise, floor * np.sqrt(2 / m.size))
        return LocalChange(window=0, shown=shown, lines=X[:first].mean(axis=0), noise=widened)
    if latest is None:
        return None
    _, before, at, change = latest
    return LocalChange(window=before, shown=tuple(range(at, min(at + NEAR, len(seen)))), lines=change, noise=noise)


def _changes(
    X: np.ndarray, m: np.ndarray, z: int, limits: CrackThresholds, least: float
) -> list[tuple[int, int, float]]:
    """Sudden changes at some teeth: the window that shows one whole, the first that shows it, and its largest step [m].

    X  lines of every window (w, n); least  change that is assumed from window to window at least [m]
    """
    steps = np.diff(X, axis=0)
    local = np.sqrt(near_energy(steps, m, z))  # (w − 1, places)
    place = local.argmax(axis=1)
    out = []
    for i in range(len(steps)):
        there = local[:, place[i]]
        enough = there[i] / limits.suddenness
        others = np.delete(there, i)
        alone = max(np.median(others), there[i - 1] if i else 0.0) if others.size else 0.0
        if enough > max(alone, least):
            out.append((i + 1, i + 1, float(there[i])))
        elif i and enough > max(there[0], least):
            first = i
            while (
                first
                and _apart(place[first - 1], place[i], z) <= limits.same_teeth
                and _is_local(steps[first - 1], m, z)
            ):
                first -= 1
            if 0 < first < i and enough > there[:first].max():
                out.append((i + 1, first + 1, float(there[i])))
    return out


def _apart(one: int, other: int, z: int) -> float:
    """Distance of two places of a gear's turn, of FINE·z [tooth pitches]."""
    whole = FINE * z
    return abs((int(one) - int(other) + whole // 2) % whole - whole // 2) / FINE


def _is_local(change: np.ndarray, m: np.ndarray, z: int, least: float = 0.0) -> bool:
    """Whether more than a least share of a change lies within two tooth pitches, and more than would by chance."""
    share, spread = local_share(change, m, z)
    return share > max(spread, least)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _FittedCrack:
    effect: ToothCrack
    log_evidence: float
    std: float  # of the loss
    tooth_std: float


class _Candidates:
    """Responses of one gear's lines to a cracked tooth, by loss of stiffness."""

    def __init__(
        self,
        model: Model,
        flanks: Sequence[tuple[Condition, WornProfile]],
        since: float,
        gear: int,
        orders: np.ndarray,
        limits: CrackThresholds,
    ) -> None:
        """flanks  of the windows that show the change; since  depth [m] from which on the teeth wear apart"""
        self.model, self.flanks, self.since = model, flanks, since
        self.gear, self.orders, self.limits = gear, orders, limits
        self.teeth = model.mesh.pair.teeth[gear]

    def crack(self, loss: float, tooth: int) -> ToothCrack:
        """The effect: one tooth of this gear."""
        return EFFECTS["tooth_crack"](stiffness_loss=loss, tooth=tooth, on=NAMES[self.gear], onset_depth=self.since)

    def lines(self, loss: float, tooth: int) -> np.ndarray | None:
        """Lines at the gear's orders, mean of the windows (n,) [m]; None where there is no steady state."""
        crack, orders = self.crack(loss, tooth), pinion_orders(self.orders, self.gear, self.model.mesh.pair.teeth)
        responses = [RESPONSES.get(self.model, (crack,), profile, condition) for condition, profile in self.flanks]
        if not all(response.converged for response in responses):
            return None
        return np.mean([response.transmission_error(orders) for response in responses], axis=0)

    def responses(self, tooth: int) -> dict[float, np.ndarray]:
        """Lines of the gear with a tooth cracked (n,) [m], by its loss, of those that have a steady state."""
        out, shift = {}, None
        for loss in LOSSES:
            one = self.lines(loss, 0)
            if one is not None and shift is None and (following := self.lines(loss, 1)) is not None:
                shift = tooth_shifts(self.teeth, self.orders, one, following)[:, tooth]
            if one is not None and shift is not None:
                out[loss] = one * shift
        return out

    def misfits(self, change: LocalChange, variance: np.ndarray) -> dict[float, np.ndarray]:
        """Squares of what each tooth would leave of a change, over its variance (z,), by loss."""
        shifts: np.ndarray | None = None
        out = {}
        for loss in LOSSES:
            one = self.lines(loss, 0)
            if one is None:
                continue
            if shifts is None:
                following = self.lines(loss, 1)
                if following is None:
                    continue
                shifts = tooth_shifts(self.teeth, self.orders, one, following)
            rest = change.lines[:, None] - one[:, None] * shifts
            out[loss] = (np.abs(rest) ** 2 / variance[:, None]).sum(axis=0)
        return out

    def fitted(self, change: LocalChange) -> _FittedCrack | None:
        """The softer tooth whose response meets a change best; None where it explains too little of it."""
        limits, lines = self.limits, self.orders.size
        variance = change.noise**2 + (limits.response_scatter * np.abs(change.lines)) ** 2
        by_loss = self.misfits(change, variance)
        if not by_loss:
            return None
        loss = min(by_loss, key=lambda q: float(by_loss[q].min()))
        misfits = by_loss[loss]
        tooth = int(np.argmin(misfits))
        misfit = float(misfits[tooth])
        none = float((np.abs(change.lines) ** 2 / variance).sum())
        evidence = 0.5 * (none - misfit)
        if evidence < limits.least_evidence or misfit > limits.most_unexplained * none:
            return None
        widen = max(misfit / lines, 1.0)
        same = {q: float(c[tooth]) for q, c in by_loss.items() if int(np.argmin(c)) == tooth}
        refined, std = _refined(same, loss, widen)
        likely = np.exp((misfit - misfits) / widen)
        away = (np.arange(self.teeth) - tooth + self.teeth // 2) % self.teeth - self.teeth // 2
        return _FittedCrack(
            effect=self.crack(refined, tooth),
            log_evidence=float(evidence),
            std=float(np.hypot(std, MODELLED * refined)),
            tooth_std=float(np.sqrt(likely @ away**2 / likely.sum())),
        )


def _refined(misfits: dict[float, float], best: float, widen: float) -> tuple[float, float]:
    """The loss at the least of a parabola through the best and its neighbours, and its standard deviation.

    The parabola is over q/(1 − q), to which the further deflection of a softer pair is in proportion.
    """
    near = sorted((q, c) for q, c in misfits.items() if abs(q - best) < NEIGHBOURS)
    if len(near) == 3:
        softer = [q / (1 - q) for q, _ in near]
        a, b, _ = np.polyfit(softer, [c for _, c in near], 2)
        if a > 0:
            x = float(np.clip(-b / (2 * a), softer[0], softer[-1]))
            return x / (1 + x), float(np.sqrt(widen / (2 * a))) / (1 + x) ** 2
    return best, LOSSES[1] - LOSSES[0]  # no parabola
