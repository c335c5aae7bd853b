"""Whether impacts repeat with a turn of a shaft, and whether a line of the envelope keeps its phase to the angle.

    L_nj = mean of s over tooth j of turn n,     r_nj its rank among all, 0 … 1
    z_j = (mean over n of r_nj − ½)·√(12·N),     P = 1 − (1 − Q(z))^Z,  z the largest of z_j

    a(o) = Σ w·(s/s̄ − 1)·exp(−i·o·θ)·2/Σw        s squared envelope, θ absolute angle of the pinion

N turns, Z teeth, Q the normal tail. Ranks know nothing of how heavy the blows are: one tooth leads in every turn by
chance with P. Fewer than FEWEST_TURNS exclude nothing. What runs at nearly a multiple of the turn leads at one tooth
within a window, too, but at another in the next.

Source   mean of N ranks: uniform distribution, central limit; synchronous average of the envelope: P. D. McFadden,
         J. D. Smith, Tribol. Int. 17 (1984) 3–10
"""

from __future__ import annotations

from collections.abc import Iterable
from math import pi

import numpy as np
from scipy.special import ndtr

from twin.closed_forms import ranks
from twin.features.transforms import hann

FEWEST_TURNS = 5


def leading_tooth(
    envelope: np.ndarray, start: float, step: float, teeth: int, ratio: float
) -> tuple[float | None, int]:
    """P that one tooth leads in all turns by chance, and that tooth; None where too few turns were recorded.

    Teeth count from the zero of the angle, so that a tooth has one number in all windows.

    envelope  squared, on an even grid of the pinion's angle from `start` on, `step` apart [rad] (n,)
    teeth     of the shaft; ratio its turns for one of the pinion
    """
    θ = (start + step * np.arange(envelope.size)) * ratio / (2 * pi)
    first, last = int(np.ceil(θ[0])), int(np.floor(θ[-1]))
    turns = last - first
    if turns < FEWEST_TURNS:
        return None, 0
    inside = (θ >= first) & (θ < last)
    cell = np.minimum(((θ[inside] - first) * teeth).astype(int), turns * teeth - 1)
    count = np.maximum(np.bincount(cell, minlength=turns * teeth), 1)
    level = np.bincount(cell, weights=envelope[inside], minlength=turns * teeth) / count
    rank = (ranks(level) - 0.5) / level.size
    by_tooth = rank.reshape(turns, teeth).mean(axis=0)
    z = (by_tooth.max() - 0.5) * np.sqrt(12 * turns)
    return float(-np.expm1(teeth * np.log1p(-min(float(ndtr(-z)), 0.5)))), int(np.argmax(by_tooth))


def locked_lines(
    envelope: np.ndarray, start: float, step: float, orders: Iterable[float]
) -> tuple[tuple[float, float, float], ...]:
    """Lines of a squared envelope at orders of the pinion, at absolute angle: order, real and imaginary part each."""
    weight = hann(envelope.size)
    mean = float(weight @ envelope) / float(weight.sum())
    weighted = weight * (envelope / max(mean, 1e-300) - 1) * (2 / weight.sum())
    θ = start + step * np.arange(envelope.size)
    return tuple((o, float(a.real), float(a.imag)) for o in orders for a in [weighted @ np.exp(-1j * o * θ)])
