"""What no gear makes: foreign tones, modulations, impacts; and the bearing defect among the impacts.

A defect repeats at an order that belongs to no shaft, with its multiples in the envelope, in every window, a little
irregular (slip). Impacts without such an order, tones steady in hertz and lines at orders of no shaft have no name in
the table: they are reported by frequency and order, never under another's name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.effects.bearing_defect import BearingDefect
from twin.features.beside import Beside
from twin.features.foreign import ForeignTone, foreign_tones

IMPULSIVE = 8.0  # kurtosis of impacts
LEAST_WINDOWS = 2
MULTIPLES = 8
CLOSE = 0.012  # relative, of a rate to a multiple of an order
ORDERS = (0.3, 12.0)  # sought, of the pinion's rotation
MATCHES = 3  # multiples that must be there in a window
SAME_ORDER = 0.03
SHARE_OF_WINDOWS = 0.5
SAME_HERTZ = 1.0
LEAST_AMPLITUDE = 0.05  # of a foreign tone [m/s²]


@dataclass(frozen=True, slots=True, kw_only=True)
class Defect:
    """A bearing defect."""

    effect: BearingDefect
    order_std: float
    onset: float
    log_evidence: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Strangers:
    """What was heard beside the gears over all windows."""

    defect: Defect | None
    tones: tuple[ForeignTone, ...]
    orders: tuple[tuple[float, float], ...]  # order-locked lines of no shaft: order, amplitude [m/s²]
    impacts: bool  # irregular ones
    first: float | None  # revolutions of the first window with any of the unknown ones

    @property
    def unknown(self) -> bool:
        return bool(self.tones or self.orders or self.impacts)

    def sentence(self) -> str:
        """What is unknown, in words."""
        parts = []
        if self.tones:
            parts.append("tones steady in hertz: " + ", ".join(f"{t.frequency:.2f} Hz" for t in self.tones))
        if self.orders:
            parts.append("lines at orders of no shaft: " + ", ".join(f"{o:.3f}" for o, _ in self.orders))
        if self.impacts:
            parts.append("impacts that repeat with no shaft")
        return "; ".join(parts)


def _fundamental(rates: Sequence[tuple[float, float]]) -> tuple[float, int] | None:
    """The order of which the most rates are multiples, and how many."""
    best: tuple[int, float, float] | None = None
    for rate, _ in rates:
        for n in range(1, MULTIPLES + 1):
            o = rate / n
            if not ORDERS[0] < o < ORDERS[1]:
                continue
            k = np.array([r / o for r, _ in rates])
            near = np.rint(k)
            hits = (near >= 1) & (np.abs(k / np.maximum(near, 1) - 1) < CLOSE)
            score = (int(hits.sum()), o)
            if best is None or (score[0], score[1]) > (best[0], best[1]):
                refined = float(np.mean([r / m for (r, _), m, h in zip(rates, near, hits, strict=True) if h]))
                best = (score[0], o, refined)
    return None if best is None or best[0] < MATCHES else (best[2], best[0])


def _defect(windows: Sequence[tuple[float, Beside]]) -> Defect | None:
    found = []
    for revolutions, w in windows:
        if w.kurtosis > IMPULSIVE and w.rates:
            got = _fundamental(w.rates)
            if got is not None:
                found.append((revolutions, *got))
    if len(found) < LEAST_WINDOWS:
        return None
    orders = np.array([o for _, o, _ in found])
    middle = float(np.median(orders))
    same = np.abs(orders / middle - 1) < SAME_ORDER
    if same.sum() < max(LEAST_WINDOWS, 0.6 * len(found)):
        return None
    first = min(r for (r, _, _), ok in zip(found, same, strict=True) if ok)
    before = [r for r, w in windows if r < first]
    onset = 0.0 if not before else 0.5 * (max(before) + first)
    slip = float(np.clip(np.std(orders[same]) / middle * np.sqrt(100), 0.0, 0.1))
    return Defect(
        effect=BearingDefect(blow=1.0, order=float(np.mean(orders[same])), slip=slip),
        order_std=float(np.std(orders[same]) / np.sqrt(same.sum())),
        onset=onset,
        log_evidence=float(10.0 * same.sum()),
    )


def strangers(windows: Sequence[tuple[float, Beside]], lattice_full: bool, struck: bool = False) -> Strangers:
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
    first = None
    if tones:
        seen = [r for i, (r, _) in enumerate(windows) if any(t.amplitudes[i] is not None for t in tones)]
        first = min(seen, default=None)
    elif impacts:
        first = min(r for r, w in windows if w.kurtosis > 2.5 * IMPULSIVE)
    return Strangers(defect=defect, tones=tones, orders=tuple(orders), impacts=impacts, first=first)


def _common_orders(windows: Sequence[Beside], tones: Sequence[ForeignTone]) -> list[tuple[float, float]]:
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
