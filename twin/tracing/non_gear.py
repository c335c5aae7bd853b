"""What no gear makes: foreign tones, modulations, impacts; and the bearing defect among the impacts.

A defect repeats at an order that belongs to no shaft, with its multiples in the envelope, in every window, a little
irregular (slip). Its evidence is that of the multiples against rates that fall anywhere:

    ln evidence = Σ_windows [h·ln(q/p) + (n − h)·ln((1 − q)/(1 − p))] − ln(orders told apart)

h of a window's n rates are multiples; q = (h + 1)/(n + 2); p  share of the range that lies as near to a multiple by
chance. Impacts without such an order, tones steady in hertz and lines at orders of no shaft have no name in the table:
they are reported by frequency and order, never under another's name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.effects.bearing_defect import BearingDefect
from twin.features.non_gear import NonGearFeatures
from twin.features.tones import ForeignTone, foreign_tones

IMPULSIVE = 8.0  # kurtosis of impacts
LEAST_WINDOWS = 2
MULTIPLES = 8
CLOSE = 0.012  # relative, of a rate to a multiple of an order
ORDERS = (0.3, 12.0)  # sought, of the pinion's rotation
MATCHES = 3  # multiples that must be there in a window
LEAST_EVIDENCE = 20.0  # of a defect [nat]
LEAST_SHARE = 0.6  # of the windows with a series whose series must be this one
SAME_ORDER = 0.03
REPETITIONS = 100  # of a defect in a window: slip adds up over them, and the window's order shows their mean
SHARE_OF_WINDOWS = 0.5
SWELLING = 0.9  # depth of a modulation: what rubs over half a turn reaches 1.3, a cracked tooth 0.75
SAME_HERTZ = 1.0
LEAST_AMPLITUDE = 0.05  # of a foreign tone [m/s²]


@dataclass(frozen=True, slots=True, kw_only=True)
class Defect:
    """A bearing defect."""

    effect: BearingDefect
    order_std: float
    slip_std: float
    onset: float
    log_evidence: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NonGearContent:
    """What was heard beside the gears over all windows."""

    defect: Defect | None
    tones: tuple[ForeignTone, ...]
    orders: tuple[tuple[float, float], ...]  # order-locked lines of no shaft: order, amplitude [m/s²]
    impacts: bool  # irregular ones
    swelling: str | None  # the shaft with whose turn noise comes and goes, though no tooth strikes
    first: float | None  # revolutions of the first window with any of the unknown ones

    @property
    def unknown(self) -> bool:
        return bool(self.tones or self.orders or self.impacts or self.swelling)

    def sentence(self) -> str:
        """What is unknown, in words."""
        parts = []
        if self.tones:
            parts.append("tones steady in hertz: " + ", ".join(f"{t.frequency:.2f} Hz" for t in self.tones))
        if self.orders:
            parts.append("lines at orders of no shaft: " + ", ".join(f"{o:.3f}" for o, _ in self.orders))
        if self.impacts:
            parts.append("impacts that repeat with no shaft")
        if self.swelling:
            parts.append(f"noise that comes and goes with every turn of the {self.swelling}, as where something rubs")
        return "; ".join(parts)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Series:
    """Rates of one window that are multiples of an order."""

    order: float
    log_evidence: float  # against rates that fall anywhere, for this order


def _series(rates: Sequence[tuple[float, float]]) -> _Series | None:
    """The order whose multiples explain a window's rates best; None where none does better than chance."""
    seen = np.array([r for r, _ in rates if r > ORDERS[0]])
    if seen.size < MATCHES:
        return None
    orders = (seen[:, None] / np.arange(1, MULTIPLES + 1)).ravel()
    best: _Series | None = None
    for o in orders[(orders > ORDERS[0]) & (orders < ORDERS[1])]:
        k = np.maximum(np.rint(seen / o), 1)
        hit = np.abs(seen / o / k - 1) < CLOSE
        if np.unique(k[hit]).size < MATCHES:
            continue
        highest = max(float(seen.max()), ORDERS[1])
        multiples = o * np.arange(1, highest / o + 1)
        covered = min(2 * CLOSE * float(multiples.sum()) / highest, 0.999)
        share = (hit.sum() + 1) / (seen.size + 2)  # Laplace's rule: never quite all
        hits, misses = hit.sum(), (~hit).sum()
        gain = float(hits * np.log(share / covered) + misses * np.log((1 - share) / (1 - covered)))
        if gain > (0.0 if best is None else best.log_evidence):
            best = _Series(order=float(np.mean(seen[hit] / k[hit])), log_evidence=gain)
    return best


