"""What lies off a channel's lines: level, noise floor, tones, impacts by band, clipping, dead time.

    S_b(o) = |Σ_n w_n·e_b(θ_n)·e^{−i·o·θ_n}|·2/Σ w·e_b          e_b the squared envelope of band b, θ the pinion's angle

    impacts once a turn of shaft s in band b    ln √(Σ_n S_b(n·s)²), n·s in lines that no other shaft has
                                                with the lines about mesh harmonics left out
    impacts of no shaft                         max over o of the mean of ln(S_b(k·o)²/median), k = 1 … 3

Bands are octaves below four fifths of half the sampling rate. Impacts of teeth and bearings ring at kHz, where they
raise the squared envelope's lines long before a line of the spectrum itself. Tones are taken from spectra of blocks of
one length, so that a shorter recording has the same noise about them. Impacts that keep their angle: turn_impacts.py.

Source   squared envelope spectrum: J. Antoni, Mech. Syst. Signal Process. 21 (2007) 597–629; R. B. Randall, J. Antoni,
         Mech. Syst. Signal Process. 25 (2011) 485–520
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import lcm

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter

from twin.baseline.shaft_orders import own_multiples
from twin.features.angle import AngleTrack
from twin.features.end_of_range import samples_at_end_of_range
from twin.features.resample import on_angle
from twin.features.transforms import hann
from twin.windows import Samples

OCTAVES = 4  # whose envelopes are taken
FLOORS = 6  # octaves whose noise floor is taken
HIGHEST = 0.8  # of half the sampling rate
TONE_WIDTH, TONES = 20.0, 20  # [Hz], and how many such stretches from 0 are searched for tones
TONE_BLOCK = 3.0  # [s]
ENVELOPE_RATE = 1600.0  # [Hz]
MESH_WIDTH = 2.5  # orders to either side of a mesh harmonic: it and its sidebands, whose modulation is no impact
PER_SHAFT = 6  # multiples of a shaft's order
COMB = 3  # multiples of a free order
FREE = (0.35, 12.0)  # orders of the pinion that impacts of no shaft are searched in
OWN_WIDTH = 2.5  # bins on either side that a line of the pair covers: half of Hann's main lobe, and what wander adds
SILENCE = 1e-30  # level of a channel without any signal, in its unit
LEAST = 1e-9  # of the level, below which a measure is cut off


@dataclass(frozen=True, slots=True, kw_only=True)
class OffLines:
    """The measures of one channel; `names` and `values` go together."""

    names: tuple[str, ...]
    values: np.ndarray  # logarithms (n,)
    tones: tuple[float, ...]  # frequency of the largest amplitude in every stretch that is searched for tones [Hz]
    free_order: float  # of the clearest impacts of no shaft [orders of the pinion]
    clipped: float  # share of the samples that are the largest or the smallest value
    constant: float  # longest run of one value, as a share of the window


def octaves(rate: float) -> dict[str, tuple[float, float]]:
    """The bands whose envelopes are taken, from and to [Hz], by name, for a sampling rate [Hz]."""
    top = HIGHEST * rate / 2
    edges = [(top / 2 ** (i + 1), top / 2**i) for i in range(OCTAVES)]
    return {f"{_hz(low)} to {_hz(high)}": (low, high) for low, high in edges}


def off_lines(samples: Samples, track: AngleTrack, shafts: Sequence[Fraction], teeth: int) -> OffLines:
    """The measures of a channel, of one without any signal the level alone; lost samples are taken as the mean.

    shafts  orders of all shafts, of the pinion's rotation, the pair's first
    teeth   of the pinion
    """
    x = samples.values - np.nanmean(samples.values)
    x = np.where(np.isfinite(x), x, 0.0)
    size = max(float(np.sqrt(np.mean(x**2))), SILENCE)
    finite = samples.values[np.isfinite(samples.values)]
    extremes, run = samples_at_end_of_range(finite) / max(finite.size, 1), _longest_run(samples.values)
    if not x.any():
        level = np.array([np.log(size)])
        return OffLines(names=("level",), values=level, tones=(), free_order=0.0, clipped=extremes, constant=run)
    spectrum = np.fft.rfft(x)
    f = np.fft.rfftfreq(x.size, 1 / samples.rate)
    names, values = ["level"], [np.log(size)]
    power = np.abs(spectrum) ** 2 / x.size
    top = HIGHEST * samples.rate / 2
    for i in range(FLOORS):
        inside = (f > top / 2 ** (i + 1)) & (f <= top / 2**i)
        names.append(f"noise floor {_hz(top / 2 ** (i + 1))} to {_hz(top / 2**i)}")
        values.append(0.5 * np.log(max(float(np.median(power[inside])), (LEAST * size) ** 2)))
    tones, places = _tones(x, samples.rate, track.speed, shafts[:2])
    names += [f"tone {i * TONE_WIDTH:.0f} to {(i + 1) * TONE_WIDTH:.0f} Hz" for i in range(tones.size)]
    values += np.log(np.maximum(tones, LEAST * size)).tolist()
    best = (-np.inf, 0.0)
    order_of = f / track.speed
    of_mesh = (np.abs(order_of - teeth * np.rint(order_of / teeth)) < MESH_WIDTH) & (order_of > teeth / 2)
    for where, (low, high) in octaves(samples.rate).items():
        kept = np.where((f > low) & (f <= high), spectrum, 0.0)
        envelope = _squared_envelope(kept, x.size)
        names.append(f"peaks {where}")
        values.append(np.log(np.mean(envelope**2) / max(float(np.mean(envelope)) ** 2, 1e-300)))
        _, struck = _envelope_lines(_squared_envelope(np.where(of_mesh, 0, kept), x.size), samples, track)
        orders, lines = _envelope_lines(envelope, samples, track)
        for shaft in shafts:
            n = own_multiples(shaft, shafts, float(orders[-1]) if orders.size else 0.0, PER_SHAFT)
            names.append(f"impacts once a turn of order {shaft} {where}")
            at = np.rint(n * float(shaft) / orders[1]).astype(int)
            values.append(0.5 * np.log(max(float(np.sum(struck[at] ** 2)), LEAST)))
        score, order = _free(orders, lines, shafts)
        names.append(f"impacts of no shaft {where}")
        values.append(score)
        best = max(best, (score, order))
    return OffLines(
        names=tuple(names),
        values=np.array(values),
        tones=tuple(places.tolist()),
        free_order=best[1],
        clipped=extremes,
        constant=run,
    )


def _squared_envelope(kept: np.ndarray, count: int) -> np.ndarray:
    """|analytic signal|² of one-sided lines, of so many samples."""
    return np.abs(np.fft.ifft(np.concatenate([kept, np.zeros(count - kept.size)]))) ** 2


def _hz(frequency: float) -> str:
    return f"{frequency:.0f} Hz" if frequency < 1000 else f"{frequency / 1000:.2g} kHz"


def _tones(x: np.ndarray, rate: float, speed: float, shafts: Sequence[Fraction]) -> tuple[np.ndarray, np.ndarray]:
    """Largest amplitude off the pair's orders in every stretch of frequency, and where it is [Hz]; (TONES,) each.

    The root mean square of overlapping blocks.
    """
    size = min(x.size, round(TONE_BLOCK * rate))
    starts = np.linspace(0, x.size - size, max(1, round(2 * x.size / size) - 1)).astype(int)
    weight = hann(size)
    power = np.mean([np.abs(np.fft.rfft(x[i : i + size] * weight)) ** 2 for i in starts], axis=0)
    amplitude = 2 * np.sqrt(power) / weight.sum()
    width = rate / size
    f = np.arange(amplitude.size) * width
    period = lcm(*(s.denominator for s in shafts)) / speed
    reach = OWN_WIDTH * width
    own = np.abs(f * period - np.rint(f * period)) / period < reach
    amplitude = np.where(own, 0.0, amplitude)
    count = round(TONE_WIDTH / width)
    most = min(TONES, amplitude.size // count)
    stretches = amplitude[: most * count].reshape(most, count)
    return stretches.max(axis=1), f[: most * count].reshape(most, count)[np.arange(most), stretches.argmax(axis=1)]


def _envelope_lines(envelope: np.ndarray, samples: Samples, track: AngleTrack) -> tuple[np.ndarray, np.ndarray]:
    """Orders and amplitudes of a squared envelope's spectrum, relative to its mean."""
    block = max(1, int(samples.rate / ENVELOPE_RATE))
    usable = envelope.size // block * block
    slow = Samples(
        rate=samples.rate / block,
        start=samples.start + 0.5 * (block - 1) / samples.rate,
        values=envelope[:usable].reshape(-1, block).mean(axis=1),
    )
    signal, per_turn = on_angle(slow, track, slow.values.size)
    mean = max(float(signal.values.mean()), 1e-300)
    weight = hann(signal.values.size)
    amplitude = 2 * np.abs(np.fft.rfft((signal.values / mean - 1) * weight)) / weight.sum()
    count = int(0.4 * per_turn * signal.turns)
    return np.arange(count) / signal.turns, maximum_filter1d(amplitude, 3)[:count]


