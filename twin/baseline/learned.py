"""The response of a healthy machine, learned from recordings: every line against load and speed, with its scatter.

    x_k(u) = (1 − t)·X_k(u_i) + t·X_k(u_i+1)          u between the neighbouring recordings i and i + 1
    σ_k²   = ½·(e_k² + local mean of e²),  e          what a recording misses of this between its own neighbours

u    operating point: torque where it is measured and varies, else the speed (an induction motor's slip tells its load)
X_k  complex lines of the recordings at the orders of all shafts, laid over one another by their pattern

Between recordings it is interpolated, beyond them the nearest recording stands, and is said to.

Holds    the same gears in the same mesh as in the recordings: `Expected.correlation` says whether they are
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations, pairwise

import numpy as np
from scipy.ndimage import uniform_filter1d

from twin.baseline.alignment import Alignment, align
from twin.baseline.path import band_gains
from twin.baseline.reading import Reading
from twin.errors import NotAvailable, ParameterError
from twin.rig import Rig

SMOOTH_ORDERS = 4.0  # width over which scatter is averaged
VARIES = 0.03  # of torque, relative, from which it is the operating point
SWAPPED, FITS = 0.03, 0.3  # of correlation that exchanging two channels must add, and reach, to be believed
BEYOND = 0.05  # of the range learned, from which an operating point lies outside it


Values = dict[str, np.ndarray]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Expected:
    """What a healthy machine would show at one window's operating point, in the window's own angle."""

    lines: Mapping[str, np.ndarray]  # x_k (K,) by channel
    power: Mapping[str, np.ndarray]  # |X_k|² interpolated (K,): lines that turn between two recordings keep their size
    std: Mapping[str, np.ndarray]  # of |Y_k − x_k| (K,)
    alignment: Alignment | None
    interpolated: bool  # False: beyond what was learned
    between: tuple[str, ...]  # names of the recordings that it comes from


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Baseline:
    """A healthy machine."""

    rig: Rig
    shafts: tuple[Fraction, ...]  # orders of all shafts
    readings: tuple[Reading, ...]  # sorted by operating point, laid over one another
    std: Mapping[str, np.ndarray]  # by channel (K,)
    path_scatter: Mapping[str, float]  # rms of ln|g| of the path to each sensor among the recordings (path.py)

    @property
    def period(self) -> int:
        return self.readings[0].period

    @property
    def by_torque(self) -> bool:
        """Whether the operating point is the torque; else the speed."""
        return _by_torque(self.readings)

    def operating_point(self, reading: Reading) -> float:
        """u of a window."""
        if not self.by_torque:
            return reading.speed_hz
        if reading.torque_nm is None:
            raise NotAvailable("the window has no torque, by which the baseline was learned")
        return reading.torque_nm

    def expected(self, reading: Reading) -> Expected:
        """The healthy machine at a window's operating point, laid over the window."""
        if reading.period != self.period:
            raise ParameterError(f"lines at 1/{reading.period} order against a baseline at 1/{self.period}")
        return _expected(self.rig, self.readings, self.std, reading, self.operating_point(reading), self.by_torque)

    def swapped(self, reading: Reading) -> tuple[str, str] | None:
        """Two channels whose names seem exchanged: with each as the other the pattern of the teeth fits much better."""
        u = self.operating_point(reading)
        lines, *_ = _interpolated(self.readings, u, self.by_torque)
        named = _lines(reading)
        shared = sorted(set(named) & set(lines))
        fit: dict[tuple[str, str] | None, float] = {None: _fit(named, lines, reading.period, self.rig.teeth[0])}
        for a, b in combinations(shared, 2):
            exchanged = named | {a: named[b], b: named[a]}
            fit[a, b] = _fit(exchanged, lines, reading.period, self.rig.teeth[0])
        best = max(fit, key=lambda key: fit[key])
        return best if best is not None and fit[best] > max(fit[None] + SWAPPED, FITS) else None


def _fit(lines: Values, others: Values, period: int, teeth: int) -> float:
    found = align(lines, others, period, teeth)
    return 0.0 if found is None else found.correlation


def learn(rig: Rig, readings: Sequence[Reading], shafts: Sequence[Fraction]) -> Baseline:
    """A baseline from recordings of the healthy machine, two at least.

    Raises NotAvailable where they do not share a channel.
    """
    if len(readings) < 2:
        raise ParameterError("a baseline needs at least two recordings of the healthy machine: one shows no scatter")
    torque = _by_torque(readings)
    ordered = sorted(readings, key=lambda r: _point(r, torque))
    laid = _laid_over(rig, ordered)
    std, path = _scatter(laid)
    return Baseline(rig=rig, shafts=tuple(shafts), readings=laid, std=std, path_scatter=path)


def _by_torque(readings: Sequence[Reading]) -> bool:
    torques = [r.torque_nm for r in readings]
    if any(t is None for t in torques):
        return False
    known = np.array(torques, dtype=float)
    return bool(np.ptp(known) > VARIES * abs(known.mean()))