def _defect(windows: Sequence[tuple[float, NonGearFeatures]]) -> Defect | None:
    found = [(r, series) for r, w in windows if (series := _series(w.rates)) is not None]
    if len(found) < LEAST_WINDOWS:
        return None
    strongest = max(found, key=lambda f: f[1].log_evidence)[1].order
    same = [(r, series) for r, series in found if abs(series.order / strongest - 1) < SAME_ORDER]
    if len(same) < max(LEAST_WINDOWS, LEAST_SHARE * len(found)):
        return None
    # one order among those told apart in the range, then in every further window one among those near it
    told_apart = np.log(ORDERS[1] / ORDERS[0]) / (2 * CLOSE)
    choices = np.log(told_apart) + (len(same) - 1) * np.log(SAME_ORDER / CLOSE)
    evidence = sum(series.log_evidence for _, series in same) - choices
    if evidence < LEAST_EVIDENCE:
        return None
    orders = np.array([series.order for _, series in same])
    middle, scatter = float(np.mean(orders)), float(np.std(orders))
    first = min(r for r, _ in same)
    before = [r for r, _ in windows if r < first]
    onset = 0.0 if not before else 0.5 * (max(before) + first)
    slip = float(np.clip(scatter / middle * np.sqrt(REPETITIONS), 0.0, 0.1))
    return Defect(
        effect=BearingDefect(blow=1.0, order=middle, slip=slip),
        order_std=float(np.hypot(scatter, CLOSE * middle / MATCHES) / np.sqrt(len(same))),
        slip_std=slip,  # the order is read with an error, too: the scatter is the most that slip may be
        onset=onset,
        log_evidence=float(evidence),
    )


def find_non_gear_content(
    windows: Sequence[tuple[float, NonGearFeatures]], lattice_full: bool, struck: bool = False
) -> NonGearContent:
    """What all windows, with their revolutions, have beside the gears.

    struck        whether a cracked tooth strikes already
    lattice_full  whether teeth differ so much that their own lines fill the spectrum between the shafts' orders
    """
    defect = _defect(windows)
    tones = foreign_tones([w.as_tones() for _, w in windows], [w.duration for _, w in windows])
    often = [t for t in tones if sum(a is not None for a in t.amplitudes) >= max(2, 0.3 * len(windows))]
    tones = tuple(t for t in often if max(a or 0.0 for a in t.amplitudes) > LEAST_AMPLITUDE)
    orders: list[tuple[float, float]] = []
    impacts = False
    if defect is not None:
        tones = ()
    elif not lattice_full:
        orders = _common_orders([w for _, w in windows], tones)
        impulsive = [w.kurtosis > 2.5 * IMPULSIVE for _, w in windows]
        impacts = sum(impulsive) >= LEAST_WINDOWS and not struck
    swelling = None if struck or defect is not None else _swelling([w for _, w in windows])
    first = None
    if tones:
        seen = [r for i, (r, _) in enumerate(windows) if any(t.amplitudes[i] is not None for t in tones)]
        first = min(seen, default=None)
    elif impacts:
        first = min(r for r, w in windows if w.kurtosis > 2.5 * IMPULSIVE)
    elif swelling is not None:
        first = min(r for r, w in windows if dict(w.swelling).get(swelling, 0.0) > SWELLING)
    return NonGearContent(
        defect=defect, tones=tones, orders=tuple(orders), impacts=impacts, swelling=swelling, first=first
    )


def _swelling(windows: Sequence[NonGearFeatures]) -> str | None:
    """The shaft with which the noise swells deepest, in more windows than one."""
    best = None
    for shaft in ("pinion", "gear"):
        depths = [depth for w in windows if (depth := dict(w.swelling).get(shaft, 0.0)) > SWELLING]
        if len(depths) >= LEAST_WINDOWS and (best is None or np.mean(depths) > best[0]):
            best = (float(np.mean(depths)), shaft)
    return None if best is None else best[1]


def _common_orders(windows: Sequence[NonGearFeatures], tones: Sequence[ForeignTone]) -> list[tuple[float, float]]:
    """Lines that stand at the same order in half of the windows, without the tones that are steady in hertz."""
    every = sorted(
        (
            (o, a, i)
            for i, w in enumerate(windows)
            for o, a in w.lines
            if all(abs(o * w.speed_hz - t.frequency) > SAME_HERTZ for t in tones)
        ),
        key=lambda x: -x[1],
    )
    out: list[tuple[float, float]] = []
    for order, amplitude, _ in every:
        if any(abs(order - o) < 0.3 for o, _ in out):
            continue
        tolerance = 0.06
        same = {i for o, _, i in every if abs(o - order) < tolerance}
        if len(same) >= max(LEAST_WINDOWS, SHARE_OF_WINDOWS * len(windows)):
            out.append((order, amplitude))
    return out[:8]
