"""The search for a spacing: pairs of lines at h·z1 ± s that stand out of their neighbourhood, and the chance of them.

    E_c(s) = −2·Σ_h ln q_c(min over both sides of A(h·z1 ± s)/M)      h = 1 … 3
    ln p_c = ln N + ln Q(3, E_c)
    ln p   = ln 2 + min(ln n + min_c ln p_c, 1 + mean_c ln p_c)        of n channels, n > 1

A    amplitude spectrum against order without the lines that known shafts make
M    its running median, or what the timing of the edges that the angle comes from makes of the channel's lines there,
     whichever is more; since these change from draw to draw, the highest of half the lines that the angle can follow
q_c  share of the channel's searched places, without the pair's own, that stand as far out of their neighbourhood; no
     less than the power law through its shares of 3 and 1 %: a machine of many lines needs more than noise does
Q    upper tail of the gamma distribution: E of lines that are paired by chance; N spacings are tried

Both combinations over channels hold whatever channels have in common.

Source   V. Vovk, R. Wang, Combining p-values via averaging, Biometrika 107 (2020) 791–808
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.special import gammaincc, gammainccinv

from twin.baseline.reading import FLOOR_ORDERS, USABLE
from twin.features.angle import AngleTrack
from twin.features.resample import by_angle_error, on_angle, splined
from twin.features.transforms import hann
from twin.thresholds import deciding
from twin.windows import Samples

HARMONICS = 3  # of the mesh whose sidebands are searched
MAIN_LOBE = 5  # lines of Hann's window that one line of a spectrum fills
TAIL = (0.03, 0.01)  # shares of the places whose values give the power law beyond them
SCALLOP = 0.849  # of its amplitude that a line half a bin off keeps under Hann's window
OWN_PLACES = 6  # of a pair in the pool: a line counts at three places
LINE_CAP = 5.0  # ln(power/floor) that one line counts at most where levels are averaged


@dataclass(frozen=True, slots=True, kw_only=True)
class SpacingSearchThresholds:
    """Where a spacing is sought, and when it is found."""

    chance: float = deciding(
        0.01, meaning="probability up to which the search of one window may find a spacing by chance",
        source="convention: one in a hundred; searches about shifted places of the 28-channel rig's spectra stay below",
    )  # fmt: skip
    stands_out: float = deciding(
        3.0, of="median amplitude of the neighbourhood", meaning="amplitude from which a line stands out",
        source="derivation: one line of noise (Rayleigh) does so with a probability of 2^-9 = 0.2 %",
    )  # fmt: skip
    smallest_spacing: float = deciding(
        8.0, unit="spectral lines", meaning="smallest spacing that is searched",
        source="derivation: Hann's main lobe is four lines wide, and two lobes must be resolved",
    )  # fmt: skip
    largest_spacing: float = deciding(
        0.5, of="mesh order", meaning="largest spacing that is searched",
        source="derivation: from there on the sidebands of the next mesh harmonic are nearer",
    )  # fmt: skip
    least_lines: int = deciding(
        200, meaning="lines off the known orders that a channel must have to be searched",
        source="derivation: the largest hundredth of them, from which the power law starts, is more than one line",
    )  # fmt: skip
    known_lines: float = deciding(
        2.5, unit="spectral lines", meaning="distance up to which a line belongs to a known order",
        source="derivation: half of the main lobe of Hann's window is two lines wide",
    )  # fmt: skip


DEFAULT = SpacingSearchThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OrderSpectrum:
    """One channel's amplitude spectrum against order, and how far each line stands out."""

    amplitude: np.ndarray  # peak (n,)
    median: np.ndarray  # of the neighbourhood's amplitudes, no less than what the angle's error makes (n,)
    ratio: np.ndarray  # amplitude over median at peaks off the known orders, 0 elsewhere (n,)
    own: np.ndarray  # whether a line belongs to a known order (n,)
    level: np.ndarray  # min(ln(power/floor), LINE_CAP) at peaks off the known orders, 0 elsewhere (n,)
    bin: float  # [orders]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PairSearch:
    """All spacings that were tried, with what the channels show of them."""

    spacings: np.ndarray  # (n,) [orders]
    log_chance: np.ndarray  # ln p of the whole search (n,)
    alone: Mapping[str, np.ndarray]  # ln p_c of every channel (n,)
    pairs: Mapping[str, np.ndarray]  # weaker side's ratio to its neighbourhood, (HARMONICS, n)


