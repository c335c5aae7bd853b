"""How exactly the edges of a shaft are timed: a pulse that is read from a sampled column is known to half a sample.

    û_k = frac(t_k/T),   û_(1) ≤ … ≤ û_(n)
    e_i = û_(i) − (i − ½)/n                             less their mean: density of the places
    U²  = Σ e_i² + 1/12n                                Watson's statistic: û evenly spread has U² of chance
    t_k − t(φ_k) = T·Σ_j (a_j cos 2πjû_k + b_j sin 2πjû_k),  j ≤ 3      departure from the smooth track, by the place
    σ   = T·√(mean e²)                                  T/√12 where all edges lie on the grid of the samples

Where in its sampling interval an edge truly passes is evenly spread, since no shaft keeps step with a sampling clock.
Times that are not so spread were moved by the sampling, each by its e: all of a square pulse to one place. The edges of
a steep flank are moved by little, and depart from a smooth track by an amount that their place tells. The same shift of
other times (`as_timed`) shows what such edges would make of a shaft whose true motion is known.

t   times of the edges                                                                             [s]
T   interval of the channel that the pulses were sampled with                                      [s]
e   error of an edge's time, in sampling intervals

Source   G. S. Watson, Biometrika 48 (1961) 109–114 (U², P(U² > u) → 2·exp(−2π²u));
         J. Doernberg et al., IEEE J. Solid-State Circuits 19 (1984) 820–827 (the density of codes shows their widths)
Limits   the pulses were sampled with a channel of the window; a shaft that keeps step with the sampling clock to a
         hundredth of a sample looks as if its edges were on the grid: they are then said to be less exact than they are
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import exp, pi

import numpy as np
from scipy.special import fdtrc

from twin.thresholds import deciding
from twin.windows import Window

MOST_EDGES = 4096  # that the spread is taken of, evenly among all
HARMONICS = 3  # of the place in a sampling interval that a departure is fitted with


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeTimingThresholds:
    """When the edges of a shaft were read from samples."""

    chance: float = deciding(
        1e-4,
        meaning="probability by which exact edges look so timed by samples, below which they are taken to be so timed",
        source="convention: one exact encoder in ten thousand windows",
    )


DEFAULT = EdgeTimingThresholds()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EdgeTiming:
    """What sampling with one interval has made of the times of a shaft's edges."""

    interval: float  # T [s]
    places: np.ndarray  # where edges are seen that pass at evenly spread places, rising (n,) [intervals]
    shift: float  # mean of place seen less true place [intervals]

    @property
    def std(self) -> float:
        """Standard deviation of one edge's time [s]."""
        n = self.places.size
        return self.interval * float(np.std(self.places - (np.arange(n) + 0.5) / n))

    def as_timed(self, times: np.ndarray) -> np.ndarray:
        """The times [s] at which edges that pass at these times would have been seen; (n,) → (n,)."""
        true = times / self.interval - self.shift
        whole = np.floor(true)
        at = np.minimum(((true - whole) * self.places.size).astype(int), self.places.size - 1)
        return (whole + self.places[at]) * self.interval


def edge_timing(
    times: np.ndarray,
    rates: Iterable[float],
    rest: Callable[[np.ndarray], tuple[np.ndarray, int]] | None,
    limits: EdgeTimingThresholds = DEFAULT,
) -> EdgeTiming | None:
    """What sampling at one of these rates [Hz] has made of an encoder's edges; None where they are exact.

    times  of the edges, without lost ones (n,) [s]
    rest   values of the edges (n,) less the smooth track that fits them best, and the track's free numbers; None
           where many edges are averaged, and the error of a steep flank with them
    """
    tests = (_by_density,) if rest is None else (_by_density, _by_departure(rest))
    found = [(*each(times, rate), rate) for rate in sorted(set(rates)) for each in tests]
    chance, places, rate = min(found, key=lambda each: each[0], default=(1.0, times, 0.0))
    if chance > limits.chance:
        return None
    shift = float(np.mean(places - (np.arange(places.size) + 0.5) / places.size))
    return EdgeTiming(interval=1 / rate, places=places, shift=shift)


def _by_density(times: np.ndarray, rate: float) -> tuple[float, np.ndarray]:
    """Probability of places as unevenly spread by chance, and the places."""
    places = np.sort(times[:: max(1, times.size // MOST_EDGES)] * rate % 1.0)
    n = places.size
    apart = places - (np.arange(n) + 0.5) / n
    return 2 * exp(-2 * pi**2 * (n * float(np.var(apart)) + 1 / (12 * n))), places


def _by_departure(
    rest: Callable[[np.ndarray], tuple[np.ndarray, int]],
) -> Callable[[np.ndarray, float], tuple[float, np.ndarray]]:
    """The same by what the place tells of an edge's departure from the smooth track."""

    def tested(times: np.ndarray, rate: float) -> tuple[float, np.ndarray]:
        waves = _waves(times * rate)
        departure, free = rest(times)
        columns = np.stack([rest(wave)[0] for wave in waves], axis=1)
        fitted, _, rank, _ = np.linalg.lstsq(columns, departure, rcond=1e-9)
        left = times.size - free - rank
        explained = float(np.sum((columns @ fitted) ** 2))
        unexplained = float(np.sum(departure**2)) - explained
        seen = np.linspace(0, 1, MOST_EDGES)
        true = np.maximum.accumulate(seen - rate * (fitted @ _waves(seen)))
        places = np.interp(true[0] + (np.arange(MOST_EDGES) + 0.5) / MOST_EDGES, true, seen)
        if left < 1 or not explained > 0:
            return 1.0, places
        return float(fdtrc(rank, left, (explained / rank) / max(unexplained / left, 1e-300))), places

    return tested


def _waves(places: np.ndarray) -> np.ndarray:
    """cos and sin of the harmonics of a place in the sampling interval; (n,) → (2·HARMONICS, n)."""
    phase = 2 * pi * places * np.arange(1, HARMONICS + 1)[:, None]
    return np.concatenate([np.cos(phase), np.sin(phase)])


def rates_of(window: Window) -> tuple[float, ...]:
    """Sampling rates of a window's channels [Hz], by which its pulses may have been sampled."""
    return tuple(s.rate for s in (*window.accelerations.values(), *window.torques.values()))
