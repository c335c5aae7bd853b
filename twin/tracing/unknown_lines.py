"""Lines of no gear, followed from window to window: which belong together, and what their frequency follows.

A line follows the clock (the same frequency in hertz), the angle (the same order), or neither: the frequency of a
machine beside this one, or of a motor with slip, is another by per cents in every window while its level stays. Lines
whose frequencies keep one ratio have one cause. Sidebands of the mesh lines that are the same number of hertz, or of
orders, away from all of them are a modulation of the whole level.

Holds    lines that stand out of every window on their own (twin/features/non_gear.py)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin.features.channel_lines import LineReading
from twin.features.shaft_orders import fraction_of_mesh
from twin.features.window_features import MeasuredLines
from twin.thresholds import deciding

WAYS = ("clock", "angle", "neither")


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownLineThresholds:
    """Which readings of several windows are one line."""

    clear: float = deciding(
        12.0,
        of="standard deviation of the line",
        meaning="amplitude of a line that is followed",
        source="not derived: chosen above the 9 that lines of no cause reach in clean campaigns of set J",
    )
    same_place: float = deciding(
        1.5, unit="resolution steps", meaning="distance within which lines of two windows are one", source="tones.py"
    )
    wander: float = deciding(
        0.06, of="frequency", meaning="furthest that a line wanders from window to window", source="not derived: chosen"
    )
    same_level: float = deciding(
        1.6, meaning="ratio of levels up to which a wandering line is the same", source="not derived: chosen"
    )
    least_windows: int = deciding(2, meaning="windows that must show a line", source="not derived: one may be chance")
    least_wandering: int = deciding(
        3, meaning="windows that must show a line that wanders", source="not derived: two lines are alike by chance"
    )
    least_share: float = deciding(
        0.6, of="windows since a line was first seen", meaning="share of them that must show it", source="chosen"
    )
    same_ratio: float = deciding(
        0.002, meaning="scatter of the ratio of two frequencies that have one cause", source="not derived: chosen"
    )
    least_sidebands: int = deciding(
        5,
        meaning="sidebands of all windows, of several mesh harmonics, that a modulation of the mesh must explain",
        source="derivation: two windows of 12 lines in half the distance of the mesh lines, 475 resolution steps, give "
        "five at one distance by chance in 1 of 1e5 campaigns",
    )


THRESHOLDS = UnknownLineThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenWindow:
    """What one measurement window shows beside the gears."""

    index: int
    revolutions: float
    speed_hz: float
    torque: float  # [N·m]
    duration: float  # [s]
    fitted: bool  # whether it takes part in fits
    readings: tuple[LineReading, ...]
    acceleration: MeasuredLines | None = None

    @property
    def step(self) -> float:
        """Resolution [Hz]."""
        return 1 / self.duration


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedLine:
    """One line over several windows."""

    follows: str  # of WAYS
    channel: str  # that shows it most clearly
    at: tuple[tuple[int, LineReading], ...]  # by position of the window in the campaign

    def _mean(self, values: Sequence[float], stds: Sequence[float]) -> tuple[float, float]:
        weight = 1 / np.square(stds)
        mean = float(np.average(values, weights=weight))
        scatter = float(np.std(values)) / max(np.sqrt(len(values) - 1), 1.0)
        return mean, float(np.hypot(1 / np.sqrt(weight.sum()), scatter))

    @property
    def frequency(self) -> tuple[float, float]:
        """Mean frequency and its standard deviation [Hz]."""
        return self._mean([r.frequency for _, r in self.at], [r.std for _, r in self.at])

    @property
    def order(self) -> tuple[float, float]:
        """Mean order of pinion rotation and its standard deviation."""
        return self._mean([r.order for _, r in self.at], [r.std * r.order / r.frequency for _, r in self.at])

    @property
    def spread(self) -> float:
        """Relative standard deviation of the frequency over the windows."""
        f = [r.frequency for _, r in self.at]
        return float(np.std(f, ddof=1) / np.mean(f)) if len(f) > 1 else 0.0

    @property
    def level(self) -> float:
        """Mean amplitude in its channel."""
        return float(np.mean([abs(r.amplitude(self.channel) or 0) for _, r in self.at]))

    @property
    def clearness(self) -> float:
        """Amplitude over its standard deviation, all windows together."""
        return float(np.sqrt(sum(_clearness(r, self.channel) ** 2 for _, r in self.at)))

    @property
    def first(self) -> int:
        """Position of the first window that shows it."""
        return min(i for i, _ in self.at)


@dataclass(frozen=True, slots=True, kw_only=True)
class Modulation:
    """All mesh lines of the acceleration modulated at one frequency."""

    follows: str  # "clock" or "angle"
    frequency: float  # [Hz], mean
    order: float  # of pinion rotation, mean
    std: float  # of the frequency [Hz], or of the order
    depth: float  # m
    depth_std: float
    at: tuple[int, ...]  # positions of the windows that show it


def _clearness(reading: LineReading, channel: str) -> float:
    y = reading.amplitude(channel)
    return 0.0 if y is None else abs(y) / max(reading.noise(channel), 1e-300)


def _best_channel(reading: LineReading) -> str:
    return max(reading.channels, key=lambda c: _clearness(reading, c))


def followed_lines(
    windows: Sequence[SeenWindow], limits: UnknownLineThresholds = THRESHOLDS
) -> tuple[FollowedLine, ...]:
    """The lines that enough windows show, the clearest first."""
    left = [(i, r) for i, w in enumerate(windows) for r in w.readings if _clearness(r, _best_channel(r)) > limits.clear]
    left.sort(key=lambda item: -_clearness(item[1], _best_channel(item[1])))
    out = []
    while left:
        line = _followed(left[0], left, windows, limits)
        taken = {id(r) for _, r in line.at}
        left = [(i, r) for i, r in left if id(r) not in taken]
        if _enough(line, windows, limits):
            out.append(line)
    return tuple(sorted(out, key=lambda line: -line.clearness))


def _enough(line: FollowedLine, windows: Sequence[SeenWindow], limits: UnknownLineThresholds) -> bool:
    """Whether enough windows show a line, at least two of them fitted ones."""
    least = limits.least_wandering if line.follows == "neither" else limits.least_windows
    since = len(windows) - line.first
    fitted = sum(windows[i].fitted for i, _ in line.at)
    return len(line.at) >= max(least, limits.least_share * since) and fitted >= 1


def _followed(
    lead: tuple[int, LineReading],
    readings: Sequence[tuple[int, LineReading]],
    windows: Sequence[SeenWindow],
    limits: UnknownLineThresholds,
) -> FollowedLine:
    """The readings of other windows that are the same line, in the way that most windows agree with."""
    channel = _best_channel(lead[1])
    ways = {follows: _same(lead, readings, windows, channel, follows, limits) for follows in WAYS}
    steady = max(("clock", "angle"), key=lambda f: (len(ways[f]), -_scatter(ways[f], windows, f)))
    wandering = len(ways["neither"]) > len(ways[steady]) and len(ways["neither"]) >= limits.least_wandering
    follows = "neither" if wandering else steady
    return FollowedLine(follows=follows, channel=channel, at=tuple(sorted(ways[follows].items())))


def _same(
    lead: tuple[int, LineReading],
    readings: Sequence[tuple[int, LineReading]],
    windows: Sequence[SeenWindow],
    channel: str,
    follows: str,
    limits: UnknownLineThresholds,
) -> dict[int, LineReading]:
    """By window, the reading that is nearest to the leading one, where it is near enough."""
    i0, first = lead
    out = {i0: first}
    distance: dict[int, float] = {}
    level = abs(first.amplitude(channel) or 0)
    for i, r in readings:
        own = abs(r.amplitude(channel) or 0)
        if i == i0 or not level / limits.same_level**2 < own < level * limits.same_level**2:
            continue
        if follows == "neither":
            near = abs(np.log(own / level)) / np.log(limits.same_level)
            if abs(r.frequency / first.frequency - 1) > limits.wander:
                continue
        elif follows == "clock":
            near = abs(r.frequency - first.frequency) / (limits.same_place * windows[i].step)
        else:
            near = abs(r.order - first.order) * windows[i].speed_hz / (limits.same_place * windows[i].step)
        if near < min(1.0, distance.get(i, np.inf)):
            distance[i], out[i] = near, r
    return out


def _scatter(found: dict[int, LineReading], windows: Sequence[SeenWindow], follows: str) -> float:
    """Mean square distance of the readings of a line from their mean, in resolution steps."""
    if len(found) < 2:
        return -sum(r.follows_angle for r in found.values()) if follows == "angle" else 0.0
    speed = np.mean([windows[i].speed_hz for i in found])
    values = np.array([r.frequency if follows == "clock" else r.order * speed for r in found.values()])
    return float(np.var(values) * windows[0].duration ** 2)


def families(
    lines: Sequence[FollowedLine],
    windows: Sequence[SeenWindow] = (),
    teeth: int | None = None,
    limits: UnknownLineThresholds = THRESHOLDS,
) -> list[list[FollowedLine]]:
    """Lines of one cause together; each group, and the groups, strongest first, a source before its sidebands.

    They follow the same and their frequencies keep a ratio, or one modulates the mesh: the other is its sideband.

    teeth  of the pinion; None where sidebands are not known
    """
    groups: list[list[FollowedLine]] = []
    for line in lines:
        for group in groups:
            if any(_related(line, other, limits) or _modulates(line, other, windows, teeth) for other in group):
                group.append(line)
                break
        else:
            groups.append([line])
    return [_source_first(group, windows, teeth) for group in groups]


def _modulates(line: FollowedLine, other: FollowedLine, windows: Sequence[SeenWindow], teeth: int | None) -> bool:
    """Whether sum or difference of two lines' orders is a mesh order in every window that shows both."""
    mine, others = dict(line.at), dict(other.at)
    both = sorted(set(mine) & set(others))
    if teeth is None or len(both) < 2:
        return False
    for sign in (-1, 1):
        sums = np.array([mine[i].order + sign * others[i].order for i in both])
        resolved = np.array([windows[i].step / windows[i].speed_hz for i in both])
        harmonic = np.rint(sums / teeth)
        if (np.abs(sums - teeth * harmonic) < resolved).all() and harmonic.all():
            return True
    return False


