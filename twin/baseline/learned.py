"""The response of a healthy machine, learned from recordings: every line against load and speed, with its scatter.

    x_k(u) = Σ_i w_i(u)·X_k(u_i)                      w the weights of the recordings around u (operating.py)
    σ_k²   = ½·(E_k + local mean of E)·max(1, V/V̄)    E = e² + floor, e what a recording misses of this between its
                                                      own neighbours: a line so near by chance still has its noise

u    operating point: torque, speed or both
V    how much a point may miss for its distance to the recordings, V̄ its mean for those left out (operating.py)
X_k  complex lines of the recordings at the orders of all shafts, laid over one another by their pattern

Between recordings the lines are interpolated; beyond them the nearest recording is used (`interpolated` is False).

Holds    the same gears in the same mesh as in the recordings: `ExpectedLines.alignment.correlation` shows whether
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.ndimage import uniform_filter1d

from twin.baseline.alignment import Alignment, align
from twin.baseline.operating import axes_of, distance_beyond, miss_of, order_of, point_of, weights_of
from twin.baseline.reading import WindowReading
from twin.baseline.recordings import Counted, counted, others_of, without_copies
from twin.baseline.repeats import NOTHING_LEFT_OUT, Repeats
from twin.baseline.transfer_path import band_gains, band_levels, lesser
from twin.baseline.usable import NotLearned, only_usable
from twin.errors import NotAvailable, ParameterError
from twin.rig import Rig
from twin.thresholds import deciding

SMOOTH_ORDERS = 4.0  # width over which scatter is averaged
LEAST_MISS = 1e-6  # V̄ of recordings that all lie at one point


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningThresholds:
    """When two channels of a recording seem to have exchanged their names."""

    exchange_gain: float = deciding(
        0.03, meaning="correlation with the tooth pattern that exchanging two channels must add",
        source="tuned on the seven loads of the broken-tooth set",
    )  # fmt: skip
    exchange_fit: float = deciding(
        0.3, meaning="correlation with the tooth pattern that exchanged channels must reach",
        source="the limit for the same teeth (BaselineThresholds.same_teeth)",
    )  # fmt: skip


DEFAULT = LearningThresholds()

Values = dict[str, np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchanged:
    """Two channels with each of which as the other the pattern of the teeth fits better."""

    channels: tuple[str, str]
    over: float  # how much better, over the correlation that exchanging must add


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ExpectedLines:
    """What a healthy machine would show at one window's operating point, in the window's own angle."""

    lines: Mapping[str, np.ndarray]  # x_k (K,) by channel
    power: Mapping[str, np.ndarray]  # |X_k|² interpolated (K,): lines that turn between two recordings keep their size
    std: Mapping[str, np.ndarray]  # of |Y_k − x_k| (K,)
    wider: float  # by how much more than recordings left out this point may miss, for its distance; 1 at least
    left_out: int  # recordings that the scatter was taken from
    alignment: Alignment | None
    interpolated: bool  # False: beyond what was learned
    beyond: float  # distance to the nearest point learned, of their range; 0 where interpolated
    between: tuple[str, ...]  # names of the recordings that it comes from


@dataclass(frozen=True, eq=False, kw_only=True)
class Baseline:
    """A healthy machine."""

    rig: Rig
    shafts: tuple[Fraction, ...]  # orders of all shafts
    readings: tuple[WindowReading, ...]  # laid over one another, in the order of their operating points
    std: Mapping[str, np.ndarray]  # by channel (K,)
    path_scatter: Mapping[str, float]  # rms of what gain and level of each path both show among the recordings, in ln
    repeats: Repeats = NOTHING_LEFT_OUT  # what the recordings repeat of one another
    not_learned: tuple[NotLearned, ...] = ()  # channels that could not be used in some windows
    copies: tuple[str, ...] = ()  # what was given more than once, in words

    @property
    def period(self) -> int:
        return self.readings[0].period

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """The quantities that distinguish operating points: `torque_nm`, `speed_hz` or both."""
        return axes_of(self.readings)

    def operating_point(self, reading: WindowReading) -> np.ndarray:
        """u of a window on the axes (d,)."""
        return point_of(reading, self.axes)

    @cached_property
    def counted(self) -> Counted:
        """How many recordings, days and loads the windows are of."""
        return counted(self.readings)

    @cached_property
    def left_out(self) -> tuple[tuple[WindowReading, ExpectedLines], ...]:
        """Every window beside what the other recordings let expect of it; of three and more."""
        if len(self.readings) < 3:
            return ()
        return tuple(
            (one, _expected(self.rig, [self.readings[j] for j in others], self.std, one, self.axes))
            for one, others in zip(self.readings, others_of(self.readings), strict=True)
        )

    @property
    def range(self) -> dict[str, tuple[float, float]]:
        """Least and largest of the operating points learned, by axis."""
        points = np.array([self.operating_point(r) for r in self.readings])
        return {axis: (float(p.min()), float(p.max())) for axis, p in zip(self.axes, points.T, strict=True)}

    def expected(self, reading: WindowReading) -> ExpectedLines:
        """The healthy machine at a window's operating point, laid over the window."""
        if reading.period != self.period:
            raise ParameterError(f"lines at 1/{reading.period} order against a baseline at 1/{self.period}")
        return _expected(self.rig, self.readings, self.std, reading, self.axes)

    def swapped(self, reading: WindowReading, limits: LearningThresholds = DEFAULT) -> Exchanged | None:
        """Two channels whose names seem exchanged: with each as the other the pattern of the teeth fits better."""
        lines, *_ = _interpolated(self.readings, reading, self.axes)
        named = _lines(reading)
        shared = sorted(set(named) & set(lines))
        fit: dict[tuple[str, str] | None, float] = {None: _fit(named, lines, reading.period, self.rig.teeth[0])}
        for a, b in combinations(shared, 2):
            exchanged = named | {a: named[b], b: named[a]}
            fit[a, b] = _fit(exchanged, lines, reading.period, self.rig.teeth[0])
        best = max(fit, key=lambda key: fit[key])
        if best is None or fit[best] <= max(fit[None] + limits.exchange_gain, limits.exchange_fit):
            return None
        return Exchanged(channels=best, over=(fit[best] - fit[None]) / limits.exchange_gain)


