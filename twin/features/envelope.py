"""Impacts and modulations: spectral kurtosis to find their band, the squared envelope's spectrum for their rate.

    y(t) = band-passed analytic signal,  s = |y|²                 squared envelope
    K_s  = ⟨|y|⁴⟩/⟨|y|²⟩² − 2                                     spectral kurtosis of a band: 0 for Gaussian noise,
                                                                  −1 for one line, above 0 for impacts; std 2/√n
    S(α) = Σ w·(s − s̄)·exp(−2πi·α·t)                             a line at α: amplitude modulated at that rate

n   independent values of y, one per bin of the band
w   Hann window
α   rate of modulation, per second or per pinion turn

A line of S stands where its power passes the floor between the lines (noise_floor.py) with the false-alarm
probability stated, over all rates searched. Signals on an even grid of angle give rates in orders, on an even grid
of time in hertz; a defect that rolls along with the shaft is sharp in order, a non-gear one in hertz.

Source   J. Antoni, Mech. Syst. Signal Process. 20 (2006) 282–307 (spectral kurtosis), 21 (2007) 108–124 (kurtogram);
         R. B. Randall, J. Antoni, Mech. Syst. Signal Process. 25 (2011) 485–520 (envelope analysis)
Holds    rates below 0.6 of the band's width; impacts of at least one band width's length apart
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial, pi, sqrt

import numpy as np
from scipy import fft

from twin.errors import NotAvailable, ParameterError
from twin.features.level import TAPERED, tukey
from twin.features.noise_floor import exceedance, noise_floor
from twin.features.resample import AngleSignal
from twin.features.transforms import hann, power_of, powers, record_of, spectrum_of

FALSE_ALARM = 1e-3
LEVELS = 6  # the kurtogram's narrowest band is half the sampling rate over 2^LEVELS
LEAST_VALUES = 64  # of y in a band of the kurtogram
STANDING = 12.0  # power over floor from which a shaft line is taken out
SKIRT = 0.35  # orders on either side over which a shaft line may be spread
TRIM = 0.15  # share of the record at each end that the Hann window leaves too little of
MOST_FOUND = 24
SEARCHED = 0.6  # share of the band's width up to which rates are sought
BLOCKS = 256  # parts of a record in which the phase near a bin is expanded
TERMS = 4  # of the series
EDGE = 0.1  # share of the band over which each of its edges falls


@dataclass(frozen=True, slots=True, kw_only=True)
class BandKurtosis:
    """Spectral kurtosis of one band."""

    low: float  # in cycles per unit of the grid (Hz or order)
    high: float
    kurtosis: float
    std: float  # for Gaussian noise

    @property
    def deviation(self) -> float:
        """Kurtosis over what noise scatters."""
        return self.kurtosis / self.std


@dataclass(frozen=True, slots=True, kw_only=True)
class Modulation:
    """One line of the squared envelope's spectrum."""

    rate: float  # in the grid's unit: Hz, or order of pinion rotation
    rate_std: float
    depth: float  # amplitude of the line over the mean of the squared envelope
    over_floor: float  # power over the floor
    false_alarm: float  # probability that noise alone gives as much, at any rate searched
    shaft: str | None  # pinion, gear, or None where the rate belongs to neither


