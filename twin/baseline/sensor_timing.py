"""Polarity and delay of single sensors, by the pattern of the teeth in each channel.

    c_i(φ) = Re Σ_k conj(x_k)·Y_k·e^{−i·o_k·φ} / (|x|·|Y|)          of channel i; mesh lines take no part
    φ₀     = arg max Σ_j≠i |c_j(φ)|                                 the machine's angle, by the other channels

A channel whose |c_i| is largest at φ₀ + Δ has a delay of −Δ/(2π·speed), one whose c_i is negative there has its
polarity reversed: its lines are as they were, and no gear can do that to one sensor alone.

Holds    changes that leave the pattern as clear as it is among healthy recordings
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from twin.baseline.alignment import OVERSAMPLED
from twin.baseline.learned import Baseline, interpolated_lines
from twin.baseline.reading import WindowReading
from twin.thresholds import deciding

REACH = 0.25  # of a pinion turn, to either side, in which a delay is searched


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingThresholds:
    """When a sensor's polarity or delay has changed."""

    as_clear: float = deciding(
        0.9, of="lowest correlation of a healthy recording with the others",
        meaning="correlation that the corrected channel must reach: a changed resonance leaves less",
        source="not derived: healthy recordings differ by 0.1 with load",
    )  # fmt: skip
    least_gain: float = deciding(
        0.05, meaning="correlation that the correction must add",
        source="between observed values on the broken-tooth set: 0.01 in healthy recordings",
    )  # fmt: skip
    least_others: int = deciding(
        2, meaning="other sensors against which a sensor can be late",
        source="derivation: of two, either could be late",
    )  # fmt: skip
    least_clear: float = deciding(
        0.3, meaning="correlation that healthy recordings must reach for timing to be judged",
        source="the limit for the same teeth (BaselineThresholds.same_teeth)",
    )  # fmt: skip


DEFAULT = TimingThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingChange:
    """One channel's change of polarity or delay."""

    channel: str
    reversed: bool
    turn: float  # Δ [rad of the pinion]
    delay: float  # [s]
    delay_std: float  # what noise of the size that the correlation leaves makes of it [s]
    before: float  # correlation as it is
    after: float  # corrected


def timing_changes(
    baseline: Baseline, reading: WindowReading, limits: TimingThresholds = DEFAULT
) -> tuple[TimingChange, ...]:
    """Channels that are reversed or delayed against the others."""
    curves = _curves(baseline, baseline.readings, reading)
    if not curves:
        return ()
    count = min(c.size for c in curves.values())
    sizes = {name: np.abs(curve) for name, curve in curves.items()}
    reach = round(REACH / baseline.period * count)
    out = []
    usual = _usual(baseline)
    for channel, curve in curves.items():
        rest = [name for name in sizes if name != channel]
        others = [sizes[name] for name in rest]
        # the angle by the other sensors: of two, either could be the one that is late
        zero = int(np.argmax(np.sum(others if len(others) >= limits.least_others else list(sizes.values()), axis=0)))
        near = np.arange(zero - reach, zero + reach + 1) % count
        best = int(np.argmax(np.abs(curve[near])))
        before, after = float(curve[zero]), float(abs(curve[near[best]]))
        if usual[channel] < limits.least_clear or after < limits.as_clear * usual[channel]:
            continue
        if after - before < limits.least_gain:
            continue
        if rest and np.mean([sizes[n][zero] for n in rest]) < limits.as_clear * np.mean([usual[n] for n in rest]):
            continue  # the others have changed themselves: they do not tell the angle
        turn = 2 * np.pi * baseline.period * (best - reach) / count
        if len(others) < limits.least_others and curve[near[best]] > 0:
            continue
        out.append(
            TimingChange(
                channel=channel,
                reversed=bool(curve[near[best]] < 0),
                turn=float(turn),
                delay=float(-turn / (2 * np.pi * reading.speed_hz)),
                delay_std=_turn_std(baseline, reading, channel, after) / (2 * np.pi * reading.speed_hz),
                before=before,
                after=after,
            )
        )
    return tuple(out)


def _turn_std(baseline: Baseline, reading: WindowReading, channel: str, correlation: float) -> float:
    """Standard deviation of the angle at the best correlation (Cramér and Rao) [rad]."""
    x = interpolated_lines(baseline.readings, reading, baseline.axes)[channel]
    m = min(x.size, reading.channels[channel].lines.size)
    orders = np.arange(1, m + 1) / reading.period
    square = float(np.sum(np.abs(orders * x[:m]) ** 2) / np.sum(np.abs(x[:m]) ** 2))
    noise = max(1 - correlation**2, 0.0) / correlation**2
    return float(np.sqrt(noise / (2 * m * square)))


def corrected(reading: WindowReading, changes: tuple[TimingChange, ...]) -> WindowReading:
    """The reading as it would be without these changes."""
    channels = dict(reading.channels)
    for change in changes:
        if change.channel in channels:
            c = channels[change.channel]
            orders = np.arange(1, c.lines.size + 1) / reading.period
            turned = c.lines * np.exp(-1j * orders * change.turn) * (-1 if change.reversed else 1)
            channels[change.channel] = replace(c, lines=turned)
    return replace(reading, channels=channels)


def _curves(baseline: Baseline, among: Sequence[WindowReading], reading: WindowReading) -> Mapping[str, np.ndarray]:
    """c_i over one period of the angle, for every channel of a reading beside other readings."""
    lines = interpolated_lines(among, reading, baseline.axes)
    shared = [name for name in reading.channels if name in lines]
    if not shared:
        return {}
    count = max(min(lines[name].size, reading.channels[name].lines.size) for name in shared)
    n, teeth = fft.next_fast_len(OVERSAMPLED * count), baseline.rig.teeth[0]
    out = {}
    for name in shared:
        m = min(lines[name].size, reading.channels[name].lines.size)
        kept = np.arange(1, m + 1) % (baseline.period * teeth) > 0
        x, y = lines[name][:m] * kept, reading.channels[name].lines[:m] * kept
        scale = np.linalg.norm(x) * np.linalg.norm(y)
        product = np.zeros(n, dtype=complex)
        if scale > 0:
            product[1 : m + 1] = x.conj() * y / scale
        out[name] = fft.fft(product).real
    return out


def _usual(baseline: Baseline) -> dict[str, float]:
    """Lowest correlation of any healthy recording with the others, by channel."""
    out: dict[str, float] = {}
    for i, one in enumerate(baseline.readings):
        others = [r for j, r in enumerate(baseline.readings) if j != i]
        curves = _curves(baseline, others, one)
        zero = int(np.argmax(np.sum(list(curves.values()), axis=0))) if curves else 0
        for name, curve in curves.items():
            out[name] = min(out.get(name, 1.0), float(curve[zero]))
    return out
