"""Changes of the transfer path to a sensor: one smooth function of frequency, the same for the lines of all shafts.

    g_b = Σ conj(x_k)·Y_k/σ_k² / Σ |x_k|²/σ_k²          over the lines of band b

x  the healthy machine's lines, Y the measured ones, σ the healthy scatter

A path has changed where the mean square of ln|g_b| over its bands exceeds that of healthy recordings by Fisher's F of
so many bands and recordings, at the path's share of the false alarms of a comparison (repeats.py).

Source   twin/effects/sensor_gain.py, sensor_resonance.py
Holds    the same teeth in mesh: lines keep their phases among one another
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import least_squares
from scipy.special import fdtri

from twin.baseline.repeats import share_of
from twin.effects.sensor_resonance import SensorResonance
from twin.thresholds import deciding

BAND = 8.0  # width over which the gain of a path is taken [orders of the pinion]
POINTS = 5  # of a band, at which a named change's gain is taken
SHIFTED, CONSTANT, RESONANT, MOVED = 1, 2, 4, 6  # parameters: shift of the angle, gain, resonance, resonance before
ROUNDS = 12  # of reweighting
LEAST_GAIN = 1e-3  # gains below it are set to it before logarithms are taken


@dataclass(frozen=True, slots=True, kw_only=True)
class PathThresholds:
    """When the transfer path to a sensor has changed, and what the change is called."""

    least_lines: int = deciding(
        8, meaning="lines that a band must have for its gain to be estimated",
        source="not derived: robust weights need a majority of undisturbed lines",
    )  # fmt: skip
    known: float = deciding(
        0.3, of="band gain", meaning="standard error up to which a band's gain is used", source="not derived",
    )  # fmt: skip
    strongest_line: float = deciding(
        9.0, unit="variances", meaning="squared ratio to its scatter that one line counts at most",
        source="convention: three standard deviations, so that no single shaft line sets a band's gain",
    )  # fmt: skip
    far: float = deciding(
        2.0, unit="standard deviations", meaning="distance at which a line has half its weight (Cauchy)",
        source="robust statistics: 2.385 gives 95 % efficiency (Holland and Welsch 1977), rounded down",
    )  # fmt: skip
    least_change: float = deciding(
        0.25, unit="ln of gain", meaning="rms change of a path that is reported",
        source="tuned on the seven loads of the broken-tooth set: 2 dB",
    )  # fmt: skip
    least_common: float = deciding(
        0.1, unit="ln of gain", meaning="common change of all sensors that is reported",
        source="not derived: 10 % of level, the repeatability of a load setting",
    )  # fmt: skip
    least_sensors: int = deciding(
        2, meaning="sensors from which something common can be separated", source="derivation: one sensor has no other",
    )  # fmt: skip
    alike: float = deciding(
        0.5, of="median level in ln", meaning="level that every sensor must reach for the change to be common",
        source="not derived",
    )  # fmt: skip
    unexplained: float = deciding(
        0.4, of="energy of ln g", meaning="share that a named change may leave unexplained", source="not derived",
    )  # fmt: skip
    better: float = deciding(
        0.6, meaning="ratio of the remainders from which the change with more parameters is preferred",
        source="not derived: two more parameters of twenty bands explain a tenth of noise",
    )  # fmt: skip
    largest_shift: float = deciding(
        0.05, unit="rad of the pinion", meaning="shift of the angle that is fitted with every named change",
        source="derivation: several times the standard error of the alignment by the tooth pattern",
    )  # fmt: skip
    apart: float = deciding(
        3.0, unit="standard deviations of ln f", meaning="distance of a resonance from where it was",
        source="convention: three standard deviations; nearer, the pair of resonances only cancels",
    )  # fmt: skip


DEFAULT = PathThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Path:
    """The change of the transfer path to one sensor."""

    channel: str
    orders: np.ndarray  # middles of the bands (b,)
    gain: np.ndarray  # complex (b,)
    level: np.ndarray  # root of measured over expected power (b,); it includes lines that lost their common phase
    common: float  # ln of the gain that the lines of all sensors share; 0 where they share none
    common_power: float  # ln of the level that all sensors share, including lines that lost their phase
    change: float  # rms of the change beyond that which gain and level both show, in ln
    usual: float  # the same among healthy recordings
    over_usual: float  # ratio of the two from which a change is one (`over_usual`)
    raised: float = 1.0  # factor of the limit, by what leaving healthy recordings out has shown
    limits: PathThresholds = DEFAULT

    @property
    def changed(self) -> bool:
        return self.over > self.raised

    @property
    def over(self) -> float:
        """The change over the limit from which it is one."""
        return self.change / max(self.limits.least_change, self.over_usual * self.usual)

    @property
    def moved(self) -> bool:
        """Whether the expected lines must be corrected before they are compared."""
        return self.changed or abs(self.common) > max(self.limits.least_common, self.usual)

    def at(self, orders: np.ndarray) -> np.ndarray:
        """g at orders (n,); the gain that all sensors share where nothing else has changed."""
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


@lru_cache(maxsize=64)
def over_usual(bands: int, recordings: int, paths: int) -> float:
    """By how much one of so many paths may change, over what healthy recordings do: √F of bands and recordings."""
    return float(np.sqrt(1 / fdtri(bands * max(recordings - 1, 1), bands, share_of(paths))))


def band_gains(
    x: np.ndarray, y: np.ndarray, σ: np.ndarray, orders: np.ndarray, limits: PathThresholds = DEFAULT
) -> tuple[np.ndarray, np.ndarray]:
    """Middle [orders] and complex gain from x to y of every band; (K,) → (b,), (b,).

    A change of one shaft's lines is no change of the path: no line counts for more than its share, and outliers have
    less weight (Cauchy's weights). Bands whose gain is not determined are left out.
    """
    middles, gains = [], []
    for low in np.arange(0.0, orders[-1], BAND):
        inside = (orders > low) & (orders <= low + BAND)
        if inside.sum() < limits.least_lines or not np.abs(x[inside]).any():
            continue
        a, b = x[inside], y[inside]
        spread = np.sqrt(σ[inside] ** 2 + np.abs(a) ** 2 / limits.strongest_line)
        w, g = 1 / spread**2, 1.0 + 0j
        for _ in range(ROUNDS):
            g = (a.conj() * b * w).sum() / (np.abs(a) ** 2 * w).sum()
            off = np.abs(b - g * a) / spread
            w = 1 / spread**2 / (1 + (off / limits.far) ** 2)
        error = np.sqrt(np.sum(np.abs(b - g * a) ** 2 * w) / np.sum(np.abs(a) ** 2 * w) / a.size)
        if error < limits.known * max(abs(g), LEAST_GAIN):
            middles.append(low + BAND / 2)
            gains.append(g)
    found = np.array(gains)
    return np.array(middles), np.where(np.abs(found) < LEAST_GAIN, LEAST_GAIN, found)


def lesser(gain: np.ndarray, level: np.ndarray) -> np.ndarray:
    """What gains and levels (b,) both show, each against 1: lines out of phase lower the gain and not the level."""
    a, b = np.log(np.abs(gain)), np.log(np.maximum(level, LEAST_GAIN))
    return np.exp(np.where(a * b > 0, np.sign(a) * np.minimum(np.abs(a), np.abs(b)), 0.0))


def common_level(gains: Sequence[np.ndarray], limits: PathThresholds = DEFAULT) -> float:
    """ln of the level, over the expected one, that all sensors share, from the gains (b,) of each.

    Sensors change one by one; where all of them are higher or lower by about the same, the machine has changed:
    another load, or one at which the baseline's interpolation fails. Of two sensors, the smaller change is common.
    """
    if len(gains) < limits.least_sensors:
        return 0.0
    levels = np.array([float(np.mean(np.log(np.abs(g)))) for g in gains])
    two = len(gains) == limits.least_sensors
    most = float(max(levels, key=abs)) if two else float(np.median(levels))
    alike = most and np.all(levels * np.sign(most) >= limits.alike * abs(most))
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
    """The name of a change of a path."""

    name: str  # sensor_gain, sensor_resonance or unknown_effect
    parameters: Mapping[str, tuple[float, str, float]]
    left: float  # share of ln g's energy that it does not explain
    fitted: tuple[float, ...] = ()  # |g| that the name and what is common give, of every band; none without a name


def name_of_path(path: Path, speed_hz: float, limits: PathThresholds = DEFAULT) -> PathName:
    """A constant gain, a resonance of the mount, one that has moved, or none of them.

    Each is fitted to ln g, size and phase, together with a shift of the angle, which is estimated from the same lines;
    the simplest is chosen unless the next leaves clearly less.
    """
    model = _PathModel(path, speed_hz)
    shifted, whole, _ = model.fitted(SHIFTED, limits)
    left, p, std = whole, shifted, np.zeros(SHIFTED)
    chosen = False
    for count in (CONSTANT, RESONANT, MOVED):
        found, remainder, spread = model.fitted(count, limits)
        if chosen and remainder >= limits.better * left:
            continue
        if count == MOVED and not _apart(found, spread, limits):
            continue
        left, p, std, chosen = remainder, found, np.sqrt(np.maximum(np.diag(spread), 0)), True
    if left > limits.unexplained * whole:
        return PathName(name="unknown_effect", parameters={}, left=left / whole)
    names = (
        ("gain", ""),
        ("frequency", "Hz"),
        ("damping_ratio", ""),
        ("frequency_before", "Hz"),
        ("damping_before", ""),
    )
    parameters = {
        name: (float(value), unit, float(value * s))
        for (name, unit), value, s in zip(names, np.exp(p[1:]), std[1:], strict=False)
    }
    return PathName(
        name="sensor_gain" if p.size == CONSTANT else "sensor_resonance",
        parameters=parameters,
        left=left / whole,
        fitted=tuple((np.abs(model.gain(p)) * np.exp(path.common)).tolist()),
    )


class _PathModel:
    """Gains that a shift of the angle, a constant gain and resonances of the mount give to a path's bands."""

    def __init__(self, path: Path, speed_hz: float) -> None:
        self._orders = path.orders
        self._f = path.orders * speed_hz
        self._g = path.gain / np.exp(path.common)
        # the gain of a band is one of all its lines
        self._within = self._f[:, None] + np.linspace(-0.5, 0.5, POINTS) * BAND * speed_hz

    def gain(self, p: np.ndarray) -> np.ndarray:
        """Complex gain of every band (b,) for the first so many parameters (1, 2, 4 or 6)."""
        gain = np.exp(1j * p[0] * self._orders + (p[1] if p.size > 1 else 0.0))
        if p.size < RESONANT:
            return gain
        return gain * (self._mount(p[2], p[3]) / (self._mount(p[4], p[5]) if p.size == MOVED else 1.0)).mean(axis=1)

    def fitted(self, count: int, limits: PathThresholds) -> tuple[np.ndarray, float, np.ndarray]:
        """The best parameters (count,), the squares they leave, and their covariance."""
        f = self._f
        places = np.log(max(150.0, 0.5 * f[0])), np.log(2.5 * f[-1])
        dampings = np.log(0.01), np.log(0.7)
        shift = limits.largest_shift
        bounds = [(-shift, shift), (-3.0, 3.0), places, dampings, places, dampings]
        fits = [
            least_squares(
                self._off, start, bounds=tuple(zip(*bounds[:count], strict=True)), loss="soft_l1", f_scale=0.3
            )
            for start in _starts(count, f)
        ]
        fit = min(fits, key=lambda found: found.cost)
        spread = np.linalg.pinv(fit.jac.T @ fit.jac) * 2 * fit.cost / max(2 * f.size - count, 1)
        return fit.x, float(np.sum(self._off(fit.x) ** 2)), spread

    def _mount(self, ln_frequency: float, ln_damping: float) -> np.ndarray:
        resonance = SensorResonance(frequency=float(np.exp(ln_frequency)), damping_ratio=float(np.exp(ln_damping)))
        return resonance.response(self._within)

    def _off(self, p: np.ndarray) -> np.ndarray:
        difference = np.log(self.gain(p) / self._g)  # the phase within a half turn
        return np.concatenate((difference.real, difference.imag))


def _apart(p: np.ndarray, spread: np.ndarray, limits: PathThresholds) -> bool:
    """Whether a resonance has moved by more than its two places are uncertain; else the pair only cancels."""
    variance = spread[2, 2] + spread[4, 4] - 2 * spread[2, 4]
    return bool(abs(p[2] - p[4]) > limits.apart * np.sqrt(max(float(variance), 0.0)))


def _starts(count: int, f: np.ndarray) -> list[list[float]]:
    """Where fits begin: resonances over the range of frequencies."""
    places = np.log(np.geomspace(max(300.0, 2 * f[0]), f[-1], 6))
    if count < RESONANT:
        return [[0.0] * count]
    if count == RESONANT:
        return [[0.0, 0.0, a, np.log(0.1)] for a in places]
    return [[0.0, 0.0, a, np.log(0.1), b, np.log(0.1)] for a in places for b in places if a != b]
