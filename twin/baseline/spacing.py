"""A spacing of lines that no known shaft makes: another shaft, or a modulation of its own frequency.

    score(s) = mean over channels, h, m of min(ln(P(h·z1 ± m·s)/floor), 5)          h = 0 … 3, m = 1 … 3

P   power spectrum against order, without the lines that known shafts make together
s   spacing [orders of the pinion]; s = n/Q for small n and Q where it is geared to the pinion, else it turns freely:
    n/Q within `DEVIATIONS` of s is believed where so simple a ratio lies that near by chance at most `CHANCE` often

Source   side bands round every mesh harmonic with one spacing: R. B. Randall, J. Mech. Des. 104 (1982) 259–267
Holds    spacings of 4 bins and more
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import count
from math import gcd

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter

from twin.baseline.reading import FLOOR_ORDERS, USABLE, common_period
from twin.features.angle import AngleTrack
from twin.features.orders import hann
from twin.features.resample import on_angle
from twin.windows import Samples

HARMONICS = 3
MULTIPLES = 3
CAP = 5.0  # ln(power/floor) that one line counts at most
LOWEST_BINS = 8.0  # smallest spacing, in bins
WIDEST = 3.0  # largest spacing [orders]
PARTS = 1.0  # mean ln(power/floor) of lines between, from which a spacing is a multiple of what turns
CLEAR = 1.5  # mean ln(power/floor) from which a spacing is believed
OVER_NEXT = 1.15  # times the best that is no multiple or part of it
WHOLE = 0.8  # of a spacing's score, that two or three times it must reach to be the spacing itself
KNOWN_BINS = 2.5  # lines that near to a known order are its own
EXCERPT_POINTS = 400
DEVIATIONS = 3.0  # standard deviations by which a spacing may miss the ratio that it is
CHANCE = 0.05  # of a free spacing to lie as near to a ratio as simple


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
    """One spacing that stands out."""

    order: float  # of the pinion
    std: float
    score: float
    next_score: float
    sidebands: tuple[Sideband, ...]  # strongest first
    excerpts: tuple[Excerpt, ...]  # of the channel with the strongest sideband
    ratio: Fraction | None  # of the pinion's speed, where it is one of small tooth counts
    part: int = 1  # 2 or 3 where weaker lines stand at halves or thirds of it, too: what turns is that much slower


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Spectrum:
    amplitude: np.ndarray  # peak (n,)
    level: np.ndarray  # min(ln(P/floor), CAP) at peaks off the known orders, 0 elsewhere (n,)
    bin: float  # [orders]


def _spectra(accelerations: Mapping[str, Samples], track: AngleTrack, period: int) -> dict[str, _Spectrum]:
    out = {}
    for name, samples in accelerations.items():
        signal, per_turn = on_angle(samples, track, samples.values.size)
        weight = hann(signal.values.size)
        amplitude = 2 * np.abs(np.fft.rfft((signal.values - signal.values.mean()) * weight)) / weight.sum()
        width = 1 / signal.turns
        power = amplitude[: int(USABLE * per_turn / width)] ** 2
        floor = median_filter(power, size=max(9, int(FLOOR_ORDERS / width)) | 1, mode="nearest") / np.log(2)
        level = np.log(np.maximum(power / np.maximum(floor, 1e-300), 1.0))
        level = np.where(power >= maximum_filter1d(power, 5), np.minimum(level, CAP), 0.0)
        order = np.arange(power.size) * width
        own = np.abs(order * period - np.rint(order * period)) / period < KNOWN_BINS * width
        out[name] = _Spectrum(amplitude=amplitude, level=np.where(own, 0.0, level), bin=width)
    return out


def unattributed_spacing(
    accelerations: Mapping[str, Samples], track: AngleTrack, teeth: tuple[int, int], shafts: Sequence[Fraction]
) -> Spacing | None:
    """The spacing that stands out most; None where none does, or there is no accelerometer."""
    if not accelerations:
        return None
    spectra = _spectra(accelerations, track, common_period(shafts))
    width = max(s.bin for s in spectra.values())
    finest = min(s.bin for s in spectra.values())
    spacings = np.arange(LOWEST_BINS * width, WIDEST, finest / (2 * MULTIPLES))
    off = np.abs(spacings * common_period(shafts) - np.rint(spacings * common_period(shafts))) / common_period(shafts)
    spacings = spacings[off > KNOWN_BINS * width]
    if spacings.size == 0:  # the window is too short: known orders fill all
        return None
    places = [(0, m) for m in range(1, MULTIPLES + 1)]
    places += [(h, sign * m) for h in range(1, HARMONICS + 1) for m in range(1, MULTIPLES + 1) for sign in (-1, 1)]
    score = np.zeros(spacings.size)
    for s in spectra.values():
        near = maximum_filter1d(s.level, 3)
        for h, m in places:
            at = np.rint((h * teeth[0] + m * spacings) / s.bin).astype(int)
            score += np.where(at < near.size, near[np.minimum(at, near.size - 1)], 0.0)
    score /= len(places) * len(spectra)
    best = int(np.argmax(score))
    for times in (3, 2):  # a part of a spacing meets its lines, too
        near = np.abs(spacings - times * spacings[best]) < 2 * width
        if near.any() and score[near].max() > WHOLE * score[best]:
            best = int(np.flatnonzero(near)[np.argmax(score[near])])
            break
    s0 = spacings[best]
    ratio = spacings / s0
    simple = [Fraction(a, b) for a in range(1, 5) for b in range(1, 5)]
    kin = np.any([np.abs(ratio - float(q)) < 3 * width / s0 for q in simple], axis=0)
    following = float(score[~kin].max(initial=0.0))
    if score[best] < CLEAR or score[best] < OVER_NEXT * following:
        return None
    near = {name: maximum_filter1d(s.level, 3) for name, s in spectra.items()}
    between = {q: _between(spectra, near, teeth[0], float(s0), q) for q in (3, 2)}
    part = max(between, key=lambda q: between[q])
    order, std = _refined(spectra, teeth[0], s0, places)
    sidebands = _sidebands(spectra, teeth[0], order)
    shown = next((b.channel for b in sidebands if b.harmonic), None)
    return Spacing(
        order=order,
        std=std,
        score=float(score[best]),
        next_score=following,
        sidebands=sidebands,
        excerpts=() if shown is None else _excerpts(shown, spectra[shown], teeth[0], order),
        ratio=simple_ratio(order, std),
        part=part if between[part] > PARTS else 1,
    )


def simple_ratio(order: float, std: float) -> Fraction | None:
    """The ratio of small numbers that an order is; None where one as simple may lie as near by chance.

    There are Σ φ(q), q ≤ Q, ratios of denominators up to Q in every unit, so that chance is Σ φ(q)·2·reach.
    """
    reach, chance = DEVIATIONS * std, 0.0
    for q in count(1):
        chance += 2 * reach * sum(gcd(p, q) == 1 for p in range(1, q + 1))
        if chance > CHANCE:
            return None
        if abs(round(order * q) / q - order) < reach:
            return Fraction(round(order * q), q)
    raise AssertionError("chance grows without end")


def shared_ratio(spacings: Sequence[Spacing | None]) -> Fraction | None:
    """The ratio of small numbers that the spacings of most windows are together; None where they are none.

    spacings  of every window, None where it has none
    """
    found = [s for s in spacings if s is not None]
    if not found:
        return None
    order, std = np.array([s.order for s in found]), np.array([s.std for s in found])
    near = np.abs(order - np.median(order)) < DEVIATIONS * np.hypot(std, np.median(std))
    if 2 * near.sum() <= len(spacings):
        return None
    weight = 1 / std[near] ** 2
    mean = float(np.average(order[near], weights=weight))
    scatter = float(np.sum(weight * (order[near] - mean) ** 2)) / max(int(near.sum()) - 1, 1)
    return simple_ratio(mean, float(np.sqrt(max(scatter, 1.0) / weight.sum())))


def _between(spectra: Mapping[str, _Spectrum], near: Mapping[str, np.ndarray], z1: int, s0: float, parts: int) -> float:
    """Mean level of the lines at parts of a spacing, those of the spacing itself left out."""
    levels = []
    for name, s in spectra.items():
        for h in range(1, HARMONICS + 1):
            for m in range(1, 2 * parts):
                for sign in (-1, 1):
                    at = round((h * z1 + sign * m * s0 / parts) / s.bin)
                    if m % parts and 0 < at < near[name].size:
                        levels.append(float(near[name][at]))
    return float(np.mean(levels)) if levels else 0.0


def _refined(
    spectra: Mapping[str, _Spectrum], z1: int, s0: float, places: Sequence[tuple[int, int]]
) -> tuple[float, float]:
    """Spacing and its standard deviation from the places of all lines that stand out, by their power."""
    found, weights = [], []
    for s in spectra.values():
        for h, m in places:
            at = round((h * z1 + m * s0) / s.bin)
            if at + 2 >= s.level.size:
                continue
            j = at - 1 + int(np.argmax(s.level[at - 1 : at + 2]))
            if s.level[j] <= 2.0 or j < 2:
                continue
            left, top, right = np.log(np.maximum(s.amplitude[j - 1 : j + 2], 1e-300))
            bent = left - 2 * top + right
            place = (j + (0.5 * (left - right) / bent if bent < 0 else 0.0)) * s.bin
            found.append((place - h * z1) / m)
            weights.append(m**2 * s.level[j])
    if not found:
        return s0, min(s.bin for s in spectra.values())
    values, w = np.array(found), np.array(weights)
    middle = np.median(values)
    keep = np.abs(values - middle) < 3 * max(1.4826 * float(np.median(np.abs(values - middle))), 1e-6)
    values, w = values[keep], w[keep]
    mean = float(np.average(values, weights=w))
    scatter = float(np.sqrt(np.average((values - mean) ** 2, weights=w)))
    finest = min(s.bin for s in spectra.values())
    return mean, float(np.hypot(scatter / np.sqrt(values.size), 0.01 * finest))


def _sidebands(spectra: Mapping[str, _Spectrum], z1: int, order: float) -> tuple[Sideband, ...]:
    out = []
    for name, s in spectra.items():

        def peak(at: float, s: _Spectrum = s) -> tuple[float, float]:
            j = round(at / s.bin)
            if j < 2 or j + 2 >= s.level.size:
                return 0.0, 0.0
            return float(s.amplitude[j - 1 : j + 2].max()), float(s.level[j - 1 : j + 2].max())

        for h in range(HARMONICS + 1):
            mesh = peak(h * z1)[0] if h else None
            for m in range(1, MULTIPLES + 1):
                sides = [peak(h * z1 + sign * m * order) for sign in ((-1, 1) if h else (1,))]
                if max(level for _, level in sides) < 2.0:
                    continue
                amplitude = float(np.sqrt(np.mean([a**2 for a, _ in sides])))
                depth = None if not mesh else float(sum(a for a, _ in sides) / mesh)
                out.append(Sideband(channel=name, harmonic=h, multiple=m, amplitude=amplitude, depth=depth))
    return tuple(sorted(out, key=lambda b: -b.amplitude))


def _excerpts(channel: str, s: _Spectrum, z1: int, order: float) -> tuple[Excerpt, ...]:
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