def _source_first(
    group: Sequence[FollowedLine], windows: Sequence[SeenWindow], teeth: int | None
) -> list[FollowedLine]:
    """The lines with one below half of the mesh order first that modulates the mesh into another."""
    lowest = min(group, key=lambda line: line.order[0])
    source = teeth is not None and lowest.order[0] < teeth / 2
    if source and any(_modulates(lowest, line, windows, teeth) for line in group if line is not lowest):
        return [lowest, *(line for line in group if line is not lowest)]
    return list(group)


def _related(line: FollowedLine, other: FollowedLine, limits: UnknownLineThresholds) -> bool:
    """Whether two lines have one cause: wandering together, or harmonics of one frequency that is their difference."""
    if line.follows != other.follows:
        return False
    mine, others = dict(line.at), dict(other.at)
    both = sorted(set(mine) & set(others))
    if not both:
        return False
    ratio = np.array([mine[i].frequency / others[i].frequency for i in both])
    if line.follows == "neither":
        return len(both) > 1 and float(ratio.std() / ratio.mean()) < limits.same_ratio
    mean = float(ratio.mean())
    high = max(mean, 1 / mean)
    return any(abs(q * high / round(q * high) - 1) < limits.same_ratio for q in (1, 2, 3))


def modulation_of(
    windows: Sequence[SeenWindow], teeth: int, limits: UnknownLineThresholds = THRESHOLDS
) -> tuple[Modulation | None, tuple[SeenWindow, ...]]:
    """A modulation of all mesh lines, and the windows without the lines that it makes.

    teeth  of the pinion
    """
    found = _sidebands(windows, teeth, limits)
    if len(found) < limits.least_windows:
        return None, tuple(windows)
    hertz = np.array([d for d, _ in found.values()])
    orders = np.array([d / windows[i].speed_hz for i, (d, _) in found.items()])
    clock = hertz.std() / hertz.mean() <= orders.std() / orders.mean()
    depths = [m for i, (_, lines) in found.items() if (m := _depth(windows[i], teeth, lines)) is not None]
    if not depths or np.median(depths) > 1:  # a level does not fall below nothing
        return None, tuple(windows)
    values, mean = (hertz, hertz.mean()) if clock else (orders, orders.mean())
    left = tuple(_without(w, teeth, found[i][0]) if i in found else w for i, w in enumerate(windows))
    return (
        Modulation(
            follows="clock" if clock else "angle",
            frequency=float(hertz.mean()),
            order=float(orders.mean()),
            std=float(max(values.std() / np.sqrt(values.size), 1e-4 * mean)),
            depth=float(np.median(depths)),
            depth_std=float(np.std(depths) / np.sqrt(len(depths)) + 0.02 * np.median(depths)),
            at=tuple(sorted(found)),
        ),
        left,
    )


