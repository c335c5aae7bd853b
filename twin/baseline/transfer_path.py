"""What changed on the way from the gears to a sensor: one smooth function of frequency, the same for all shafts' lines.

    g_b = Σ conj(x_k)·Y_k/σ_k² / Σ |x_k|²/σ_k²          over the lines of band b

x  the healthy machine's lines, Y the measured ones, σ the healthy scatter

Source   twin/effects/sensor_gain.py, sensor_resonance.py
Holds    the same teeth in mesh: lines keep their phases among one another
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from twin.effects.sensor_resonance import SensorResonance

BAND = 8.0  # width over which the gain of a path is taken [orders of the pinion]
LEAST_LINES = 8  # of a band
CHANGED = 2.0  # times the healthy scatter of ln|g|
LEAST_CHANGE = 0.25  # rms of ln|g| that is worth a word
UNEXPLAINED = 0.4  # share of ln g's energy that a name may leave
BETTER = 0.6  # of what a simpler name leaves, that the next must leave at most
POINTS = 5  # of a band, at which a name's gain is taken
SHIFTED, CONSTANT, RESONANT, MOVED = 1, 2, 4, 6  # parameters: shift of the angle, gain, resonance, resonance before
SHIFT = 0.05  # of the angle, at most [rad of the pinion]
APART = 3.0  # standard deviations of ln f between where it is and where it was
LEAST_GAIN = 1e-3
KNOWN = 0.3  # standard error of a band's gain, of the gain, up to which it is known
STRONGEST = 9.0  # squared ratio to its scatter that one line counts at most
LEAST_SENSORS = 2  # of which something common is told
LEAST_COMMON = 0.1  # in ln, that is worth a word
ALIKE = 0.5  # of the middle level in ln, of two sensors of the larger, that every sensor must reach
FAR, ROUNDS = 2.0, 12  # deviations from which a line counts for half, and rounds of weighting


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Path:
    """What changed on the way to one sensor."""

    channel: str
    orders: np.ndarray  # middles of the bands (b,)
    gain: np.ndarray  # complex (b,)
    level: np.ndarray  # root of measured over expected power (b,): what the lines lose in common phase is in it
    common: float  # ln of the gain that the lines of all sensors alike have; 0 where they do not
    common_power: float  # ln of the level at which all sensors alike stand, lines that lost their phase counted whole
    change: float  # rms of what gain and level both show beyond that, in ln
    usual: float  # the same among healthy recordings

    @property
    def changed(self) -> bool:
        return self.change > max(LEAST_CHANGE, CHANGED * self.usual)

    @property
    def moved(self) -> bool:
        """Whether the expected lines are not to be taken as they are."""
        return self.changed or abs(self.common) > max(LEAST_COMMON, self.usual)

    def at(self, orders: np.ndarray) -> np.ndarray:
        """g at orders (n,), what all sensors have in common where no more has changed."""
        if not self.changed:
            return np.full(orders.shape, np.exp(self.common), dtype=complex)
        size = np.interp(orders, self.orders, np.log(np.abs(self.gain)))
        phase = np.interp(orders, self.orders, np.unwrap(np.angle(self.gain)))
        return np.exp(size + 1j * phase)

    def level_at(self, orders: np.ndarray) -> np.ndarray:
        """Gain of the levels at orders (n,)."""
        if not self.changed:
            return np.full(orders.shape, np.exp(self.common_power))
        return np.exp(np.interp(orders, self.orders, np.log(np.maximum(self.level, LEAST_GAIN))))


def band_gains(x: np.ndarray, y: np.ndarray, σ: np.ndarray, orders: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle [orders] and complex gain from x to y of every band; (K,) → (b,), (b,).

    What one shaft does otherwise than before is no path: no line counts for more than its share, and what lies far
    off the others counts for less (Cauchy's weights). Bands whose lines do not tell it are left out.
    """
    middles, gains = [], []
    for low in np.arange(0.0, orders[-1], BAND):
        inside = (orders > low) & (orders <= low + BAND)
        if inside.sum() < LEAST_LINES or not np.abs(x[inside]).any():
            continue
        a, b = x[inside], y[inside]
        spread = np.sqrt(σ[inside] ** 2 + np.abs(a) ** 2 / STRONGEST)
        w, g = 1 / spread**2, 1.0 + 0j
        for _ in range(ROUNDS):
            g = (a.conj() * b * w).sum() / (np.abs(a) ** 2 * w).sum()
            off = np.abs(b - g * a) / spread
            w = 1 / spread**2 / (1 + (off / FAR) ** 2)
        error = np.sqrt(np.sum(np.abs(b - g * a) ** 2 * w) / np.sum(np.abs(a) ** 2 * w) / a.size)
        if error < KNOWN * max(abs(g), LEAST_GAIN):
            middles.append(low + BAND / 2)
            gains.append(g)
    found = np.array(gains)
    return np.array(middles), np.where(np.abs(found) < LEAST_GAIN, LEAST_GAIN, found)


def lesser(gain: np.ndarray, level: np.ndarray) -> np.ndarray:
    """What gains and levels (b,) both show, each against 1: lines out of phase lower the gain and not the level."""
    a, b = np.log(np.abs(gain)), np.log(np.maximum(level, LEAST_GAIN))
    return np.exp(np.where(a * b > 0, np.sign(a) * np.minimum(np.abs(a), np.abs(b)), 0.0))