def without_shaft_lines(signal: AngleSignal, teeth: tuple[int, int]) -> AngleSignal:
    """The middle 70 % of a signal less every pinion and gear order that stands out of its spectrum.

    A line is taken out with its skirts, from its order outwards as long as they stand: a line near a mode follows
    the slow wander of the speed, which spreads it over up to a third of an order.
    """
    z1, z2 = teeth
    n = signal.values.size
    weight = hann(n)
    spectrum = spectrum_of(weight * (signal.values - (weight @ signal.values) / weight.sum()))
    power = power_of(spectrum)
    standing = power / noise_floor(power).power
    per_bin = 2 * pi / (n * signal.step)
    highest = 0.98 * (power.size - 1) * per_bin
    lines = [np.arange(1, int(highest / unit) + 1) * unit for unit in (1.0, z1 / z2)]
    at = np.unique(np.rint(np.concatenate(lines) / per_bin).astype(int))
    at = at[(at > 0) & (at < power.size - 1)]
    at = at[np.maximum(standing[at], np.maximum(standing[at - 1], standing[at + 1])) > STANDING]
    out = np.zeros(power.size, dtype=bool)
    out[:2] = True
    smooth = np.convolve(standing, np.ones(3) / 3, "same")
    for side in (-1, 1):
        going = at.copy()
        for k in range(int(SKIRT / per_bin) + 1):
            going = going[(going >= 0) & (going < power.size)]
            out[going] = True
            going = going[(k < 3) | (smooth[going] > 0.25 * STANDING)] + side
    spectrum[out] = 0.0
    cut = slice(int(TRIM * n), n - int(TRIM * n))
    return AngleSignal(
        start=signal.start + cut.start * signal.step,
        step=signal.step,
        values=record_of(spectrum, n)[cut] / weight[cut],
        usable=signal.usable[cut],
    )


def _ramped(size: int) -> np.ndarray:
    """Weight of each bin of a band, 1 but for raised cosines at its edges; (size,)."""
    edge = max(1, int(EDGE * size))
    ramp = np.sin(0.5 * pi * (np.arange(edge) + 0.5) / edge) ** 2
    out = np.ones(size)
    out[:edge] *= ramp
    out[size - edge :] *= ramp[::-1]
    return out


def _beats(size: int) -> np.ndarray:
    """Noise power in the squared envelope's spectrum for white noise in a band, over that at rate 0; (size,)."""
    weight = _ramped(size) ** 2
    length = fft.next_fast_len(2 * size, real=True)
    return np.abs(fft.irfft(power_of(fft.rfft(weight, length)), length)[:size]) / np.sum(weight**2)


def _analytic(spectrum, low: int, high: int, oversampling: int = 1) -> np.ndarray:
    """Bins low … high of a one-sided spectrum back on a grid just fine enough, complex, scaled to the signal."""
    size = high - low
    band = np.zeros(size * oversampling, dtype=complex)
    band[:size] = spectrum[low:high] * _ramped(size)
    return fft.ifft(band, norm="forward", overwrite_x=True)


def kurtogram(
    values, rate: float, band: tuple[float, float] | None = None, wider_than: float = 0.0
) -> tuple[BandKurtosis, ...]:
    """Spectral kurtosis of bands of falling width, the most impulsive over its own scatter first.

    values      (n,) without gaps
    rate        values per unit of the grid
    band        where to look; up to 0.45·rate where not given
    wider_than  width of a band from which it is examined, in cycles per unit
    """
    n = len(values)
    spectrum = spectrum_of(tukey(n) * (np.asarray(values) - np.mean(values))) * (2 / n)
    low, high = (0.0, 0.45 * rate) if band is None else band
    first, last = int(np.ceil(low * n / rate)), min(int(high * n / rate), spectrum.size)
    out = []
    for parts in sorted({p for k in range(LEVELS + 1) for p in (2**k, 3 * 2**k)}):
        size = (last - first) // parts
        if size < LEAST_VALUES or size * rate / n <= wider_than:
            break
        for i in range(parts):
            a = first + i * size
            ends = int(TAPERED * size) + 1
            power = power_of(_analytic(spectrum, a, a + size)[ends:-ends])
            mean = power.mean()
            if mean <= 0:
                continue
            kurtosis = float((power @ power) / power.size / mean**2 - 2)
            out.append(
                BandKurtosis(low=a * rate / n, high=(a + size) * rate / n, kurtosis=kurtosis, std=2 / sqrt(power.size))
            )
    if last - first < LEAST_VALUES or not spectrum[first:last].any():
        raise NotAvailable(f"the kurtogram is not available: {last - first} bins in the band, {LEAST_VALUES} needed")
    return tuple(sorted(out, key=lambda b: -b.deviation))