def _offset(reading: LineReading, teeth: int) -> tuple[float, int]:
    """Distance from the nearest mesh order, and the mesh harmonic, negative for a line below it."""
    k = max(round(reading.order / teeth), 1)
    d = reading.order - k * teeth
    return abs(d), k if d > 0 else -k


def _sidebands(
    windows: Sequence[SeenWindow], teeth: int, limits: UnknownLineThresholds
) -> dict[int, tuple[float, list[LineReading]]]:
    """Lines at one distance from mesh lines in all windows: by window their distance [Hz] and themselves.

    The distance is the same in hertz, where a source of its own modulates the mesh, or in orders; empty where too few
    lines, or those beside a single mesh line alone, share one.
    """
    lines = [
        (i, d * w.speed_hz, d, side, r)
        for i, w in enumerate(windows)
        for r in w.readings
        if _clearness(r, "acceleration") > limits.clear and not fraction_of_mesh(r.order, teeth, w.step / w.speed_hz)
        for d, side in [_offset(r, teeth)]
    ]
    best: list[tuple[int, float, float, int, LineReading]] = []
    for lead in lines:
        for by_angle in (False, True):
            same = [x for x in lines if _apart(lead, x, windows, by_angle) < 0.5]
            if len(same) > len(best):
                best = same
    sides = {side for *_, side, _ in best}
    mirrored = any(-side in sides for side in sides)
    if len(best) < limits.least_sidebands or len({abs(side) for side in sides}) < 2 or not mirrored:
        return {}
    out = {}
    for i in sorted({i for i, *_ in best}):
        own = [x for x in best if x[0] == i]
        out[i] = float(np.mean([d for _, d, *_ in own])), [r for *_, r in own]
    return out


