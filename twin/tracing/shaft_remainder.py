"""Lines at whole orders of the pinion's turn that no displacement between the teeth makes: a force on the shaft.

    r = y − ρ·e,     ρ = H_y/H_e  for a displacement in the mesh        s² = |ρ|²·(σ_disc² + κ²·|e|²)

y     line of acceleration or torque at order p                    e      that of the transmission error
σ     standard deviation of y's real and of its imaginary part     σ_disc that of the discs' errors at this order
κ     what a modelled ratio may be off, as for lines of no shaft (twin/tracing/unknown_entry.py)

Teeth that differ, eccentric gears and worn flanks displace the mesh: at the low orders of a shaft, far below the modes
of the structure, that moves the housing by nanometres. What turns with the shaft and pushes on it or on the housing (a
misaligned coupling, a rub over part of a turn, a foot that lifts off, an unbalance) moves the housing itself. A line
stands out where the windows that show it leave Σ|r|²/σ² beyond chance, and its level beyond s.
A line that begins while the machine is watched is compared with the windows before: the discs' errors stay and go from
the difference.

Source   χ² of Gaussian noise; orders of a misaligned coupling: M. Xu, R. D. Marangoni, J. Sound Vib. 176 (1994)
         663–691; of looseness and rubs: A. Muszynska, Rotordynamics (2005), ch. 6
Holds    both encoders; accelerometer lines up to order 3, torque lines up to order 10
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from twin.effects.unknown_effect import transfers
from twin.features.window_features import MeasuredLines, WindowFeatures
from twin.model import Model
from twin.scales import Scales
from twin.thresholds import deciding
from twin.tracing.unknown_entry import THRESHOLDS as ENTRY

ORDERS_READ = {"acceleration": range(1, 4), "torque": range(1, 11)}  # orders of the pinion that are read


@dataclass(frozen=True, slots=True, kw_only=True)
class ShaftRemainderThresholds:
    """When a line at an order of the pinion is a force that no displacement in the mesh makes."""

    chance: float = deciding(
        1e-8,
        meaning="probability that noise alone leaves as much, in one line of all windows since its onset",
        source="not derived: 13 lines a campaign and a noise that is estimated from few bins leave a margin of 1e4",
    )
    least_acceleration: float = deciding(
        1.5,
        of="acceleration noise floor",
        meaning="level of an acceleration line",
        source="tuned on wide draw 1; healthy machines reach 0.7",
    )
    least_torque: float = deciding(
        1.0, of="torque noise floor", meaning="level of a torque line", source="as for a torque ripple"
    )
    over_mesh: float = deciding(
        3.0,
        of="what the discs' errors and the model's ratio leave",
        meaning="level of a line that no displacement in the mesh makes",
        source="derivation: three standard deviations",
    )
    window_cost: float = deciding(
        4.0,
        unit="nat",
        meaning="evidence that a window must add to count as one that shows the line",
        source="derivation: noise alone adds 1 on average and 4 in 1 of 50 windows",
    )
    least_windows: int = deciding(2, meaning="windows that must show a line", source="not derived: one may be chance")
    least_changed: float = deciding(
        0.4,
        of="level of a line that was there from the start",
        meaning="level by which a line has changed",
        source="tuned on wide draw 1; what does not change, as a disturbance of the drive, has gone from it",
    )
    same_condition: float = deciding(
        0.05, meaning="difference of ln speed and of ln torque within which windows are compared", source="as segments"
    )
    least_before: int = deciding(2, meaning="windows before a change in its condition", source="as `least_windows`")
    dominance: float = deciding(
        3.0, meaning="line of a force of one order over lines at other orders", source="as for a torque ripple"
    )


THRESHOLDS = ShaftRemainderThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class ShaftLine:
    """One line of a channel at an order of the pinion, beyond what the mesh makes of it."""

    order: int
    channel: str  # "acceleration" or "torque"
    level: float  # rms over the windows without noise, in the channel's unit
    since: int  # position of the first window that shows it


def shaft_lines(
    model: Model, windows: Sequence[WindowFeatures], scales: Scales, limits: ShaftRemainderThresholds = THRESHOLDS
) -> tuple[ShaftLine, ...]:
    """Lines at the pinion's orders that no displacement in the mesh makes, the strongest of each channel first."""
    orders = np.arange(1, 1 + max(max(r) for r in ORDERS_READ.values()))
    ratio = [_ratios(model, w, orders) for w in windows]
    least = {
        "acceleration": limits.least_acceleration * scales.acceleration,
        "torque": limits.least_torque * scales.torque_noise,
    }
    out = []
    for channel, range_ in ORDERS_READ.items():
        for p in range_:
            line = _line(channel, p, windows, [r.get(channel) for r in ratio], scales, least[channel], limits)
            if line is not None:
                out.append(line)
    return tuple(sorted(out, key=lambda line: -line.level / least[line.channel]))