@dataclass(frozen=True, slots=True, kw_only=True)
class PairLimit:
    """The amplitude of which half of the pairs of sidebands at one mesh harmonic alone are found in one channel."""

    channel: str
    harmonic: int
    amplitude: float  # peak, of the weaker side, in the channel's unit


def spectra(
    accelerations: Mapping[str, Samples],
    track: AngleTrack,
    z1: int,
    period: int,
    limits: SpacingSearchThresholds = DEFAULT,
) -> dict[str, OrderSpectrum]:
    """Spectrum against order of every channel that reaches the first mesh harmonic and has lines off the known orders.

    z1      teeth of the pinion
    period  pinion turns after which all known shafts are back in the same position
    """
    out = {}
    for name, samples in accelerations.items():
        spline = splined(samples.values, samples.values.size)
        signal, per_turn = on_angle(samples, track, spline=spline)
        weight = hann(signal.values.size)
        width = 1 / signal.turns
        count = int(USABLE * per_turn / width)
        amplitude = _amplitudes(signal.values, weight)[:count]
        median = median_filter(amplitude, size=max(9, int(FLOOR_ORDERS / width)) | 1, mode="nearest")
        median = np.maximum(median, 1e-150)
        for error in by_angle_error(samples, track, spline):
            made = maximum_filter1d(_amplitudes(error, weight)[:count], MAIN_LOBE + track.pieces // 2)
            median = np.maximum(median, made)
        order = np.arange(amplitude.size) * width
        own = np.abs(order * period - np.rint(order * period)) / period < limits.known_lines * width
        highest = maximum_filter1d(amplitude, MAIN_LOBE)
        ratio = np.where(own | (amplitude < highest), 0.0, amplitude / median)
        out[name] = OrderSpectrum(
            amplitude=amplitude,
            median=median,
            ratio=ratio,
            level=np.minimum(np.log(np.maximum(ratio**2 * np.log(2), 1.0)), LINE_CAP),
            own=own,
            bin=width,
        )
    return {name: s for name, s in out.items() if s.own.size * s.bin > z1 and (~s.own).sum() > limits.least_lines}


def _amplitudes(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Peak amplitude of every line of values under a weight, (n,) each; (n//2 + 1,)."""
    return 2 * np.abs(np.fft.rfft((values - values.mean()) * weight)) / weight.sum()


def search(
    found: Mapping[str, OrderSpectrum],
    z1: int,
    period: int,
    limits: SpacingSearchThresholds = DEFAULT,
    shift: tuple[float, ...] = (0.0,) * HARMONICS,
) -> PairSearch:
    """Every spacing that no known shaft has, tried on every channel.

    z1     teeth of the pinion
    shift  of the places about which pairs are sought, from the mesh harmonics (HARMONICS,) [orders]: elsewhere than
           at 0, whatever is found is chance
    """
    width, finest = max(s.bin for s in found.values()), min(s.bin for s in found.values())
    spacings = np.arange(limits.smallest_spacing * width, limits.largest_spacing * z1, finest / 2)
    off = np.abs(spacings * period - np.rint(spacings * period)) / period
    spacings = spacings[off > limits.known_lines * width]
    alone, pairs = {}, {}
    tried = np.log(max(spacings.size * finest / (2 * width), 1.0))  # spacings that lie a line apart
    for name, s in found.items():
        near = maximum_filter1d(s.ratio, 3)
        pool = _pool(s, near, z1)
        pairs[name] = np.array([_weaker(near, s.bin, h * z1 + shift[h - 1], spacings) for h in range(1, HARMONICS + 1)])
        evidence = -2 * np.log(_share(pool, pairs[name])).sum(axis=0)
        stands = (pairs[name] >= limits.stands_out).any(axis=0)
        alone[name] = np.where(stands, tried + np.log(np.maximum(gammaincc(HARMONICS, evidence), 1e-300)), 0.0)
    return PairSearch(spacings=spacings, log_chance=_together(list(alone.values())), alone=alone, pairs=pairs)


def limits_of_search(
    found: Mapping[str, OrderSpectrum], z1: int, tried: int, limits: SpacingSearchThresholds = DEFAULT
) -> tuple[PairLimit, ...]:
    """Sizes of which half would have been found about one mesh harmonic alone, by channel and harmonic.

    tried  spacings
    """
    out = []
    chance = limits.chance / (2 * len(found) if len(found) > 1 else 1)
    needed = float(gammainccinv(HARMONICS, chance / max(tried, 1)))
    for name, s in found.items():
        pool = _pool(s, maximum_filter1d(s.ratio, 3), z1)
        ratio = max(_value_of(pool, float(np.exp(-needed / 2))), limits.stands_out)
        for h in range(1, HARMONICS + 1):
            at = round(h * z1 / s.bin)
            if at < s.median.size:
                out.append(PairLimit(channel=name, harmonic=h, amplitude=ratio / SCALLOP * float(s.median[at])))
    return tuple(out)


def _pool(s: OrderSpectrum, near: np.ndarray, z1: int) -> np.ndarray:
    """Sorted ratios of all lines off the known orders, where sidebands are sought (m,)."""
    inside = slice(int(0.5 * z1 / s.bin), min(int((HARMONICS + 0.5) * z1 / s.bin), near.size))
    return np.sort(near[inside][~s.own[inside]])


def _weaker(near: np.ndarray, bin_: float, middle: float, spacings: np.ndarray) -> np.ndarray:
    """The weaker of both sides' ratios at every spacing about a middle (n,)."""
    sides = []
    for sign in (-1, 1):
        at = np.rint((middle + sign * spacings) / bin_).astype(int)
        sides.append(np.where((at > 0) & (at < near.size), near[np.clip(at, 0, near.size - 1)], 0.0))
    return np.minimum(*sides)


def _share(pool: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Share of places that are as large as each value by chance, from the sorted pool of all places.

    The pair's own lines, which lie in the pool, are left out; beyond what the pool resolves, its power law goes on.
    """
    above = pool.size - np.searchsorted(pool, values, side="left")
    counted = np.minimum((np.maximum(above - OWN_PLACES, 0) + 0.5) / (pool.size + 1), 1.0)
    start, steepness = _tail(pool)
    beyond = TAIL[1] * (np.maximum(values, start) / start) ** -steepness
    return np.where(values > start, np.maximum(counted, beyond), counted)


def _tail(pool: np.ndarray) -> tuple[float, float]:
    """Value above which a power law is taken, and its exponent, by two quantiles that a few lines do not move."""
    wide, start = (float(pool[round((1 - share) * (pool.size - 1))]) for share in TAIL)
    if not 0 < wide < start:
        return np.inf, 1.0
    return start, float(np.log(TAIL[0] / TAIL[1]) / np.log(start / wide))


def _value_of(pool: np.ndarray, share: float) -> float:
    """The value that so small a share of places reaches by chance: the inverse of `_share`."""
    above = int(max(share * (pool.size + 1) - 0.5, 0.0)) + OWN_PLACES
    start, steepness = _tail(pool)
    return max(float(pool[max(pool.size - 1 - above, 0)]), start * (TAIL[1] / share) ** (1 / steepness))


def _together(alone: list[np.ndarray]) -> np.ndarray:
    """ln p over channels (n,)."""
    if len(alone) == 1:
        return alone[0]
    each = np.array(alone)
    return np.log(2) + np.minimum(np.log(len(alone)) + each.min(axis=0), 1 + each.mean(axis=0))
