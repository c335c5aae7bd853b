"""Lines of one spacing that no known shaft makes: another shaft, or a modulation of a frequency of its own.

    score(s) = mean over channels, h, m of min(ln(P(h·z1 ± m·s)/floor), 5)          h = 0 … 3, m = 1 … 3

P   power spectrum against order, without the lines that known shafts make together
s   spacing [orders of the pinion]; s = n/Q for small n and Q where it is geared to the pinion, else it is free.
    A ratio n/Q is believed where one as simple would lie as near to s by chance at most one time in twenty

Source   sidebands about every mesh harmonic with one spacing: R. B. Randall, J. Mech. Des. 104 (1982) 259–267
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
from twin.features.resample import on_angle
from twin.features.transforms import hann
from twin.thresholds import deciding
from twin.windows import Samples

HARMONICS = 3  # of the mesh whose sidebands are searched
MULTIPLES = 3  # of the spacing that are searched to either side
EXCERPT_POINTS = 400  # of a spectrum that is drawn


@dataclass(frozen=True, slots=True, kw_only=True)
class SpacingThresholds:
    """When a spacing of lines is believed, and what it is related to."""

    line_cap: float = deciding(
        5.0, meaning="ln(power/floor) that one line counts at most, so that a single strong line makes no spacing",
        source="not derived: chosen so that at least a third of the lines must be there",
    )  # fmt: skip
    smallest_spacing: float = deciding(
        8.0, unit="spectral lines", meaning="smallest spacing that is searched",
        source="derivation: Hann's main lobe is four lines wide, and two lobes must be resolved",
    )  # fmt: skip
    largest_spacing: float = deciding(
        3.0, unit="orders of the pinion", meaning="largest spacing that is searched",
        source="not derived: wider spacings leave fewer than two lines of a sideband group between mesh harmonics",
    )  # fmt: skip
    clear_score: float = deciding(
        1.5, meaning="mean ln(power/floor) from which a spacing is believed",
        source="tuned on the 28-channel rig and the seven loads of the broken-tooth set",
    )  # fmt: skip
    over_next: float = deciding(
        1.15, meaning="ratio of its score to that of the best unrelated spacing",
        source="tuned on the 28-channel rig and the seven loads of the broken-tooth set",
    )  # fmt: skip
    whole_share: float = deciding(
        0.8, meaning="share of a spacing's score that two or three times it must reach to be the spacing itself",
        source="not derived: a part of a spacing meets all its lines and as many empty places",
    )  # fmt: skip
    part_score: float = deciding(
        1.0, meaning="mean ln(power/floor) of the lines between, from which the spacing is a multiple of the rotation",
        source="derivation: the mean of ln(power/floor) of noise is below 0.4; the margin is not derived",
    )  # fmt: skip
    line_level: float = deciding(
        2.0, meaning="ln(power/floor) from which a line is used for the place and the size of sidebands",
        source="derivation: noise exceeds e² times its median power with a probability of 0.6 %",
    )  # fmt: skip
    known_lines: float = deciding(
        2.5, unit="spectral lines", meaning="distance up to which a line belongs to a known order",
        source="derivation: half of the main lobe of Hann's window is two lines wide",
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
    score: float
    next_score: float
    sidebands: tuple[Sideband, ...]  # strongest first
    excerpts: tuple[Excerpt, ...]  # of the channel with the strongest sideband
    ratio: Fraction | None  # of the pinion's speed, where it is one of small tooth counts
    part: int = 1  # 2 or 3 where weaker lines lie at halves or thirds of it, too: the rotation is that much slower


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Spectrum:
    amplitude: np.ndarray  # peak (n,)
    level: np.ndarray  # min(ln(P/floor), CAP) at peaks off the known orders, 0 elsewhere (n,)
    bin: float  # [orders]


def _spectra(
    accelerations: Mapping[str, Samples], track: AngleTrack, period: int, limits: SpacingThresholds
) -> dict[str, _Spectrum]:
    """Amplitude and level above the floor of every channel against order."""
    out = {}
    for name, samples in accelerations.items():
        signal, per_turn = on_angle(samples, track, samples.values.size)
        weight = hann(signal.values.size)
        amplitude = 2 * np.abs(np.fft.rfft((signal.values - signal.values.mean()) * weight)) / weight.sum()
        width = 1 / signal.turns
        power = amplitude[: int(USABLE * per_turn / width)] ** 2
        floor = median_filter(power, size=max(9, int(FLOOR_ORDERS / width)) | 1, mode="nearest") / np.log(2)
        level = np.log(np.maximum(power / np.maximum(floor, 1e-300), 1.0))
        level = np.where(power >= maximum_filter1d(power, 5), np.minimum(level, limits.line_cap), 0.0)
        order = np.arange(power.size) * width
        own = np.abs(order * period - np.rint(order * period)) / period < limits.known_lines * width
        out[name] = _Spectrum(amplitude=amplitude, level=np.where(own, 0.0, level), bin=width)
    return out


def unattributed_spacing(
    accelerations: Mapping[str, Samples],
    track: AngleTrack,
    teeth: tuple[int, int],
    shafts: Sequence[Fraction],
    limits: SpacingThresholds = DEFAULT,
) -> Spacing | None:
    """The clearest spacing of lines that no known shaft makes; None where there is none, or no accelerometer.

    shafts  orders of all known shafts, of the pinion's rotation
    """
    if not accelerations:
        return None
    spectra = _spectra(accelerations, track, common_period(shafts), limits)
    spacings, score = _scores(spectra, teeth[0], common_period(shafts), limits)
    if spacings.size == 0:  # the window is too short: lines of known shafts fill the spectrum
        return None
    width = max(s.bin for s in spectra.values())
    best = _whole(spacings, score, width, limits)
    following = _best_unrelated(spacings, score, best, width)
    if score[best] < limits.clear_score or score[best] < limits.over_next * following:
        return None
    s0 = float(spacings[best])
    near = {name: maximum_filter1d(s.level, 3) for name, s in spectra.items()}
    between = {q: _between(spectra, near, teeth[0], s0, q) for q in (3, 2)}
    part = max(between, key=lambda q: between[q])
    order, std = _refined(spectra, teeth[0], s0, limits)
    sidebands = _sidebands(spectra, teeth[0], order, limits)
    shown = next((b.channel for b in sidebands if b.harmonic), None)
    return Spacing(
        order=order,
        std=std,
        score=float(score[best]),
        next_score=following,
        sidebands=sidebands,
        excerpts=() if shown is None else _excerpts(shown, spectra[shown], teeth[0], order),
        ratio=simple_ratio(order, std, limits),
        part=part if between[part] > limits.part_score else 1,
    )


def _places() -> list[tuple[int, int]]:
    """Mesh harmonic (0: none) and multiple of the spacing of every line that is searched."""
    places = [(0, m) for m in range(1, MULTIPLES + 1)]
    return places + [
        (h, sign * m) for h in range(1, HARMONICS + 1) for m in range(1, MULTIPLES + 1) for sign in (-1, 1)
    ]


def _scores(
    spectra: Mapping[str, _Spectrum], z1: int, period: int, limits: SpacingThresholds
) -> tuple[np.ndarray, np.ndarray]:
    """Spacings that no known shaft has (n,), and their scores (n,)."""
    width = max(s.bin for s in spectra.values())
    finest = min(s.bin for s in spectra.values())
    spacings = np.arange(limits.smallest_spacing * width, limits.largest_spacing, finest / (2 * MULTIPLES))
    off = np.abs(spacings * period - np.rint(spacings * period)) / period
    spacings = spacings[off > limits.known_lines * width]
    score = np.zeros(spacings.size)
    for s in spectra.values():
        near = maximum_filter1d(s.level, 3)
        for h, m in _places():
            at = np.rint((h * z1 + m * spacings) / s.bin).astype(int)
            score += np.where(at < near.size, near[np.minimum(at, near.size - 1)], 0.0)
    return spacings, score / (len(_places()) * len(spectra))


def _whole(spacings: np.ndarray, score: np.ndarray, width: float, limits: SpacingThresholds) -> int:
    """Index of the best spacing; a part of a spacing meets its lines, too, and is replaced by the whole."""
    best = int(np.argmax(score))
    for times in (3, 2):
        near = np.abs(spacings - times * spacings[best]) < 2 * width
        if near.any() and score[near].max() > limits.whole_share * score[best]:
            return int(np.flatnonzero(near)[np.argmax(score[near])])
    return best


def _best_unrelated(spacings: np.ndarray, score: np.ndarray, best: int, width: float) -> float:
    """Score of the best spacing that is no simple multiple or part of the best one."""
    s0 = spacings[best]
    simple = [Fraction(a, b) for a in range(1, 5) for b in range(1, 5)]
    related = np.any([np.abs(spacings / s0 - float(q)) < 3 * width / s0 for q in simple], axis=0)
    return float(score[~related].max(initial=0.0))


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


def shared_ratio(spacings: Sequence[Spacing | None], limits: SpacingThresholds = DEFAULT) -> Fraction | None:
    """The ratio of small numbers that the spacings of most windows are together; None where they are none.

    spacings  of every window, None where it has none
    """
    found = [s for s in spacings if s is not None]
    if not found:
        return None
    order, std = np.array([s.order for s in found]), np.array([s.std for s in found])
    near = np.abs(order - np.median(order)) < limits.ratio_deviations * np.hypot(std, np.median(std))
    if 2 * near.sum() <= len(spacings):
        return None
    weight = 1 / std[near] ** 2
    mean = float(np.average(order[near], weights=weight))
    scatter = float(np.sum(weight * (order[near] - mean) ** 2)) / max(int(near.sum()) - 1, 1)
    return simple_ratio(mean, float(np.sqrt(max(scatter, 1.0) / weight.sum())), limits)


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


def _refined(spectra: Mapping[str, _Spectrum], z1: int, s0: float, limits: SpacingThresholds) -> tuple[float, float]:
    """Spacing and its standard deviation from the places of all lines above the floor, weighted by their level."""
    found, weights = [], []
    for s in spectra.values():
        for h, m in _places():
            at = round((h * z1 + m * s0) / s.bin)
            if at + 2 >= s.level.size:
                continue
            j = at - 1 + int(np.argmax(s.level[at - 1 : at + 2]))
            if s.level[j] <= limits.line_level or j < 2:
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
    keep = np.abs(values - middle) < limits.outlier * max(1.4826 * float(np.median(np.abs(values - middle))), 1e-6)
    values, w = values[keep], w[keep]
    mean = float(np.average(values, weights=w))
    scatter = float(np.sqrt(np.average((values - mean) ** 2, weights=w)))
    finest = min(s.bin for s in spectra.values())
    return mean, float(np.hypot(scatter / np.sqrt(values.size), 0.01 * finest))


def _sidebands(
    spectra: Mapping[str, _Spectrum], z1: int, order: float, limits: SpacingThresholds
) -> tuple[Sideband, ...]:
    """Sidebands of a spacing that rise above the floor, the strongest first."""
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
                if max(level for _, level in sides) < limits.line_level:
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