def _apart(
    lead: tuple[int, float, float, int, LineReading],
    other: tuple[int, float, float, int, LineReading],
    windows: Sequence[SeenWindow],
    by_angle: bool,
) -> float:
    """How far the distances of two sidebands from their mesh lines are apart [resolution steps]."""
    window = windows[other[0]]
    apart = abs(lead[2] - other[2]) * window.speed_hz if by_angle else abs(lead[1] - other[1])
    return float(apart / window.step)


def _depth(window: SeenWindow, teeth: int, lines: Sequence[LineReading]) -> float | None:
    """m = 2·|sideband|/|mesh line|, the median over the sidebands."""
    if window.acceleration is None:
        return None
    out = []
    for r in lines:
        mesh = window.acceleration.get(abs(_offset(r, teeth)[1]))
        if mesh is not None and abs(mesh) > 0:
            out.append(2 * abs(r.amplitude("acceleration") or 0) / abs(mesh))
    return float(np.median(out)) if out else None


def _without(window: SeenWindow, teeth: int, frequency: float) -> SeenWindow:
    """The window without lines that a modulation of the mesh lines makes, at the frequency and twice it, and near."""
    kept = []
    for r in window.readings:
        d = _offset(r, teeth)[0] * window.speed_hz
        apart = min(abs(d - n * frequency) for n in (1, 2, 3))
        if apart > 6 * window.step:
            kept.append(r)
    return replace(window, readings=tuple(kept))