def without_channels(baseline: Baseline, names: Iterable[str]) -> Baseline | None:
    """The baseline without some of its channels; None where none is left."""
    gone = set(names)
    if gone >= set(baseline.std):
        return None
    readings = tuple(
        replace(r, channels={name: c for name, c in r.channels.items() if name not in gone}) for r in baseline.readings
    )
    std = {name: value for name, value in baseline.std.items() if name not in gone}
    path = {name: value for name, value in baseline.path_scatter.items() if name not in gone}
    return replace(baseline, readings=readings, std=std, path_scatter=path)


def _fit(lines: Values, others: Values, period: int, teeth: int) -> float:
    found = align(lines, others, period, teeth)
    return 0.0 if found is None else found.correlation


def laid_over(rig: Rig, readings: Sequence[WindowReading], shafts: Sequence[Fraction]) -> Baseline:
    """A baseline from windows of the healthy machine, two at least, without what they repeat of one another.

    Copies count once, and channels at a rail, dead or interrupted are not learned from.
    Raises NotAvailable where the windows do not share a channel.
    """
    single, copies = without_copies(readings)
    usable, not_learned = only_usable(single)
    if len(usable) < 2:
        raise ParameterError(
            "; ".join(
                (
                    "a baseline needs at least two recordings of the healthy machine: one shows no scatter",
                    *copies,
                    *(one.text for one in not_learned),
                )
            )
        )
    axes = axes_of(usable)
    ordered = sorted(usable, key=lambda r: tuple(point_of(r, axes)))
    laid = _laid_over(rig, ordered, axes)
    std, path = scatter_of(laid, axes)
    return Baseline(
        rig=rig, shafts=tuple(shafts), readings=laid, std=std, path_scatter=path, not_learned=not_learned,
        copies=tuple(copies),
    )  # fmt: skip


def _lines(reading: WindowReading) -> dict[str, np.ndarray]:
    return {name: c.lines for name, c in reading.channels.items()}


def _laid_over(rig: Rig, readings: Sequence[WindowReading], axes: Sequence[str]) -> tuple[WindowReading, ...]:
    """All readings in the angle of the middle one, each by its nearest neighbour that is there already."""
    if all(r.absolute for r in readings):
        return tuple(readings)
    out: dict[int, WindowReading] = {}
    for i, j in order_of(np.array([point_of(r, axes) for r in readings])):
        if j is None:
            out[i] = readings[i]
            continue
        found = align(_lines(out[j]), _lines(readings[i]), readings[i].period, rig.teeth[0])
        if found is None:
            raise NotAvailable(f"{readings[i].name} and {readings[j].name} have no accelerometer in common")
        out[i] = _turned(readings[i], found)
    return tuple(out[i] for i in range(len(readings)))


def _turned(reading: WindowReading, alignment: Alignment) -> WindowReading:
    channels = {
        name: replace(c, lines=alignment.turned(c.lines, reading.period)) for name, c in reading.channels.items()
    }
    return replace(reading, channels=channels)


def _interpolated(
    readings: Sequence[WindowReading], reading: WindowReading, axes: Sequence[str]
) -> tuple[Values, Values, bool, tuple[str, ...]]:
    """Lines and their powers at a reading's point, whether it lies among the others, and the names of its source."""
    points = np.array([point_of(r, axes) for r in readings])
    weights, inside = weights_of(points, point_of(reading, axes))
    sources = [(w, _lines(readings[i])) for i, w in sorted(weights.items())]
    shared = set.intersection(*(set(lines) for _, lines in sources))
    out, power = {}, {}
    for name in sorted(shared):
        m = min(lines[name].size for _, lines in sources)
        out[name] = np.sum([w * lines[name][:m] for w, lines in sources], axis=0)
        power[name] = np.sum([w * np.abs(lines[name][:m]) ** 2 for w, lines in sources], axis=0)
    return out, power, inside, tuple(readings[i].name for i in sorted(weights))