def _ratios(model: Model, window: WindowFeatures, orders: np.ndarray) -> dict[str, np.ndarray]:
    """ρ at some orders of the pinion, by channel; empty where the window has no speed."""
    if not window.speed_hz:
        return {}
    made = transfers(model, "mesh", orders * window.speed_hz)
    return {channel: made[channel] / made["encoder"] for channel in ORDERS_READ}


def disc_error(order: int, scales: Scales) -> float:
    """Standard deviation of what the discs' errors make of the transmission error at an order of the pinion [m]."""
    pinion = scales.once_per_turn[0] if order == 1 else scales.graduation[0]
    return float(np.hypot(pinion, scales.graduation[1]))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Rest:
    """What one line leaves of every window that shows it, (n,) each."""

    at: np.ndarray  # positions of the windows
    rest: np.ndarray  # r, complex
    std: np.ndarray  # σ
    mesh: np.ndarray  # |ρ|·κ·|e|: what the model's ratio leaves of the teeth's part
    disc: np.ndarray  # |ρ|·σ_disc
    condition: np.ndarray  # ln of speed and torque (n, 2)

    def of(self, chosen: np.ndarray) -> _Rest:
        """The same of some windows."""
        return _Rest(
            at=self.at[chosen], rest=self.rest[chosen], std=self.std[chosen], mesh=self.mesh[chosen],
            disc=self.disc[chosen], condition=self.condition[chosen],
        )  # fmt: skip


def _rest(
    channel: str, p: int, windows: Sequence[WindowFeatures], ratio: Sequence[np.ndarray | None], scales: Scales
) -> _Rest | None:
    """What the mesh does not make of one line; None where too few windows were read."""
    rows = []
    for i, (w, ρ) in enumerate(zip(windows, ratio, strict=True)):
        lines: MeasuredLines | None = getattr(w, channel)
        error = w.transmission_error
        y = None if lines is None else lines.get(0, p, 0)
        e = None if error is None or error.unit != "m" else error.get(0, p, 0)
        if lines is None or y is None or e is None or ρ is None:
            continue
        factor, load = abs(ρ[p - 1]), max(abs(w.torque_nm or 1.0), 1e-9)
        mesh, disc = factor * ENTRY.structure * abs(e), factor * disc_error(p, scales)
        condition = (float(np.log(w.speed_hz or 1.0)), float(np.log(load)))
        rows.append((i, y - ρ[p - 1] * e, lines.std_at(0, p, 0), mesh, disc, condition))
    if len(rows) < THRESHOLDS.least_windows:
        return None
    at, rest, std, mesh, disc, conditions = zip(*rows, strict=True)
    return _Rest(
        at=np.array(at), rest=np.array(rest), std=np.array(std), mesh=np.array(mesh), disc=np.array(disc),
        condition=np.array(conditions),
    )  # fmt: skip


def _line(
    channel: str,
    p: int,
    windows: Sequence[WindowFeatures],
    ratio: Sequence[np.ndarray | None],
    scales: Scales,
    least: float,
    limits: ShaftRemainderThresholds,
) -> ShaftLine | None:
    """What one line leaves over the windows; None where that is nothing, or too few windows were read."""
    seen = _rest(channel, p, windows, ratio, scales)
    if seen is None:
        return None
    r, σ = np.abs(seen.rest), seen.std
    start = _start(r, σ, limits)
    common = np.hypot(seen.mesh, seen.disc)[start:]
    level = _level(r[start:], σ[start:], common, least, limits)
    if level is not None:
        return ShaftLine(order=p, channel=channel, level=level, since=int(seen.at[start]))
    return _changed(channel, p, seen, least, limits)