def _point(reading: Reading, torque: bool) -> float:
    return float(reading.torque_nm) if torque and reading.torque_nm is not None else reading.speed_hz


def _lines(reading: Reading) -> dict[str, np.ndarray]:
    return {name: c.lines for name, c in reading.channels.items()}


def _laid_over(rig: Rig, ordered: Sequence[Reading]) -> tuple[Reading, ...]:
    """All readings in the angle of the middle one, each by its neighbour that is there already."""
    if all(r.absolute for r in ordered):
        return tuple(ordered)
    middle = len(ordered) // 2
    out = {middle: ordered[middle]}
    for i, j in [(i, i - 1) for i in range(middle + 1, len(ordered))] + [(i, i + 1) for i in range(middle)[::-1]]:
        found = align(_lines(out[j]), _lines(ordered[i]), ordered[i].period, rig.teeth[0])
        if found is None:
            raise NotAvailable(f"{ordered[i].name} and {ordered[j].name} have no accelerometer in common")
        out[i] = _turned(ordered[i], found)
    return tuple(out[i] for i in range(len(ordered)))


def _turned(reading: Reading, alignment: Alignment) -> Reading:
    channels = {
        name: replace(c, lines=alignment.turned(c.lines, reading.period)) for name, c in reading.channels.items()
    }
    return replace(reading, channels=channels)


def _interpolated(readings: Sequence[Reading], u: float, torque: bool) -> tuple[Values, Values, bool, tuple[str, ...]]:
    """Lines and their powers at an operating point, whether it lies among the readings, and the names of its source."""
    points = [_point(r, torque) for r in readings]
    reach = BEYOND * (points[-1] - points[0])
    if u <= points[0] or u >= points[-1]:
        near = readings[0] if u <= points[0] else readings[-1]
        inside = points[0] - reach <= u <= points[-1] + reach
        lines = _lines(near)
        return lines, {name: np.abs(x) ** 2 for name, x in lines.items()}, inside, (near.name,)
    for low, high in pairwise(range(len(points))):
        if points[low] <= u <= points[high]:
            break
    width = points[high] - points[low]
    t = 0.5 if width == 0 else (u - points[low]) / width
    a, b = _lines(readings[low]), _lines(readings[high])
    out, power = {}, {}
    for name in sorted(a.keys() & b.keys()):
        m = min(a[name].size, b[name].size)
        out[name] = (1 - t) * a[name][:m] + t * b[name][:m]
        power[name] = (1 - t) * np.abs(a[name][:m]) ** 2 + t * np.abs(b[name][:m]) ** 2
    return out, power, True, (readings[low].name, readings[high].name)


def _expected(
    rig: Rig, readings: Sequence[Reading], std: Mapping[str, np.ndarray], reading: Reading, u: float, torque: bool
) -> Expected:
    lines, power, inside, between = _interpolated(readings, u, torque)
    found = None
    if not (reading.absolute and all(r.absolute for r in readings)):
        found = align(_lines(reading), lines, reading.period, rig.teeth[0])
        if found is None:
            raise NotAvailable(f"{reading.name} has no accelerometer of the baseline: {', '.join(sorted(lines))}")
        lines = {name: found.turned(x, reading.period) for name, x in lines.items()}
    shared = [name for name in reading.channels if name in lines and name in std]
    sizes = {n: min(reading.channels[n].lines.size, lines[n].size, std[n].size) for n in shared}
    return Expected(
        lines={name: lines[name][:m] for name, m in sizes.items()},
        power={name: power[name][:m] for name, m in sizes.items()},
        std={name: std[name][:m] for name, m in sizes.items()},
        alignment=found,
        interpolated=inside,
        between=between,
    )


def _scatter(readings: Sequence[Reading]) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """What readings miss of the baseline of the others: of each line (K,), and of the path's ln|g|; by channel."""
    missed: dict[str, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}
    torque = _by_torque(readings)
    inner = range(1, len(readings) - 1) if len(readings) > 2 else range(len(readings))
    for i in inner:
        others = [r for j, r in enumerate(readings) if j != i]
        lines, _, _, _ = _interpolated(others, _point(readings[i], torque), torque)
        for name, channel in readings[i].channels.items():
            if name in lines:
                m = min(lines[name].size, channel.lines.size)
                x, y = lines[name][:m], channel.lines[:m]
                missed.setdefault(name, []).append((x, y, np.abs(y - x) ** 2 + channel.floor[:m]))
    Q = readings[0].period
    std, path = {}, {}
    for name, found in missed.items():
        m = min(error.size for _, _, error in found)
        own = np.mean([error[:m] for _, _, error in found], axis=0)
        local = uniform_filter1d(own, size=max(3, int(SMOOTH_ORDERS * Q)), mode="nearest")
        std[name] = np.sqrt(0.5 * (own + local))
        orders = np.arange(1, m + 1) / Q
        gains = [band_gains(x[:m], y[:m], std[name], orders)[1] for x, y, _ in found]
        known = np.concatenate(gains)
        path[name] = float(np.sqrt(np.mean(np.log(np.abs(known)) ** 2))) if known.size else 0.0
    return std, path