def _free(orders: np.ndarray, lines: np.ndarray, shafts: Sequence[Fraction]) -> tuple[float, float]:
    """The clearest comb of no shaft: mean ln(S²/median) of its multiples, and its order."""
    width = float(orders[1])
    median = median_filter(lines, size=max(9, int(0.8 / width)) | 1, mode="nearest")
    period = lcm(*(s.denominator for s in shafts[:2]))
    own = np.abs(orders * period - np.rint(orders * period)) / period < 3 * width
    level = np.where(own, 0.0, 2 * np.log(np.maximum(lines / np.maximum(median, 1e-12), 1.0)))
    first = np.arange(int(FREE[0] / width), min(int(FREE[1] / width), level.size // (COMB + 1)))
    if first.size == 0:
        return 0.0, 0.0
    near = maximum_filter1d(level, 3)
    score = np.mean([near[k * first] for k in range(1, COMB + 1)], axis=0)
    best = int(np.argmax(score))
    return float(score[best]), float(orders[first[best]])


def _longest_run(values: np.ndarray) -> float:
    """Longest run of one value, as a share of the window."""
    changes = np.flatnonzero(np.diff(values) != 0)
    edges = np.concatenate([[-1], changes, [values.size - 1]])
    return float(np.diff(edges).max() / values.size)
