"""Lines of one spacing that no known shaft makes: another shaft, or a modulation of a frequency of its own.

A spacing s [orders of the pinion] is found where both lines h·z1 ± s stand out of their neighbourhood about mesh
harmonics h more than chance allows (spacing_search.py), on any channel or on several together. Of spacings that are
simple parts and multiples of one another, or sums of one with orders of known shafts, the clearest is kept.

s = n/Q for small n and Q where it is geared to the pinion, else it is free: a ratio n/Q is believed where one as simple
would lie as near to s by chance at most one time in twenty.

Source   sidebands about every mesh harmonic with one spacing: R. B. Randall, J. Mech. Des. 104 (1982) 259–267
Holds    spacings of 8 bins and more
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import count
from math import gcd, lcm

import numpy as np
from scipy.ndimage import maximum_filter1d

from twin.baseline.reading import common_period
from twin.baseline.spacing_search import DEFAULT as SEARCH
from twin.baseline.spacing_search import (
    HARMONICS,
    OrderSpectrum,
    PairLimit,
    PairSearch,
    SpacingSearchThresholds,
    limits_of_search,
    search,
    spectra,
)
from twin.features.angle import AngleTrack
from twin.thresholds import deciding
from twin.windows import Samples

MULTIPLES = 3  # of the spacing that are searched to either side
EXCERPT_POINTS = 400  # of a spectrum that is drawn
MOST = 3  # spacings of one window that are given, the clearest first
SIMPLE = tuple({Fraction(a, b) for a in range(1, 5) for b in range(1, 5)})  # parts and multiples of one spacing


@dataclass(frozen=True, slots=True, kw_only=True)
class SpacingThresholds:
    """When a spacing of lines is believed, and what it is related to."""

    part_score: float = deciding(
        1.0, meaning="mean ln(power/floor) of the lines between, from which the spacing is a multiple of the rotation",
        source="derivation: the mean of ln(power/floor) of noise is below 0.4; the margin is not derived",
    )  # fmt: skip
    outlier: float = deciding(
        3.0, unit="standard deviations", meaning="distance from the median from which a line's place is left out",
        source="convention: three standard deviations, estimated from the median absolute deviation",
    )  # fmt: skip
    ratio_deviations: float = deciding(
        3.0, unit="standard deviations", meaning="distance up to which a spacing may be a ratio of tooth counts",
        source="convention: three standard deviations",
    )  # fmt: skip
    chance: float = deciding(
        0.05, meaning="probability up to which a free spacing may lie as near to a ratio as simple",
        source="convention: one in twenty",
    )  # fmt: skip


DEFAULT = SpacingThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class Sideband:
    """Lines ±m·s round a mesh harmonic in one channel."""

    channel: str
    harmonic: int  # 0: the lines m·s themselves
    multiple: int
    amplitude: float  # peak, root of both sides' mean power
    depth: float | None  # of the mesh line; None for harmonic 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Excerpt:
    """The spectrum of one channel round a mesh harmonic: the highest line of every step."""

    channel: str
    harmonic: int
    start: float  # of the first step's middle [orders]
    step: float  # [orders]
    amplitude: np.ndarray  # peak (n,)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Spacing:
    """One spacing."""

    order: float  # of the pinion
    std: float
    log_chance: float  # ln of the probability that the search finds one as clear by chance
    next_log_chance: float  # the same of the best spacing that is not related to this one
    channels: tuple[str, ...]  # on which both sidebands stand out of their neighbourhood about a mesh harmonic
    sidebands: tuple[Sideband, ...]  # strongest first
    excerpts: tuple[Excerpt, ...]  # of the channel with the strongest sideband
    ratio: Fraction | None  # of the pinion's speed, where it is one of small tooth counts
    part: int = 1  # 2 or 3 where weaker lines lie at halves or thirds of it, too: the rotation is that much slower


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SpacingsFound:
    """What a search of one window found, and what it could find."""

    spacings: tuple[Spacing, ...]  # the clearest first
    smallest: float  # spacing sought [orders of the pinion]
    largest: float
    limits: tuple[PairLimit, ...]  # from which sidebands would have been found; empty where nothing could be sought


def unattributed_spacings(
    accelerations: Mapping[str, Samples],
    track: AngleTrack,
    teeth: tuple[int, int],
    shafts: Sequence[Fraction],
    limits: SpacingThresholds = DEFAULT,
    searching: SpacingSearchThresholds = SEARCH,
) -> SpacingsFound:
    """The spacings of lines that no known shaft makes.

    shafts  orders of all known shafts, of the pinion's rotation
    """
    nothing = SpacingsFound(spacings=(), smallest=0.0, largest=0.0, limits=())
    if not accelerations:
        return nothing
    period, z1 = common_period(shafts), teeth[0]
    shown = spectra(accelerations, track, z1, period, searching)
    if not shown:
        return nothing
    tried = search(shown, z1, period, searching)
    if tried.spacings.size == 0:  # the window is too short: lines of known shafts fill the spectrum
        return nothing
    spacings: list[Spacing] = []
    width = max(s.bin for s in shown.values())
    free = np.ones(tried.spacings.size, dtype=bool)  # not related to a spacing that was found
    for _ in range(MOST):
        if not free.any():
            break
        best = int(np.flatnonzero(free)[np.argmin(tried.log_chance[free])])
        if tried.log_chance[best] > np.log(searching.chance):
            break
        first, _ = _refined(shown, z1, float(tried.spacings[best]), limits, searching, most=1)
        order, std = _refined(shown, z1, first, limits, searching)
        part = _part(shown, z1, order, limits)
        ratio = simple_ratio(order / part, std / part, limits)
        free &= ~_related(tried.spacings, order, period, ratio, 3 * width)
        free[best] = False
        one = Spacing(
            order=order,
            std=std,
            log_chance=float(tried.log_chance[best]),
            next_log_chance=float(tried.log_chance[free].min(initial=0.0)),
            channels=_seen_on(tried, best, searching),
            sidebands=_sidebands(shown, z1, order, searching),
            excerpts=(),
            ratio=ratio,
            part=part,
        )
        drawn = next((b.channel for b in one.sidebands if b.harmonic), None)
        spacings.append(one if drawn is None else replace(one, excerpts=_excerpts(drawn, shown[drawn], z1, order)))
    return SpacingsFound(
        spacings=tuple(spacings),
        smallest=float(tried.spacings[0]),
        largest=float(tried.spacings[-1]),
        limits=limits_of_search(shown, z1, tried.spacings.size, searching),
    )


def _part(shown: Mapping[str, OrderSpectrum], z1: int, order: float, limits: SpacingThresholds) -> int:
    """2 or 3 where weaker lines lie at halves or thirds of a spacing, too; else 1."""
    near = {name: maximum_filter1d(s.level, 3) for name, s in shown.items()}
    between = {q: _between(shown, near, z1, order, q) for q in (3, 2)}
    part = max(between, key=lambda q: between[q])
    return part if between[part] > limits.part_score else 1


def _seen_on(tried: PairSearch, best: int, searching: SpacingSearchThresholds) -> tuple[str, ...]:
    """Channels on which both sidebands of a spacing tried stand out about a mesh harmonic."""
    beside = slice(max(best - 2, 0), best + 3)
    return tuple(c for c, r in tried.pairs.items() if (r[:, beside] >= searching.stands_out).any())


def _related(spacings: np.ndarray, found: float, period: int, ratio: Fraction | None, reach: float) -> np.ndarray:
    """Whether spacings (n,) are parts or multiples of one that was found, or its sums with orders of known shafts."""
    if ratio is not None:  # the lines of all shafts together
        period = lcm(period, ratio.denominator)
        return np.asarray(np.abs(spacings * period - np.rint(spacings * period)) / period < reach)
    related = np.any([np.abs(spacings - float(q) * found) < reach for q in SIMPLE], axis=0)
    for m in range(-MULTIPLES, MULTIPLES + 1):
        apart = (spacings - m * found) * period
        related |= (m != 0) & (np.abs(apart - np.rint(apart)) / period < reach)
    return np.asarray(related)


def _places() -> list[tuple[int, int]]:
    """Mesh harmonic (0: none) and multiple of the spacing of every line that is searched."""
    places = [(0, m) for m in range(1, MULTIPLES + 1)]
    return places + [
        (h, sign * m) for h in range(1, HARMONICS + 1) for m in range(1, MULTIPLES + 1) for sign in (-1, 1)
    ]


def simple_ratio(order: float, std: float, limits: SpacingThresholds = DEFAULT) -> Fraction | None:
    """The ratio of small numbers that an order is; None where one as simple may lie as near by chance.

    There are Σ φ(q), q ≤ Q, ratios of denominators up to Q in every unit, so that chance is Σ φ(q)·2·reach.
    """
    reach, chance = limits.ratio_deviations * std, 0.0
    for q in count(1):
        chance += 2 * reach * sum(gcd(p, q) == 1 for p in range(1, q + 1))
        if chance > limits.chance:
            return None
        if abs(round(order * q) / q - order) < reach:
            return Fraction(round(order * q), q)
    raise AssertionError("chance grows without end")


def shared_ratio(windows: Sequence[Iterable[Spacing]], limits: SpacingThresholds = DEFAULT) -> Fraction | None:
    """The ratio of small numbers that a spacing of most windows is; None where there is none.

    windows  the spacings of every window
    """
    all_of = [[(s.order / s.part, s.std / s.part) for s in spacings] for spacings in windows]
    best: list[tuple[float, float]] = []
    for order, std in (place for places in all_of for place in places):
        near = [
            min(fitting, key=lambda place: abs(place[0] - order))
            for places in all_of
            if (fitting := [p for p in places if abs(p[0] - order) < limits.ratio_deviations * np.hypot(p[1], std)])
        ]
        best = max(best, near, key=len)
    if 2 * len(best) <= len(windows):
        return None
    values, weight = np.array([o for o, _ in best]), np.array([std**-2 for _, std in best])
    mean = float(np.average(values, weights=weight))
    scatter = float(np.sum(weight * (values - mean) ** 2)) / max(len(best) - 1, 1)
    return simple_ratio(mean, float(np.sqrt(max(scatter, 1.0) / weight.sum())), limits)


def _between(
    shown: Mapping[str, OrderSpectrum], near: Mapping[str, np.ndarray], z1: int, s0: float, parts: int
) -> float:
    """Mean level of the lines at parts of a spacing, those of the spacing itself left out."""
    levels = []
    for name, s in shown.items():
        for h in range(1, HARMONICS + 1):
            for m in range(1, 2 * parts):
                for sign in (-1, 1):
                    at = round((h * z1 + sign * m * s0 / parts) / s.bin)
                    if m % parts and 0 < at < near[name].size:
                        levels.append(float(near[name][at]))
    return float(np.mean(levels)) if levels else 0.0


def _refined(
    shown: Mapping[str, OrderSpectrum],
    z1: int,
    s0: float,
    limits: SpacingThresholds,
    searching: SpacingSearchThresholds,
    most: int = MULTIPLES,
) -> tuple[float, float]:
    """Spacing and its standard deviation from the places of all lines above the floor, weighted by their level.

    most  multiples of the spacing that are used: far ones need a spacing that is nearly known
    """
    found, weights = [], []
    for s in shown.values():
        for h, m in _places():
            if abs(m) > most:
                continue
            at = round((h * z1 + m * s0) / s.bin)
            if at + 2 >= s.level.size:
                continue
            j = at - 1 + int(np.argmax(s.ratio[at - 1 : at + 2]))
            if s.ratio[j] < searching.stands_out or j < 2:
                continue
            left, top, right = np.log(np.maximum(s.amplitude[j - 1 : j + 2], 1e-300))
            bent = left - 2 * top + right
            place = (j + (0.5 * (left - right) / bent if bent < 0 else 0.0)) * s.bin
            found.append((place - h * z1) / m)
            weights.append(m**2 * s.level[j])
    if not found:
        return s0, min(s.bin for s in shown.values())
    values, w = np.array(found), np.array(weights)
    middle = np.median(values)
    keep = np.abs(values - middle) < limits.outlier * max(1.4826 * float(np.median(np.abs(values - middle))), 1e-6)
    values, w = values[keep], w[keep]
    mean = float(np.average(values, weights=w))
    scatter = float(np.sqrt(np.average((values - mean) ** 2, weights=w)))
    finest = min(s.bin for s in shown.values())
    return mean, float(np.hypot(scatter / np.sqrt(values.size), 0.01 * finest))


def _sidebands(
    shown: Mapping[str, OrderSpectrum], z1: int, order: float, searching: SpacingSearchThresholds
) -> tuple[Sideband, ...]:
    """Sidebands of a spacing that rise above the floor, the strongest first."""
    out = []
    for name, s in shown.items():

        def peak(at: float, s: OrderSpectrum = s) -> tuple[float, float]:
            j = round(at / s.bin)
            if j < 2 or j + 2 >= s.level.size:
                return 0.0, 0.0
            return float(s.amplitude[j - 1 : j + 2].max()), float(s.ratio[j - 1 : j + 2].max())

        for h in range(HARMONICS + 1):
            mesh = peak(h * z1)[0] if h else None
            for m in range(1, MULTIPLES + 1):
                sides = [peak(h * z1 + sign * m * order) for sign in ((-1, 1) if h else (1,))]
                if max(ratio for _, ratio in sides) < searching.stands_out:
                    continue
                amplitude = float(np.sqrt(np.mean([a**2 for a, _ in sides])))
                depth = None if not mesh else float(sum(a for a, _ in sides) / mesh)
                out.append(Sideband(channel=name, harmonic=h, multiple=m, amplitude=amplitude, depth=depth))
    return tuple(sorted(out, key=lambda b: -b.amplitude))


def _excerpts(channel: str, s: OrderSpectrum, z1: int, order: float) -> tuple[Excerpt, ...]:
    """The spectrum round every mesh harmonic, as wide as the sidebands that are sought and half a spacing more."""
    out = []
    half = (MULTIPLES + 0.5) * order
    size = max(1, round(2 * half / s.bin / EXCERPT_POINTS))
    for h in range(1, HARMONICS + 1):
        low = max(0, round((h * z1 - half) / s.bin))
        values = s.amplitude[low : min(round((h * z1 + half) / s.bin) + 1, s.amplitude.size)]
        count = values.size // size
        if count:
            highest = values[: count * size].reshape(-1, size).max(axis=1)
            start = (low + (size - 1) / 2) * s.bin
            out.append(Excerpt(channel=channel, harmonic=h, start=start, step=size * s.bin, amplitude=highest))
    return tuple(out)
