"""Errors of held-out windows on the lines that one effect moves, channel by channel: what the effect claims to explain.

    error = √(Σ |y − m|² / Σ |y|²)      over the windows' lines with |b − a|² > c²·v(b)

y     measured line of a channel
m     predicted without the effect (a) or with it (b), all other effects in the twin both times
v(b)  what the line of a healthy machine scatters by (twin/tracing/healthy_lines.py)

Torque lines below the bandwidth of a motor's speed control, which no rig file describes, are claimed only by what is a
torque itself: the control decides what torque a displacement of the teeth makes there.
The lines are chosen by the predictions alone, so that the choice favours neither. The error of a whole channel also
holds what the structure of the twin misses; beside it, an effect of a few weak lines does not show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.assessment import MovedLines
from twin.thresholds import deciding
from twin.tracing.held_out_error import ChannelComparison, HeldOutComparison


@dataclass(frozen=True, slots=True, kw_only=True)
class MovedLineLimits:
    """Which lines an effect claims."""

    least_move: float = deciding(
        2.0,
        of="standard deviation of the line",
        meaning="move of a predicted line from which an effect is judged by it",
        source="derivation: the error of a single line that moves so far rises by chance in 8 % of the cases in which "
        "the effect is there as fitted, and in fewer where lines are several",
    )
    speed_control: float = deciding(
        20.0,
        unit="Hz",
        meaning="frequency up to which the speed control of a motor decides the torque that a displacement makes",
        source="not derived: chosen as the usual bandwidth of speed controls; simulated machines with such a control, "
        "on wide draw 1, differ from the model by 20 % and 35° at 18 Hz, and by a factor of five at 5 Hz",
    )


MOVED_LINE_LIMITS = MovedLineLimits()


def moved_lines(
    windows: Sequence[tuple[HeldOutComparison, HeldOutComparison]],
    is_torque: bool = False,
    limits: MovedLineLimits = MOVED_LINE_LIMITS,
) -> tuple[MovedLines, ...]:
    """Of every channel in which the effect moves lines: how many, and their error without and with it.

    windows    each as the twin without and with the effect predicts it
    is_torque  whether the effect is a torque on a shaft
    """
    sums: dict[str, np.ndarray] = {}  # by channel: lines, energies measured, left without and left with the effect
    for without, present in windows:
        for name, before in without.channels.items():
            after = present.channels[name]
            moved = np.abs(after.predicted - before.predicted) ** 2
            own = counted_lines(name, after, present.speed_hz, is_torque)
            own &= moved > limits.least_move**2 * after.variance
            energies = [
                float(np.sum(np.abs(lines[own]) ** 2))
                for lines in (before.measured, before.measured - before.predicted, after.measured - after.predicted)
            ]
            sums[name] = sums.get(name, np.zeros(4)) + np.array([np.count_nonzero(own), *energies])
    return tuple(
        MovedLines(
            channel=name,
            lines=int(count),
            before=float(np.sqrt(before / measured)),
            after=float(np.sqrt(after / measured)),
        )
        for name, (count, measured, before, after) in sums.items()
        if count and measured > 0
    )


def counted_lines(
    channel: str,
    lines: ChannelComparison,
    speed_hz: float,
    is_torque: bool,
    limits: MovedLineLimits = MOVED_LINE_LIMITS,
) -> np.ndarray:
    """Which lines of a channel (n,) an effect can be judged by; bool."""
    if channel == "torque" and not is_torque:
        return lines.orders * speed_hz > limits.speed_control
    return np.ones(lines.orders.size, dtype=bool)


def shown_share(windows: Sequence[tuple[ChannelComparison, ChannelComparison]]) -> tuple[float, float]:
    """The share of what an effect makes of a channel's lines that the channel shows: 1 as predicted, 0 none of it.

    a = |Σ_o p_o|/Σ|b − a|²/v,  std = √(½·Σ_o |p_o|²)/Σ|b − a|²/v,  p_o = Σ (y − a)·conj(b − a)/v over the windows

    The standard deviation, per real and imaginary part, is that of lines of the same size whose phases have nothing to
    do with the prediction; a path to the sensor that turns them all alike hides nothing.

    windows  one channel of each without and with the effect
    """
    by_order: dict[float, complex] = {}
    size = 0.0
    for without, present in windows:
        move = present.predicted - without.predicted
        size += float(np.sum(np.abs(move) ** 2 / present.variance))
        products = (present.measured - without.predicted) * move.conj() / present.variance
        for order, product in zip(np.round(present.orders, 6).tolist(), products.tolist(), strict=True):
            by_order[order] = by_order.get(order, 0j) + product
    if not size > 0:
        return 0.0, float("inf")
    sums = np.array(list(by_order.values()))
    return float(abs(sums.sum())) / size, float(np.sqrt(0.5 * np.sum(np.abs(sums) ** 2))) / size