def common_level(gains: Sequence[np.ndarray]) -> float:
    """ln of the level at which all sensors alike stand against what is expected, from every one's gains (b,).

    Sensors change one by one; where all of them stand higher or lower by about the same, the machine does: another
    load, or one at which the baseline's interpolation misses. Of two sensors the lesser tells what is common.
    """
    if len(gains) < LEAST_SENSORS:
        return 0.0
    levels = np.array([float(np.mean(np.log(np.abs(g)))) for g in gains])
    two = len(gains) == LEAST_SENSORS
    most = float(max(levels, key=abs)) if two else float(np.median(levels))
    alike = most and np.all(levels * np.sign(most) >= ALIKE * abs(most))
    return (float(min(levels, key=abs)) if two else most) if alike else 0.0


def band_levels(power: np.ndarray, y: np.ndarray, orders: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """Root of measured over expected power in bands (b,), from expected powers and measured lines, (K,) each."""
    out = []
    for middle in middles:
        inside = np.abs(orders - middle) <= BAND / 2
        out.append(np.sqrt(np.sum(np.abs(y[inside]) ** 2) / max(float(power[inside].sum()), 1e-300)))
    return np.array(out)


@dataclass(frozen=True, slots=True, kw_only=True)
class PathName:
    """What the change of a path is called."""

    name: str  # sensor_gain, sensor_resonance or unknown_effect
    parameters: Mapping[str, tuple[float, str, float]]
    left: float  # share of ln g's energy that it does not explain
    fitted: tuple[float, ...] = ()  # |g| that the name and what is common give, of every band; none without a name


def name_of_path(path: Path, speed_hz: float) -> PathName:
    """A constant gain, a resonance of the mount, one that has moved, or none of them.

    Each is fitted to ln g, size and phase, with a shift of the angle, which is found from the same lines and open by as
    much; the simplest stands unless the next leaves BETTER times as much or less.
    """
    f, g = path.orders * speed_hz, path.gain / np.exp(path.common)
    within = f[:, None] + np.linspace(-0.5, 0.5, POINTS) * BAND * speed_hz  # a band's gain is one of all its lines

    def mount(ln_frequency: float, ln_damping: float) -> np.ndarray:
        resonance = SensorResonance(frequency=float(np.exp(ln_frequency)), damping_ratio=float(np.exp(ln_damping)))
        return resonance.response(within)

    def model(p: np.ndarray) -> np.ndarray:
        gain = np.exp(1j * p[0] * path.orders + (p[1] if p.size > 1 else 0.0))
        if p.size < RESONANT:
            return gain
        return gain * (mount(p[2], p[3]) / (mount(p[4], p[5]) if p.size == MOVED else 1.0)).mean(axis=1)

    def off(p: np.ndarray) -> np.ndarray:
        difference = np.log(model(p) / g)  # the phase within a half turn
        return np.concatenate((difference.real, difference.imag))

    places = np.log(max(150.0, 0.5 * f[0])), np.log(2.5 * f[-1])
    dampings = np.log(0.01), np.log(0.7)
    bounds = [(-SHIFT, SHIFT), (-3.0, 3.0), places, dampings, places, dampings]
    whole = 0.0
    chosen: tuple[float, np.ndarray, np.ndarray] | None = None
    for count in (SHIFTED, CONSTANT, RESONANT, MOVED):
        fits = [
            least_squares(off, start, bounds=tuple(zip(*bounds[:count], strict=True)), loss="soft_l1", f_scale=0.3)
            for start in _starts(count, f)
        ]
        fit = min(fits, key=lambda found: found.cost)
        left = float(np.sum(off(fit.x) ** 2))
        if count == SHIFTED:
            whole = left
        elif chosen is None or left < BETTER * chosen[0]:
            spread = np.linalg.pinv(fit.jac.T @ fit.jac) * 2 * fit.cost / max(2 * f.size - count, 1)
            if count == MOVED and not _apart(fit.x, spread):
                continue
            chosen = left, fit.x, np.sqrt(np.maximum(np.diag(spread), 0))
    assert chosen is not None
    left, p, std = chosen
    if left > UNEXPLAINED * whole:
        return PathName(name="unknown_effect", parameters={}, left=left / whole)
    parameters: dict[str, tuple[float, str, float]] = {}
    names = (
        ("gain", ""),
        ("frequency", "Hz"),
        ("damping_ratio", ""),
        ("frequency_before", "Hz"),
        ("damping_before", ""),
    )
    for (name, unit), value, s in zip(names, np.exp(p[1:]), std[1:], strict=False):
        parameters[name] = (float(value), unit, float(value * s))
    return PathName(
        name="sensor_gain" if p.size == CONSTANT else "sensor_resonance",
        parameters=parameters,
        left=left / whole,
        fitted=tuple((np.abs(model(p)) * np.exp(path.common)).tolist()),
    )


def _apart(p: np.ndarray, spread: np.ndarray) -> bool:
    """Whether a resonance has moved by more than its two places are uncertain; else the pair only cancels."""
    variance = spread[2, 2] + spread[4, 4] - 2 * spread[2, 4]
    return bool(abs(p[2] - p[4]) > APART * np.sqrt(max(float(variance), 0.0)))


def _starts(count: int, f: np.ndarray) -> list[list[float]]:
    """Where fits begin: resonances over the range of frequencies."""
    places = np.log(np.geomspace(max(300.0, 2 * f[0]), f[-1], 6))
    if count < RESONANT:
        return [[0.0] * count]
    if count == RESONANT:
        return [[0.0, 0.0, a, np.log(0.1)] for a in places]
    return [[0.0, 0.0, a, np.log(0.1), b, np.log(0.1)] for a in places for b in places if a != b]