def _shaft_of(rate: float, tolerance: float, shafts: Sequence[tuple[str, float]]) -> str | None:
    for name, unit in shafts:
        if round(rate / unit) >= 1 and abs(rate - round(rate / unit) * unit) < tolerance:
            return name
    return None


class NearBins:
    """Power of a record near some bins of its spectrum, at any rate, from few numbers.

    F(b + δ) = Σ x·exp(−2πi·(b + δ)·k/n) is expanded in each of BLOCKS parts of the record about the part's centre,
    where the phase 2π·δ·u is small: below π/BLOCKS for |δ| ≤ 1, so that the series to u³ is good to 1e-9 of Σ |x|.
    """

    def __init__(self, values: np.ndarray, bins: np.ndarray) -> None:
        """The record, values (n,) real, near its bins (m,)."""
        n, m = values.size, bins.size
        length = -(-n // BLOCKS)
        padded = np.zeros(BLOCKS * length)
        padded[:n] = values
        u = (np.arange(length) - 0.5 * (length - 1)) / n
        series = np.stack([u**p / factorial(p) for p in range(TERMS)])
        turn = np.exp(-2j * pi / n * (np.outer(np.arange(length), bins) % n))  # within a part, (length, m)
        columns = (turn[:, :, None] * series.T[:, None, :]).reshape(length, m * TERMS)
        moments = padded.reshape(BLOCKS, length) @ np.concatenate((columns.real, columns.imag), axis=1)
        start = np.exp(-2j * pi / n * (np.outer(np.arange(BLOCKS) * length, bins) % n))  # of a part, (BLOCKS, m)
        whole = (moments[:, : m * TERMS] + 1j * moments[:, m * TERMS :]).reshape(BLOCKS, m, TERMS)
        self._moments = (whole * start[:, :, None]).transpose(1, 2, 0)  # (m, TERMS, BLOCKS)
        self._step = length / n  # from centre to centre, of the record

    def power(self, offsets: np.ndarray) -> np.ndarray:
        """|F|² at every bin plus each of its offsets, which lie within ±1; (m, k) → (m, k)."""
        turn = -2j * pi * offsets
        series = turn[:, :, None] ** np.arange(TERMS) @ self._moments  # (m, k, BLOCKS)
        phase = powers(np.exp(turn * self._step).ravel(), BLOCKS).T.reshape(series.shape)
        return power_of(np.sum(phase * series, axis=2))


def _refined(near: NearBins, unit: np.ndarray) -> np.ndarray:
    """Offsets of spectral peaks from their bins, by parabolas through the logarithm of their power; (m,) → (m,)."""
    offset, reach, going = np.zeros(unit.size), 0.5, np.ones(unit.size, dtype=bool)
    for _ in range(4):
        p = np.log(near.power(offset[:, None] + reach * np.array([-1.0, 0.0, 1.0])) + unit[:, None])
        curve = p[:, 0] - 2 * p[:, 1] + p[:, 2]
        going &= ~(curve >= 0)
        step = 0.5 * (p[:, 0] - p[:, 2]) / np.where(going, curve, -1.0)
        offset += np.where(going, reach * np.clip(step, -1.0, 1.0), 0.0)
        reach *= 0.3
    return offset


@dataclass(frozen=True, eq=False)
class Carrier:
    """A record whose bands are demodulated; its spectrum is computed once, when it is first asked for."""

    values: np.ndarray  # (n,) on an even grid of time or angle, without gaps
    rate: float  # values per unit of the grid: the sampling rate [Hz], or values per pinion turn

    @property
    def duration(self) -> float:
        """Length of the record, in units of the grid."""
        return len(self.values) / self.rate

    @cached_property
    def spectrum(self) -> np.ndarray:
        """One-sided spectrum without the mean, amplitudes of lines; complex (n//2 + 1,)."""
        return spectrum_of(np.asarray(self.values) - np.mean(self.values)) * (2 / len(self.values))

    def squared_envelope(self, band: tuple[float, float]) -> tuple[int, np.ndarray]:
        """How many bins a band has, and the squared envelope within it on a grid just fine enough, (2·bins,)."""
        low, high = int(np.ceil(band[0] * self.duration)), int(band[1] * self.duration)
        if not 0 <= low < high - 48 or band[1] > self.rate / 2:
            raise ParameterError(
                f"band {band[0]:g} … {band[1]:g} must lie within 0 … {self.rate / 2:g} and be "
                f"{48 / self.duration:.3g} wide at least"
            )
        return high - low, power_of(_analytic(self.spectrum, low, high, 2))


def envelope_spectrum(values, rate: float, band: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Spectrum of a band's squared envelope: rates, and amplitudes over the envelope's mean; two of (m,).

    A carrier whose amplitude varies by the share m reads 2·m/(1 + m²/2) at the rate, and m²/2/(1 + m²/2) at twice it.

    values  (n,) on an even grid of time or angle, without gaps
    rate    values per unit of the grid
    band    in cycles per unit
    """
    bins, s = Carrier(values, rate).squared_envelope(band)
    weight = hann(s.size)
    mean = float(weight @ s / weight.sum())
    if mean <= 0:
        raise NotAvailable(f"no envelope: the signal has nothing between {band[0]:g} and {band[1]:g}")
    amplitude = 2 / weight.sum() * np.abs(fft.rfft(weight * (s / mean - 1)))
    amplitude[0] = 0.0
    count = int(SEARCHED * bins)  # beyond, too few pairs of bins beat
    return np.arange(count) * rate / len(values), amplitude[:count]


def modulations(
    carrier: Carrier,
    band: tuple[float, float],
    shafts: Sequence[tuple[str, float]] = (),
    false_alarm: float = FALSE_ALARM,
) -> tuple[Modulation, ...]:
    """Lines of the squared envelope's spectrum of a band, those of no shaft first, then the strongest.

    band         in cycles per unit
    shafts       names and rates of shafts, in cycles per unit
    false_alarm  probability that noise alone gives one line or more
    """
    duration = carrier.duration
    bins, s = carrier.squared_envelope(band)
    weight = hann(s.size)
    mean = float(weight @ s / weight.sum())
    if mean <= 0:
        return ()
    weighted = weight * (s / mean - 1)
    searched = power_of(spectrum_of(weighted)[: int(SEARCHED * bins)])  # beyond, too few pairs of bins beat
    beats = _beats(bins)[: searched.size]
    floor = noise_floor(searched / beats)
    ratio = searched / beats / floor.power
    over = floor.threshold(false_alarm, searched.size - 4)
    peaks = 4 + np.flatnonzero(
        (searched[4:-1] >= searched[3:-2]) & (searched[4:-1] > searched[5:]) & (ratio[4:-1] > over)
    )
    peaks = peaks[np.argsort(-ratio[peaks])][:MOST_FOUND]

    t2 = ((np.arange(s.size) - 0.5 * (s.size - 1)) / s.size * duration) ** 2
    w2 = weight**2
    # the peak of |Σ w·s·exp| answers to noise in quadrature, weighted by w·t
    steadiness = float(w2 @ t2) / float(w2.sum()) / float(weight @ t2) ** 2
    noise = floor.power[peaks] * beats[peaks]
    rates = (peaks + _refined(NearBins(weighted, peaks), 1e-6 * noise)) / duration
    out = []
    for i, at, level in zip(peaks.tolist(), rates.tolist(), noise.tolist(), strict=True):
        depth = 2 * sqrt(searched[i]) / float(weight.sum())
        variance = 2 * level * steadiness / (2 * pi * depth) ** 2
        q = float(exceedance(ratio[i], floor.freedom))
        out.append(
            Modulation(
                rate=at,
                rate_std=sqrt(variance),
                depth=depth,
                over_floor=float(ratio[i]),
                false_alarm=float(-np.expm1(searched.size * np.log1p(-min(q, 0.5)))),
                shaft=_shaft_of(at, 1.5 / duration, shafts),
            )
        )
    return tuple(sorted(out, key=lambda m: (m.shaft is not None, -m.over_floor)))