def _start(r: np.ndarray, σ: np.ndarray, limits: ShaftRemainderThresholds) -> int:
    """Position from which on a line is there, if it is there at all."""
    support = np.cumsum((0.5 * (r / σ) ** 2 - limits.window_cost)[::-1])[::-1]
    return int(np.argmax(support[: r.size - limits.least_windows + 1]))


def _level(
    r: np.ndarray, σ: np.ndarray, common: np.ndarray, least: float, limits: ShaftRemainderThresholds
) -> float | None:
    """Level of what is left in some windows; None where noise, discs or the model's ratio explain it.

    common  standard deviation of what all windows share (n,)
    """
    level = float(np.sqrt(max(np.mean(r**2) - np.mean(2 * σ**2), 0.0)))
    shown = np.count_nonzero(0.5 * (r / σ) ** 2 > limits.window_cost)
    clear = shown >= limits.least_windows and chdtrc(2 * r.size, np.sum((r / σ) ** 2)) < limits.chance
    large = level >= max(least, limits.over_mesh * float(np.sqrt(np.mean(common**2))))
    return level if clear and large else None


def _changed(channel: str, p: int, seen: _Rest, least: float, limits: ShaftRemainderThresholds) -> ShaftLine | None:
    """A line that has changed between two windows of one operating condition: errors of the discs do not change.

    What is left is compared with its mean before, in windows of the same condition.
    """
    best = None
    for start in range(1, seen.at.size - limits.least_windows + 1):
        before, after = seen.of(np.arange(start)), seen.of(np.arange(start, seen.at.size))
        same = [np.abs(before.condition - c).max(axis=1) < limits.same_condition for c in after.condition]
        used = np.array([i for i, s in enumerate(same) if s.sum() >= limits.least_before], dtype=int)
        if used.size < limits.least_windows:
            continue
        mean = np.array([before.rest[same[i]].mean() for i in used])
        std = np.array([np.sqrt(np.sum(before.std[same[i]] ** 2)) / same[i].sum() for i in used])
        now = after.of(used)
        common = np.hypot(now.mesh, np.abs(mean))
        change, σ = np.abs(now.rest - mean), np.hypot(now.std, std)
        level = _level(change, σ, common, limits.least_changed * least, limits)
        support = float(np.sum(0.5 * (change / σ) ** 2 - limits.window_cost))
        if level is not None and (best is None or support > best[0]):
            best = (support, level, int(now.at[0]))
    return None if best is None else ShaftLine(order=p, channel=channel, level=best[1], since=best[2])


def orders_of_force(lines: Sequence[ShaftLine], highest: int) -> frozenset[int]:
    """Orders of the pinion up to the highest at which one force with harmonics acts; none where there is no such force.

    The housing moves at several orders, which neither an unbalance nor a torque ripple makes. Where the force repeats
    several times a turn, as jaws of a coupling do, its harmonics go on at multiples of the strongest order.
    """
    heard = [line for line in lines if line.channel == "acceleration"]
    if len(heard) < 2:
        return frozenset()
    strongest = max(heard, key=lambda line: line.level).order
    more = range(strongest, highest + 1, strongest) if strongest > 1 else ()
    return frozenset({line.order for line in lines} | set(more))


def one_order_only(
    lines: Sequence[ShaftLine], order: int, others: Collection[int], limits: ShaftRemainderThresholds = THRESHOLDS
) -> bool:
    """Whether a force acts at one order alone, as an unbalance and a torque ripple do.

    order   of the force
    others  orders of other forces of one order each
    """
    heard = {line.order: line.level for line in lines if line.channel == "acceleration"}
    beside = {p: level for p, level in heard.items() if p != order and p not in others}
    if order in heard and beside:
        return heard[order] >= limits.dominance * max(beside.values())
    return len(beside) < 2
