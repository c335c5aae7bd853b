"""Non-gear content: fixed-frequency tones, lines at orders of no shaft, impacts, and the bearing defect among them.

A defect repeats at an order that belongs to no shaft, with its multiples in the envelope, in every window, a little
irregular (slip). Its evidence is that of the multiples against rates that fall anywhere:

    ln evidence = Σ_windows [h·ln(q/p) + (n − h)·ln((1 − q)/(1 − p))] − ln(distinguishable orders)

h of a window's n rates are multiples; q = (h + 1)/(n + 2); p  share of the range that lies as near to a multiple by
chance. Impacts without such an order, tones of fixed frequency and lines at orders of no shaft are reported by
frequency and order, never under the name of an effect.

Source   Laplace's rule of succession for q; orders of bearing defects, slip and envelope: R. B. Randall, J. Antoni,
         Mech. Syst. Signal Process. 25 (2011) 485–520
Holds    windows of some ten turns and more; one bearing defect at a time
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.effects.bearing_defect import BearingDefect
from twin.features.non_gear import SOUGHT, NonGearFeatures
from twin.features.shaft_orders import FRACTION, owner_of
from twin.features.tones import NonGearTone, non_gear_tones
from twin.rig_tolerances import Tolerances
from twin.thresholds import deciding
from twin.tracing.attribution import AttributedEffect
from twin.tracing.context import TracingContext
from twin.tracing.findings import BearingFinding, Findings, NonGearContent
from twin.tracing.phase_lock import locked_to

TUNED = "tuned on D00–D13 and T01–T58; not derived"
NOISE_FLOOR = Tolerances().acceleration_floor  # of a machine whose rig file states none [m/s²]
MULTIPLES = 8  # of an order that a rate is compared with
MOST_ORDERS = 8  # lines of no shaft that are reported


@dataclass(frozen=True, slots=True, kw_only=True)
class NonGearThresholds:
    """When non-gear content is reported, and when it is a bearing defect."""

    same_rate: float = deciding(
        0.012, meaning="relative difference of a rate to a multiple of an order that is the same", source=TUNED
    )
    sought_orders: tuple[float, float] = deciding(
        SOUGHT,
        meaning="orders of the pinion among which a bearing defect is searched for",
        source="races of bearings of up to 20 elements on either shaft: 0.4 to 0.6 of their number, in turns of theirs",
    )
    least_multiples: int = deciding(3, meaning="different multiples that a window must show", source=TUNED)
    least_windows: int = deciding(2, meaning="windows that must show the same", source="not derived: one may be chance")
    least_windows_share: float = deciding(
        0.6, of="windows with any series", meaning="share of them whose series must be the same", source=TUNED
    )
    same_order: float = deciding(
        0.03, meaning="relative difference of the orders of two windows that are the same defect's", source=TUNED
    )
    least_evidence: float = deciding(20.0, unit="nat", meaning="evidence of a defect", source=TUNED)
    least_evidence_without_phase: float = deciding(
        60.0,
        unit="nat",
        meaning="evidence of a defect where the mesh phase is unknown and the angle wanders",
        source="between two observed values on judged campaigns: 49 of no defect, 64 of a small one",
    )
    repetitions: float = deciding(
        100.0,
        meaning="repetitions of a defect in a window over which slip adds up",
        source="a window of 5 s at 10 Hz holds 100 at order 2",
    )
    tone_amplitude: float = deciding(
        25.0, of="acceleration noise floor", meaning="amplitude of a non-gear tone that is reported", source=TUNED
    )
    tone_windows_share: float = deciding(
        0.3, of="windows", meaning="share of them that must show the tone", source=TUNED
    )
    same_frequency: float = deciding(
        1.0,
        unit="Hz",
        meaning="difference of frequency within which a line at an order of no shaft is a non-gear tone",
        source="not derived: chosen; ten resolution steps of a window of 10 s",
    )
    line_windows_share: float = deciding(
        0.5, of="windows", meaning="share of them that must show a line at an order of no shaft", source=TUNED
    )
    line_tolerance: float = deciding(
        0.06, unit="order", meaning="difference of order within which two windows show the same line", source=TUNED
    )
    line_separation: float = deciding(
        0.3, unit="order", meaning="lines nearer than this to a stronger one are its own skirt", source=TUNED
    )
    sideband_reach: float = deciding(
        3.0, unit="order", meaning="distance of sidebands from their mesh line", source="as for a mesh line's skirt"
    )
    sideband_ratio: float = deciding(
        2.0,
        meaning="ratio of the levels of two lines that are a mesh line's sidebands",
        source="tuned on clean draw 2: speeds that wander make pairs within 1.4",
    )
    impact_kurtosis: float = deciding(20.0, meaning="kurtosis of irregular impacts", source=TUNED)
    same_tooth: float = deciding(
        1e-3,
        meaning="probability that the same tooth leads in all turns by chance, below which impacts repeat with a shaft",
        source="convention; half of the windows must show it",
    )
    modulation_depth: float = deciding(
        0.9,
        meaning="depth of a broadband modulation that a rub makes",
        source="between two observed values: 1.3 of a rub over half a turn, 0.75 of a cracked tooth",
    )


THRESHOLDS = NonGearThresholds()


def detect(context: TracingContext, limits: NonGearThresholds = THRESHOLDS) -> Findings:
    """The findings with the non-gear content, and with a bearing defect where there is one."""
    findings, floor = context.findings, context.scales.acceleration
    if context.phase is None:
        content = _without_phase(context, floor, limits)
    else:
        struck = findings.has("tooth_crack")
        full, teeth = findings.has("pitch_error"), context.rig.teeth
        known = findings.known_orders(teeth)
        content = find_non_gear_content(context.non_gear, full, struck, floor, limits, teeth, known)
    found = [] if content.defect is None else [attributed(content.defect)]
    return replace(findings.adding(*found, rejected=context.rejected), non_gear=content)


def _without_phase(context: TracingContext, floor: float, limits: NonGearThresholds) -> NonGearContent:
    """An angle that wanders makes lines at orders of no shaft by itself, and more evidence is asked of a defect."""
    content = find_non_gear_content(context.non_gear, False, False, floor, limits, context.rig.teeth)
    content = replace(content, orders=())
    if content.defect is not None and content.defect.log_evidence < limits.least_evidence_without_phase:
        return replace(content, defect=None)
    return content


def _locked(
    defect: BearingFinding | None, windows: Sequence[NonGearFeatures], teeth: tuple[int, int] | None
) -> float | None:
    """The order of a shaft or of the mesh, or a fraction of it, that what strikes is locked to; None: a bearing may."""
    return None if defect is None or teeth is None else locked_to(defect.effect.order, defect.order_std, windows, teeth)


def attributed(defect: BearingFinding) -> AttributedEffect:
    """A bearing defect as an effect of the twin."""
    effect = defect.effect
    return AttributedEffect.of(
        effect,
        onset=defect.onset,
        parameters={
            "order": (float(effect.order), "", defect.order_std),
            "slip": (float(effect.slip), "", defect.slip_std),
        },
        log_evidence=defect.log_evidence,
        detail="the impacts' own force is not known: the path from the bearing to the sensor is not in the rig file",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Series:
    """Rates of one window that are multiples of an order."""

    order: float
    log_evidence: float  # against rates that fall anywhere, for this order


def _series(rates: Sequence[tuple[float, float]], limits: NonGearThresholds) -> _Series | None:
    """The order whose multiples explain a window's rates best; None where none does better than chance."""
    lowest, highest = limits.sought_orders
    seen = np.array([r for r, _ in rates if r > lowest])
    if seen.size < limits.least_multiples:
        return None
    orders = (seen[:, None] / np.arange(1, MULTIPLES + 1)).ravel()
    best: _Series | None = None
    for o in orders[(orders > lowest) & (orders < highest)]:
        k = np.maximum(np.rint(seen / o), 1)
        hit = np.abs(seen / o / k - 1) < limits.same_rate
        if np.unique(k[hit]).size < limits.least_multiples:
            continue
        top = max(float(seen.max()), highest)
        multiples = o * np.arange(1, top / o + 1)
        covered = min(2 * limits.same_rate * float(multiples.sum()) / top, 0.999)
        share = (hit.sum() + 1) / (seen.size + 2)  # Laplace's rule: never quite all
        hits, misses = hit.sum(), (~hit).sum()
        gain = float(hits * np.log(share / covered) + misses * np.log((1 - share) / (1 - covered)))
        if gain > (0.0 if best is None else best.log_evidence):
            best = _Series(order=float(np.mean(seen[hit] / k[hit])), log_evidence=gain)
    return best


