"""What held-out windows say of an effect that no steady state predicts line by line.

    envelope   rates at which the envelope of the acceleration repeats, of depth a (a bearing defect):
               before = √(1 − n·c), after = √(Σ_misses a²/Σ a²) at the best order near its own: rolling elements slip
    swing      the line by which the torque, or without its meter the transmission error, swings (teeth that separate):
               before = 1, after = |A − Â|/A

c     share of the range that lies near a multiple of one order by chance, and n how many orders can be told apart there
A, Â  amplitude in the window, and its median over the windows that were fitted

A window without such rates, or without the line, speaks neither for the effect nor against it: both errors are one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from twin.effects.response import Effect
from twin.features.non_gear import NonGearFeatures
from twin.tracing.detectors.non_gear import THRESHOLDS as RATES
from twin.updating.history import WindowInput

ORDER = "order"  # parameter of every effect that claims such content
SWINGING = ("torque", "transmission_error")  # channels that show a swing, the first that is there

Errors = tuple[float, float]  # of one window, without the effect and with it


def content_change(
    effect: Effect, windows: Sequence[WindowInput], fitted: Sequence[WindowInput]
) -> tuple[list[float], list[float]]:
    """Errors of what the effect claims without it and with it, one of each for every window.

    windows  that took no part in its fit
    fitted   those that did
    """
    pairs = CONTENT[effect.facts.claims](getattr(effect, ORDER), windows, fitted)
    return [before for before, _ in pairs], [after for _, after in pairs]


def _envelopes(order: float, windows: Sequence[WindowInput], fitted: Sequence[WindowInput]) -> list[Errors]:
    return [_of_envelope(w.non_gear, order) for w in windows if w.non_gear is not None]


def _swings(order: float, windows: Sequence[WindowInput], fitted: Sequence[WindowInput]) -> list[Errors]:
    usual = [a for w in fitted if (a := _swing(w, order)) is not None]
    return [_of_swing(_swing(w, order), usual) for w in windows]


def _of_envelope(seen: NonGearFeatures, order: float) -> Errors:
    lowest, highest = RATES.sought_orders
    rates = np.array([(rate, depth) for rate, depth in seen.rates if rate > lowest]).reshape(-1, 2)
    if not rates.size:
        return 1.0, 1.0
    top = max(float(rates[:, 0].max()), highest)
    multiples = order * np.arange(1, top / order + 1)
    covered = 2 * RATES.same_rate * float(multiples.sum()) / float(multiples[-1])
    chance = min(covered * RATES.same_order / RATES.same_rate, 1.0)
    k = np.maximum(np.rint(rates[:, 0] / order), 1)
    near = rates[:, 0] / k
    near = np.append(near[np.abs(near / order - 1) < RATES.same_order], order)
    k = np.maximum(np.rint(rates[:, 0] / near[:, None]), 1)
    missed = np.abs(rates[:, 0] / near[:, None] / k - 1) >= RATES.same_rate
    energy = rates[:, 1] ** 2
    left = np.sum(energy * missed, axis=1) / energy.sum()
    return float(np.sqrt(1 - chance)), float(np.sqrt(left.min()))


def _swing(window: WindowInput, order: float) -> float | None:
    for channel in SWINGING:
        lines = getattr(window.features, channel)
        y = None if lines is None else lines.get(0, round(order), 0)
        if y is not None:
            return abs(y)
    return None


def _of_swing(amplitude: float | None, usual: Sequence[float]) -> Errors:
    if not amplitude or not usual:
        return 1.0, 1.0
    return 1.0, abs(amplitude - float(np.median(usual))) / amplitude


CONTENT: Mapping[str, Callable[[float, Sequence[WindowInput], Sequence[WindowInput]], list[Errors]]] = {
    "envelope": _envelopes,
    "swing": _swings,
}  # by what effects claim (twin/effects/facts.py); lines are predicted by a steady state
