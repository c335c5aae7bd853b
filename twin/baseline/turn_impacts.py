"""Impacts once a turn of a shaft: the difference from the healthy lines as one pulse, in octaves of orders.

    z_n  = (Y_n − g·x_n)/σ_n                              n·s in the octave, s the shaft's order
    T(φ) = |Σ_n z_n·e^{inφ}|² / (N·max(Σ_n |z_n|², ε·N))  share of the difference that is one pulse at the angle φ
    S(φ) = −Σ_c (N_c − 1)·ln(1 − T_c(φ))                  over C channels: all sensors hear an impact at one angle
    L    = max_φ S − ln Σ_j<C S^j/j! − ln M               nat against random phases, the best of M angles

x, σ  healthy lines at this operating point and their scatter (learned.py); g one gain of a channel in the octave

For lines of random phases P(T > t) = (1 − t)^(N−1), whatever their size: neither noise nor a changed level makes a
pulse. Lines of faster shafts and those about mesh harmonics, which modulation of the mesh moves, are left out.

Lines of healthy machines are not quite random. Every recording of the baseline is compared with the others in the same
way, and L is judged by mean and scatter of theirs:

    ζ = (L − L̄)/(s·√(1 + 1/n))       L̄ of the shaft and octave, s² the mean variance of all m shafts and octaves

Few recordings give the scatter of one octave poorly; L is in nat everywhere, so that all of them share one. The largest
of many angles has an exponential tail (Gumbel), π/√6 standard deviations of ζ to the nat, and with a scatter of
k = m·(n − 1) values

    P = (1 + (π·ζ/√6 + γ)/k)^−k,      γ = 0.577

The deviation z that is stated is the one that has this probability where the scatter is known: k → ∞.

Source   share of one ordinate: R. A. Fisher, Proc. R. Soc. A 125 (1929) 54–59; pulse in the synchronous average:
         P. D. McFadden, J. Vib. Acoust. 108 (1986) 165–170; E. J. Gumbel, Statistics of Extremes (1958)
Holds    impacts that keep their angle and ring within the orders that are read
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache

import numpy as np

from twin.baseline.learned import Baseline, ExpectedLines
from twin.baseline.off_lines import MESH_WIDTH, OCTAVES
from twin.baseline.reading import WindowReading
from twin.thresholds import deciding

OVERSAMPLED = 4  # angles for every order that a band spans
GUMBEL = np.pi / np.sqrt(6)  # standard deviation of the largest of many exponential values [nat]
LEAST_ENERGY = 0.1  # ε: of the scatter, below which a difference is none, as for a recording that was learned


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnImpactThresholds:
    """When impacts once a turn have been added."""

    least_lines: int = deciding(
        24, meaning="lines of a shaft that an octave must have", source="not derived: fewer make pulses by chance",
    )  # fmt: skip
    least_recordings: int = deciding(
        5, meaning="healthy recordings from which a deviation is judged", source="SufficiencyLimits.least_recordings",
    )  # fmt: skip
    changed: float = deciding(
        6.0, unit="standard deviations", meaning="deviation of the evidence of impacts once a turn that is a change",
        source="derivation: 3 in 10 000 for each octave and shaft of healthy recordings by the tail of L; 3.7 is the "
        "largest of 441 on the broken-tooth set (baselines of five and six of its loads), on which s was chosen",
    )  # fmt: skip
    suspected: float = deciding(
        0.7, of="deviation of a change", meaning="deviation from which a recording is not said to be explained",
        source="OffLineThresholds.suspected; 3 in 1000 for each octave and shaft by the tail of L",
    )  # fmt: skip
    heard: float = deciding(
        6.9, unit="nat", meaning="evidence of a channel at the angle of the impacts from which it hears them",
        source="convention: 1 in 1000 of random phases at a given angle",
    )  # fmt: skip


DEFAULT = TurnImpactThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnImpact:
    """How far the difference of one window from the healthy machine is impacts once a turn, for a shaft and octave."""

    shaft: Fraction  # order
    orders: tuple[float, float]  # of the octave, of the pinion's rotation
    evidence: float  # L [nat]
    healthy: float  # mean L of the healthy recordings
    deviation: float  # z [standard deviations]
    angle: float  # of the shaft, from the baseline's zero [turns]
    rises: bool  # whether the lines at this angle are more of a pulse than the healthy ones
    peak: Mapping[str, tuple[float, float]]  # of the pulse and its standard deviation, by channel that hears it [m/s²]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Pulse:
    """The difference of one window from the healthy machine in one octave of one shaft, at its best angle."""

    evidence: float
    angle: float
    rises: bool
    peak: Mapping[str, tuple[float, float]]


def turn_impacts(
    baseline: Baseline,
    reading: WindowReading,
    expected: ExpectedLines,
    unusable: Iterable[str] = (),
    limits: TurnImpactThresholds = DEFAULT,
) -> tuple[TurnImpact, ...]:
    """Every shaft and octave, the largest deviation first; none where the baseline has too few recordings.

    unusable  channels whose sensors have changed
    """
    gone = set(unusable)
    channels = tuple(name for name in expected.lines if name not in gone)
    learned = _learned(baseline, channels, limits) if channels else ()
    if len(learned) < limits.least_recordings or baseline.counted.recordings < limits.least_recordings:
        return ()
    here = _pulses(baseline, channels, reading, expected, limits)
    shared = [place for place in here if all(place in pulses for pulses in learned)]
    if not shared:
        return ()
    L = np.array([[pulses[place].evidence for place in shared] for pulses in learned])
    spread = float(np.sqrt(max(float(L.var(axis=0, ddof=1).mean()), GUMBEL**2) * (1 + 1 / len(L))))
    highest = _highest(expected, channels) / reading.period
    found = [
        TurnImpact(
            shaft=shaft,
            orders=(highest / 2 ** (octave + 1), highest / 2**octave),
            evidence=here[shaft, octave].evidence,
            healthy=mean,
            deviation=deviation_of((here[shaft, octave].evidence - mean) / spread, len(shared) * (len(L) - 1)),
            angle=here[shaft, octave].angle,
            rises=here[shaft, octave].rises,
            peak=here[shaft, octave].peak,
        )
        for (shaft, octave), mean in zip(shared, L.mean(axis=0).tolist(), strict=True)
    ]
    return tuple(sorted(found, key=lambda one: -one.deviation))


@lru_cache(maxsize=8)  # the same for all windows that are compared with a baseline
def _learned(
    baseline: Baseline, channels: tuple[str, ...], limits: TurnImpactThresholds
) -> tuple[dict[tuple[Fraction, int], _Pulse], ...]:
    """The pulses of every healthy recording that has these channels, beside the others."""
    return tuple(
        _pulses(baseline, channels, reading, expected, limits)
        for reading, expected in baseline.left_out
        if set(channels) <= set(expected.lines)
    )


def _highest(expected: ExpectedLines, channels: Sequence[str]) -> int:
    """K of the channel with most lines."""
    return max(expected.lines[name].size for name in channels)


def _pulses(
    baseline: Baseline,
    channels: Sequence[str],
    reading: WindowReading,
    expected: ExpectedLines,
    limits: TurnImpactThresholds,
) -> dict[tuple[Fraction, int], _Pulse]:
    """The pulse of every shaft and octave that has lines enough; octaves by their number from the highest."""
    top, Q = _highest(expected, channels), reading.period
    out = {}
    for shaft in baseline.shafts:
        ahead = 0.0 if expected.alignment is None else float(shaft) * expected.alignment.angle / (2 * np.pi)
        for octave in range(OCTAVES):
            between = (top >> (octave + 1), top >> octave)
            places = own_lines(shaft, baseline.shafts, Q, int(baseline.rig.teeth[0]), between)
            if places.size >= limits.least_lines:
                found = _pulse(places, int(shaft * Q), channels, reading, expected, limits)
                out[shaft, octave] = replace(found, angle=(found.angle - ahead) % 1)
    return out


def own_lines(
    shaft: Fraction, shafts: Sequence[Fraction], period: int, teeth: int, between: tuple[int, int]
) -> np.ndarray:
    """k of a shaft's lines at k/period orders between two lines, without those of faster shafts and about the mesh."""
    step, mesh = int(shaft * period), teeth * period
    k = np.arange(step, between[1] + 1, step)
    kept = k > between[0]
    for faster in (s for s in shafts if s > shaft):
        kept &= k % int(faster * period) != 0
    from_mesh = np.abs((k + mesh // 2) % mesh - mesh // 2)
    return np.asarray(k[kept & (from_mesh > max(MESH_WIDTH * period, step))])


def _pulse(
    places: np.ndarray,
    step: int,
    channels: Sequence[str],
    reading: WindowReading,
    expected: ExpectedLines,
    limits: TurnImpactThresholds,
) -> _Pulse:
    """The difference at lines k as a pulse of the shaft whose lines are a step apart; its angle in the window's own."""
    first = int(places[0]) // step
    span = int(places[-1]) // step - first + 1
    count = 1 << int(np.ceil(np.log2(OVERSAMPLED * span)))
    shares: dict[str, np.ndarray] = {}
    for name in channels:
        k = places[places <= expected.lines[name].size]
        if k.size < limits.least_lines:
            continue
        z = _whitened(reading, expected, name, k)
        lines = np.zeros(count, dtype=complex)
        lines[k // step - first] = z
        power = np.abs(np.fft.ifft(lines) * count) ** 2
        T = np.minimum(power / (k.size * max(float(np.sum(np.abs(z) ** 2)), LEAST_ENERGY * k.size)), 1 - 1e-12)
        shares[name] = -(k.size - 1) * np.log1p(-T)
    S = np.sum(list(shares.values()), axis=0)
    best = int(np.argmax(S))
    turned = np.exp(2j * np.pi * best / count * (places // step))
    heard = [name for name, own in shares.items() if own[best] > limits.heard]
    sums = {name: _sums(reading, expected, name, places, turned) for name in heard}
    return _Pulse(
        evidence=tail_evidence(float(S[best]), len(shares)) - float(np.log(span)),
        angle=best / count,
        rises=sum(measured for measured, *_ in sums.values()) > sum(healthy for _, healthy, *_ in sums.values()),
        peak={name: (peak, std) for name, (_, _, peak, std) in sums.items()},
    )


def _whitened(reading: WindowReading, expected: ExpectedLines, name: str, k: np.ndarray) -> np.ndarray:
    """z of a channel at lines k (N,)."""
    σ = expected.std[name][k - 1]
    y, x = reading.channels[name].lines[k - 1] / σ, expected.lines[name][k - 1] / σ
    return np.asarray(y - np.vdot(x, y) / max(np.vdot(x, x).real, 1e-300) * x)


def _sums(
    reading: WindowReading, expected: ExpectedLines, name: str, places: np.ndarray, turned: np.ndarray
) -> tuple[float, float, float, float]:
    """Height at an angle of the measured and of the healthy lines, and of their difference with its deviation."""
    inside = places <= expected.lines[name].size
    k, turned = places[inside], turned[inside]
    y, x = reading.channels[name].lines[k - 1], expected.lines[name][k - 1]
    σ = float(np.sqrt(np.sum(expected.std[name][k - 1] ** 2)))
    return float(abs(turned @ y)), float(abs(turned @ x)), float(abs(turned @ (y - x))), σ


def tail_evidence(total: float, channels: int) -> float:
    """−ln P that S of so many channels with random phases exceeds a total [nat]."""
    j = np.arange(channels)
    factorial = np.concatenate([[0.0], np.cumsum(np.log(j[1:]))])
    return total - float(np.logaddexp.reduce(j * np.log(max(total, 1e-300)) - factorial))


def deviation_of(difference: float, known: int) -> float:
    """z of a difference over the scatter that so many values give."""
    if difference <= 0:
        return difference
    return float((known * np.log1p((GUMBEL * difference + np.euler_gamma) / known) - np.euler_gamma) / GUMBEL)