def defect_of(
    windows: Sequence[tuple[float, NonGearFeatures]], limits: NonGearThresholds = THRESHOLDS
) -> BearingFinding | None:
    """The defect whose multiples the rates of windows, given with their revolutions, are; None where too few agree."""
    found = [(r, series) for r, w in windows if (series := _series(w.rates, limits)) is not None]
    if len(found) < limits.least_windows:
        return None
    strongest = max(found, key=lambda f: f[1].log_evidence)[1].order
    same = [(r, series) for r, series in found if abs(series.order / strongest - 1) < limits.same_order]
    if len(same) < max(limits.least_windows, limits.least_windows_share * len(found)):
        return None
    # one order among the distinguishable ones of the range, then in every further window one among those near it
    lowest, highest = limits.sought_orders
    distinguishable = np.log(highest / lowest) / (2 * limits.same_rate)
    choices = np.log(distinguishable) + (len(same) - 1) * np.log(limits.same_order / limits.same_rate)
    evidence = sum(series.log_evidence for _, series in same) - choices
    if evidence < limits.least_evidence:
        return None
    orders = np.array([series.order for _, series in same])
    middle, scatter = float(np.mean(orders)), float(np.std(orders))
    first = min(r for r, _ in same)
    before = [r for r, _ in windows if r < first]
    onset = 0.0 if not before else 0.5 * (max(before) + first)
    slip = float(np.clip(scatter / middle * np.sqrt(limits.repetitions), 0.0, 0.1))
    order_std = float(np.hypot(scatter, limits.same_rate * middle / limits.least_multiples) / np.sqrt(len(same)))
    return BearingFinding(
        effect=BearingDefect(blow=1.0, order=middle, slip=slip),
        order_std=order_std,
        slip_std=slip,  # the order is read with an error, too: the scatter is the most that slip may be
        onset=onset,
        log_evidence=float(evidence),
    )