def _expected(
    rig: Rig,
    readings: Sequence[WindowReading],
    std: Mapping[str, np.ndarray],
    reading: WindowReading,
    axes: Sequence[str],
) -> ExpectedLines:
    lines, power, inside, between = _interpolated(readings, reading, axes)
    found = None
    if not (reading.absolute and all(r.absolute for r in readings)):
        found = align(_lines(reading), lines, reading.period, rig.teeth[0])
        if found is None:
            raise NotAvailable(f"{reading.name} has no accelerometer of the baseline: {', '.join(sorted(lines))}")
        lines = {name: found.turned(x, reading.period) for name, x in lines.items()}
    shared = [name for name in reading.channels if name in lines and name in std]
    wider, left_out = _wider(readings, reading, axes)
    sizes = {n: min(reading.channels[n].lines.size, lines[n].size, std[n].size) for n in shared}
    return ExpectedLines(
        lines={name: lines[name][:m] for name, m in sizes.items()},
        power={name: power[name][:m] for name, m in sizes.items()},
        std={
            name: np.sqrt((wider * std[name][:m]) ** 2 + _louder(readings, reading, name, m))
            for name, m in sizes.items()
        },
        wider=wider,
        left_out=left_out,
        alignment=found,
        interpolated=inside,
        beyond=distance_beyond(np.array([point_of(r, axes) for r in readings]), point_of(reading, axes)),
        between=between,
    )


def _wider(readings: Sequence[WindowReading], reading: WindowReading, axes: Sequence[str]) -> tuple[float, int]:
    """Root of V over V̄ of those left out from which the scatter was taken, 1 at least; and how many they are."""
    points = np.array([point_of(r, axes) for r in readings])
    left_out, between = [], []
    for i, others in enumerate(others_of(readings)):
        weights, _ = weights_of(points[others], points[i])
        left_out.append(miss_of(points, points[i], {others[j]: w for j, w in weights.items()}))
        between.append(len(weights) > 1)
    used = [v for v, inner in zip(left_out, between, strict=True) if inner or not any(between)]
    usual, at = float(np.mean(used)), point_of(reading, axes)
    if usual < LEAST_MISS:
        return 1.0, len(used)
    return float(np.sqrt(max(miss_of(points, at, weights_of(points, at)[0]) / usual, 1.0))), len(used)


def interpolated_lines(readings: Sequence[WindowReading], reading: WindowReading, axes: Sequence[str]) -> Values:
    """Healthy lines of every shared channel at a reading's operating point, in the readings' own angle (K,)."""
    return _interpolated(readings, reading, axes)[0]


def _louder(readings: Sequence[WindowReading], reading: WindowReading, name: str, count: int) -> np.ndarray:
    """Mean |X|² by which the noise of a channel's lines exceeds twice that of any healthy recording (count,)."""
    known = [r.channels[name].floor for r in readings if name in r.channels]
    most = np.max([floor[:count] for floor in known if floor.size >= count], axis=0)
    return np.asarray(np.maximum(reading.channels[name].floor[:count] - 2 * most, 0.0))


def scatter_of(
    readings: Sequence[WindowReading], axes: Sequence[str]
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """What readings miss of the baseline of the others: of each line (K,), and of the path's ln|g|; by channel."""
    missed: dict[str, list[tuple[np.ndarray, ...]]] = {}
    left_out = []
    for i, others in enumerate(others_of(readings)):
        left_out.append((i, *_interpolated([readings[j] for j in others], readings[i], axes)))
    between = [(i, lines, power) for i, lines, power, _, names in left_out if len(names) > 1]
    for i, lines, power in between or [(i, lines, power) for i, lines, power, *_ in left_out]:
        for name, channel in readings[i].channels.items():
            if name in lines:
                m = min(lines[name].size, channel.lines.size)
                x, y = lines[name][:m], channel.lines[:m]
                error = np.abs(y - x) ** 2 + channel.floor[:m]
                missed.setdefault(name, []).append((x, y, error, power[name][:m]))
    Q = readings[0].period
    std, path = {}, {}
    for name, found in missed.items():
        m = min(error.size for _, _, error, _ in found)
        own = np.mean([error[:m] for _, _, error, _ in found], axis=0)
        local = uniform_filter1d(own, size=max(3, int(SMOOTH_ORDERS * Q)), mode="nearest")
        std[name] = np.sqrt(0.5 * (own + local))
        orders = np.arange(1, m + 1) / Q
        shown = []
        for x, y, _, p in found:
            middles, gain = band_gains(x[:m], y[:m], std[name], orders)
            shown.append(lesser(gain, band_levels(p[:m], y[:m], orders, middles)))
        known = np.concatenate(shown)
        path[name] = float(np.sqrt(np.mean(np.log(known) ** 2))) if known.size else 0.0
    return std, path
