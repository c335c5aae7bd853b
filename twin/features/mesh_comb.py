"""Where the mesh lines of a gear pair stand in a spectrum: the comb that fits best.

    comb(f) = Σ_sensors Σ_k ln(P(k·f)/floor)            k = 1 … 5

P   power spectrum; over its own floor every line counts alike, however the structure passes it on

The phase of the lines found is followed in mesh_speed.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import median_filter

from twin.errors import NotAvailable
from twin.features.gaps import filled
from twin.features.transforms import hann, power_of
from twin.windows import Samples

HARMONICS = 5
SEARCH = 0.03  # the mesh frequency is looked for this far from nominal, relative
SEGMENT = 2.0  # spectra are averaged over segments of this length [s]
STANDS_OUT = 1.7  # least ratio of the best comb to the next one
RIVAL = 0.012  # distance up to which a second comb is a second candidate, relative: one in a hundred, and its width
DIP = 0.5  # of a second comb's score, to which the score must fall between the two
LEAST_COMB = 3.0  # least mean ln(power/floor) of one sensor's harmonics together


def averaged_power(samples: Samples) -> tuple[np.ndarray, float]:
    """Hann power spectrum averaged over overlapping segments, and its bin width [Hz]; → (n,), float."""
    values, _ = filled(samples.values, samples.values.size)
    n = min(values.size, round(SEGMENT * samples.rate))
    starts = range(0, values.size - n + 1, max(1, n // 2))
    values = values - values.mean()
    power = np.sum([power_of(fft.rfft(hann(n) * values[a : a + n])) for a in starts], axis=0)
    return power, samples.rate / n


def over_floor(power, bins: int) -> np.ndarray:
    """ln(power/floor), at least 0, the floor being the median over `bins` neighbours; (n,) → (n,)."""
    floor = median_filter(power, size=bins, mode="reflect")
    return np.log(np.maximum(power / np.maximum(floor, 1e-300), 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Comb:
    """The best comb of mesh lines in a range of frequencies, and those it has to stand out from."""

    frequency: float  # [Hz]
    score: float  # mean over sensors of Σ_k ln(power/floor)
    next_score: float  # best elsewhere in the range
    neighbour: float  # frequency of the best comb of sidebands, or up to three pinion orders beyond the range [Hz]
    neighbour_score: float
    rivals: tuple[float, ...] = ()  # other combs within a per cent that fit nearly as well [Hz]


def comb_search(accelerations: Mapping[str, Samples], nominal: float, teeth: tuple[int, int]) -> Comb:
    """The comb of mesh lines near a nominal mesh frequency [Hz].

    Sidebands make combs of their own, whole pinion or gear orders away, but weaker ones than the mesh lines do: hence
    the look beyond the range. "Elsewhere" begins half a sideband spacing away and leaves them out.
    """
    spectra = [(samples.rate, *averaged_power(samples)) for samples in accelerations.values()]
    finest = min(width for _, _, width in spectra)
    reach = nominal * (SEARCH + 3.5 / teeth[0])
    frequency = np.arange(nominal - reach, nominal + reach, finest / (2 * HARMONICS))
    total = np.zeros(frequency.size)
    for rate, power, width in spectra:
        level = over_floor(power, 201)
        for k in range(1, HARMONICS + 1):
            if k * nominal * (1 + SEARCH) < rate / 2:
                total += np.interp(k * frequency / width, np.arange(level.size), level, right=0.0)
    total /= len(accelerations)
    inside = np.abs(frequency - nominal) <= SEARCH * nominal
    best = int(np.argmax(np.where(inside, total, -1.0)))
    elsewhere = np.abs(frequency - frequency[best]) > max(4 * finest, 0.5 * nominal / max(teeth))
    away = np.abs(frequency[:, None] - frequency[best]) / (frequency[best] / np.array(teeth))
    sideband = np.any(np.abs(away - np.rint(away)) * frequency[best] / np.array(teeth) < 4 * finest, axis=1)
    beyond = int(np.argmax(np.where(elsewhere & (~inside | sideband), total, -1.0)))
    return Comb(
        frequency=float(frequency[best]),
        score=float(total[best]),
        next_score=float(total[elsewhere & inside & ~sideband].max(initial=0.0)),
        neighbour=float(frequency[beyond]),
        neighbour_score=float(total[beyond]),
        rivals=_rivals(frequency, total, sideband, best, 4 * finest),
    )


def _rivals(
    frequency: np.ndarray, total: np.ndarray, sideband: np.ndarray, best: int, resolution: float
) -> tuple[float, ...]:
    """Combs nearer to the best than the next sideband, and further than the resolution, that nearly reach its score."""
    off = np.abs(frequency - frequency[best])
    near = ~sideband & (off > resolution) & (off <= max(RIVAL * frequency[best], 2 * resolution))
    out: list[float] = []
    for side in (frequency < frequency[best], frequency > frequency[best]):
        i = int(np.argmax(np.where(near & side, total, 0.0)))
        between = total[min(i, best) : max(i, best) + 1]
        apart = float(between.min()) < DIP * total[i]  # a line that is smeared by the speed has no gap
        if total[i] * STANDS_OUT > total[best] and apart:
            out.append(float(frequency[i]))
    return tuple(out)


def check_comb(comb: Comb, wanted: str) -> None:
    """Refuses a comb that does not stand out."""
    advice = "wrong tooth count or nominal speed?"
    if comb.score < LEAST_COMB or comb.score < STANDS_OUT * comb.next_score:
        raise NotAvailable(
            f"the speed is not available: no comb of mesh lines stands out within {100 * SEARCH:g} % of "
            f"{wanted} (best {comb.score:.1f} at {comb.frequency:.2f} Hz, next {comb.next_score:.1f}, needed "
            f"{STANDS_OUT:g} times that and {LEAST_COMB:g}); {advice}"
        )
    if comb.neighbour_score > comb.score:
        raise NotAvailable(
            f"the speed is not available: the lines at {comb.frequency:.2f} Hz near {wanted} are sidebands "
            f"of stronger ones at {comb.neighbour:.2f} Hz ({comb.score:.1f} against "
            f"{comb.neighbour_score:.1f}); {advice}"
        )