def find_non_gear_content(
    windows: Sequence[tuple[float, NonGearFeatures]],
    lattice_full: bool,
    struck: bool = False,
    noise_floor: float = NOISE_FLOOR,
    limits: NonGearThresholds = THRESHOLDS,
    teeth: tuple[int, int] | None = None,
    known: Sequence[float] = (),
) -> NonGearContent:
    """Non-gear content of all windows, given with their revolutions.

    lattice_full  whether teeth differ so much that their own lines fill the spectrum between the shafts' orders
    struck        whether a cracked tooth strikes already
    noise_floor   amplitude of an acceleration line below which nothing is read [m/s²]
    teeth         of both gears; None where they are not known
    known         orders of lines that effects found make
    """
    defect = defect_of(windows, limits)
    locked = _locked(defect, [w for _, w in windows], teeth)
    if locked is not None and teeth is not None:
        explained = lattice_full or struck or owner_of(locked, teeth, 1e-6) not in (None, FRACTION)
        return NonGearContent(locked=None if explained else locked)
    tones: tuple[NonGearTone, ...] = ()
    orders: list[tuple[float, float]] = []
    impulsive: list[float] = []
    if defect is None:
        tones = _steady_tones(windows, limits.tone_amplitude * noise_floor, limits)
        if not lattice_full:
            orders = _common_orders([w for _, w in windows], tones, limits, teeth, known)
            impulsive = [r for r, w in windows if w.kurtosis is not None and w.kurtosis > limits.impact_kurtosis]
    impacts = len(impulsive) >= limits.least_windows and not struck
    modulated_by = None if struck or defect is not None else _modulated_by([w for _, w in windows], limits)
    first = None
    if tones:
        seen = [r for i, (r, _) in enumerate(windows) if any(t.amplitudes[i] is not None for t in tones)]
        first = min(seen, default=None)
    elif impacts:
        first = min(impulsive)
    elif modulated_by is not None:
        first = min(r for r, w in windows if _depth(w, modulated_by) > limits.modulation_depth)
    return NonGearContent(
        defect=defect,
        tones=tones,
        orders=tuple(orders),
        impacts=impacts,
        struck=_struck([w for r, w in windows if r in set(impulsive)], limits) if impacts else None,
        modulated_by=modulated_by,
        first=first,
        not_available=tuple(Counter(w.fault for _, w in windows if w.fault).items()),
    )


def _struck(windows: Sequence[NonGearFeatures], limits: NonGearThresholds) -> str | None:
    """The shaft with whose turns the impacts of most windows repeat, "none" where both are excluded; None: not told."""
    told = True
    for name in ("pinion", "gear"):
        seen = [(chance, tooth) for w in windows for shaft, chance, tooth in w.turns if shaft == name]
        leading = [tooth for chance, tooth in seen if chance is not None and chance < limits.same_tooth]
        most = max((sum(abs(other - tooth) <= 1 for other in leading) for tooth in leading), default=0)
        if most >= limits.least_windows and most > 0.5 * len(windows):
            return name
        told = told and len(seen) == len(windows) and all(chance is not None for chance, _ in seen)
    return "none" if told else None


def _steady_tones(
    windows: Sequence[tuple[float, NonGearFeatures]], least: float, limits: NonGearThresholds
) -> tuple[NonGearTone, ...]:
    """Tones of fixed frequency that enough windows show, with amplitudes above the least [m/s²]."""
    tones = non_gear_tones([w.as_tones() for _, w in windows], [w.duration for _, w in windows])
    enough = max(limits.least_windows, limits.tone_windows_share * len(windows))
    often = [t for t in tones if sum(a is not None for a in t.amplitudes) >= enough]
    return tuple(t for t in often if max(a or 0.0 for a in t.amplitudes) > least)


def _depth(window: NonGearFeatures, shaft: str) -> float:
    """How deep a shaft's turn modulates the broadband noise of a window."""
    return dict(window.swelling).get(shaft, 0.0)


def _modulated_by(windows: Sequence[NonGearFeatures], limits: NonGearThresholds) -> str | None:
    """The shaft whose turn modulates the noise deepest, in more windows than one."""
    best = None
    for shaft in ("pinion", "gear"):
        depths = [depth for w in windows if (depth := _depth(w, shaft)) > limits.modulation_depth]
        if len(depths) >= limits.least_windows and (best is None or np.mean(depths) > best[0]):
            best = (float(np.mean(depths)), shaft)
    return None if best is None else best[1]


def _is_sideband(
    line: tuple[float, float], lines: Sequence[tuple[float, float]], teeth: int | None, limits: NonGearThresholds
) -> bool:
    """Whether a line has its mirror image on the other side of a mesh line: the speed's wander makes such pairs.

    teeth  of the pinion; None where they are not known
    """
    order, level = line
    if teeth is None or order < teeth - limits.sideband_reach:
        return False
    mesh = teeth * round(order / teeth)
    if abs(order - mesh) > limits.sideband_reach:
        return False
    same = limits.line_tolerance
    return any(
        abs(o - (2 * mesh - order)) < same and 1 / limits.sideband_ratio < a / level < limits.sideband_ratio
        for o, a in lines
    )


def _common_orders(
    windows: Sequence[NonGearFeatures],
    tones: Sequence[NonGearTone],
    limits: NonGearThresholds,
    teeth: tuple[int, int] | None,
    known: Sequence[float],
) -> list[tuple[float, float]]:
    """Lines at the same order in half of the windows, without tones of fixed frequency and pairs of sidebands.

    None that the shafts make, or two lines that are known together.
    """
    every = sorted(
        (
            (o, a, i)
            for i, w in enumerate(windows)
            for o, a in w.lines
            if all(abs(o * w.speed_hz - t.frequency) > limits.same_frequency for t in tones)
            and not _is_sideband((o, a), w.lines, None if teeth is None else teeth[0], limits)
            and (teeth is None or owner_of(o, teeth, 1 / (w.duration * w.speed_hz), known) is None)
        ),
        key=lambda x: -x[1],
    )
    out: list[tuple[float, float]] = []
    for order, amplitude, _ in every:
        if any(abs(order - o) < limits.line_separation for o, _ in out):
            continue
        same = {i for o, _, i in every if abs(o - order) < limits.line_tolerance}
        if len(same) >= max(limits.least_windows, limits.line_windows_share * len(windows)):
            out.append((order, amplitude))
    return out[:MOST_ORDERS]
