"""Measures off the lines against the healthy baseline: what has changed beyond the healthy scatter.

    ŷ = ȳ + b·(u − ū),   z = (y − ŷ) / (s·max(√(1 + 1/n + (u − ū)²/Σ(u_i − ū)²), w))      a straight line over the load

y    logarithm of a measure (off_lines.py), u the operating point, n recordings
s²   mean square of what each recording misses of the line through the others, half of it that of all measures of its
     kind: seven recordings alone give a variance to within 50 % only

The prediction is as uncertain beyond the learned range as the line through it is, or as what lies between recordings
grows with distance (w, operating.py), whichever is more: both say how far a measure may have gone on the way there.
A recording shorter than the healthy ones (T for T_h) gives measures from fewer blocks: all but the level of the channel
are as uncertain as their mean over fewer blocks, s·√(T_h/T).

    ln Λ = (ν + 1)/2·ln(1 + z²/ν) − ln M       nats for a change, ν = 3·(n − 1 − d), M measures tried

A measure has changed where |z| exceeds Student's t of ν degrees of freedom, so that a healthy recording does once in
1/α, α its share of the false alarms of a comparison (repeats.py): few recordings and many measures ask for more.

White noise of one power p, added in every band, raises the quiet bands most: Δy_b = ½·ln(1 + p·e^{−2ŷ_b}). It is a
change where the squares that it explains exceed B·F of B floors and ν/2.

Source   prediction interval of a regression line: N. R. Draper, H. Smith, Applied Regression Analysis, ch. 1;
         ν of a mean of two variances, 4·(n − 1 − d) where all measures of a kind scatter alike, and less where they
         do not: F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110–114; joint limit: H. Scheffé, The Analysis of
         Variance (1959)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import fdtri, stdtrit

from twin.baseline.learned import Baseline
from twin.baseline.operating import varies
from twin.baseline.reading import WindowReading
from twin.baseline.recordings import recording_of
from twin.baseline.repeats import share_of
from twin.thresholds import deciding

SIZES = ("level", "noise", "tone")  # kinds of measures that go with the level of the channel
RISING = ("impacts",)  # first words of kinds of which less is no change: fewer impacts than the healthy machine
NOISE_POWERS = 400  # tried
TOGETHER = 2  # noise floors of a channel move together: they say less of one another's scatter than other measures
LEAST_SCATTER = 0.02  # of a logarithm, below which no scatter is believed


@dataclass(frozen=True, slots=True, kw_only=True)
class OffLineThresholds:
    """When a measure off the lines has changed."""

    least_recordings: int = deciding(
        5, meaning="healthy recordings from which a deviation is judged", source="SufficiencyLimits.least_recordings",
    )  # fmt: skip
    of_mains: float = deciding(
        0.004,
        of="mains frequency",
        meaning="distance of a tone from 50 or 60 Hz, or a multiple, up to which it is the mains",
        source="grids of Europe and America stay within 0.2 Hz in ordinary operation",
    )
    noise_left: float = deciding(
        0.25, of="squared deviations of the noise floors", meaning="share that white noise of one power may leave",
        source="convention: half of the deviation explained",
    )  # fmt: skip
    suspected: float = deciding(
        0.7, of="deviation of a change", meaning="deviation from which a recording is not said to be explained",
        source="derivation: the root of half; healthy recordings of the broken-tooth set reach 0.55",
    )  # fmt: skip
    over_healthy: float = deciding(
        2.0, of="largest healthy share", meaning="share of lost samples, of a sensor that has lost some in healthy "
        "recordings, too, from which that is new", source="not derived",
    )  # fmt: skip
    silent: float = deciding(
        -3.0, unit="ln of level", meaning="level against the expected one below which a sensor is dead",
        source="not derived: a twentieth; a gain that low leaves the converter's noise",
    )  # fmt: skip
    one_factor: float = deciding(
        0.7, unit="ln of level", meaning="difference of the levels of silent sensors that one factor explains",
        source="not derived: a factor of two, for a change of load between the recordings; dead sensors differ by more",
    )  # fmt: skip


DEFAULT = OffLineThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class OffLineChange:
    """One measure of one channel against its expected value."""

    channel: str
    measure: str
    expected: float  # logarithm ŷ
    change: float  # of the logarithm
    deviation: float  # z [standard deviations]
    freedom: int  # ν
    tried: int  # M

    @property
    def log_evidence(self) -> float:
        """ln Λ [nat]."""
        return student_evidence(self.deviation**2, self.freedom, self.tried)

    @property
    def limit(self) -> float:
        """Deviation from which it is a change [standard deviations]."""
        return student_limit(self.freedom, self.tried)

    @property
    def over(self) -> float:
        """The deviation over its limit."""
        return abs(self.deviation) / self.limit


@dataclass(frozen=True, slots=True, kw_only=True)
class AddedNoise:
    """White noise that one channel has more of than when it was healthy."""

    rms: float  # in the channel's unit, up to half the sampling rate
    deviation: float  # root of the squared deviations that it explains
    log_evidence: float  # [nat]
    limit: float  # deviation from which it is a change: of Fisher's F, the power being free

    @property
    def over(self) -> float:
        """The deviation over its limit."""
        return self.deviation / self.limit


def student_evidence(squared: float, freedom: int, tried: int) -> float:
    """ln Λ [nat] of a squared deviation whose scatter has so many degrees of freedom, the best of so many tried."""
    return 0.5 * (freedom + 1) * float(np.log1p(squared / freedom)) - float(np.log(max(tried, 1)))


@lru_cache(maxsize=64)
def student_limit(freedom: int, tried: int) -> float:
    """t of Student's distribution that one of so many measures may exceed to either side."""
    return float(-stdtrit(freedom, share_of(2 * tried)))


def off_line_changes(
    baseline: Baseline,
    reading: WindowReading,
    wider: float = 1.0,
    common: float = 0.0,
    limits: OffLineThresholds = DEFAULT,
) -> tuple[OffLineChange, ...]:
    """Every measure of every channel, the largest deviation first; none where the baseline has too few recordings.

    wider   by how much more a point may miss for its distance from the recordings (`ExpectedLines.wider`)
    common  ln of the level that all sensors share: of no channel by itself
    """
    found = []
    for channel, lines in reading.channels.items():
        if lines.off is None:
            continue
        here = dict(zip(lines.off.names, lines.off.values.tolist(), strict=True))
        known = [
            (r, dict(zip(c.off.names, c.off.values.tolist(), strict=True)))
            for r in baseline.readings
            if (c := r.channels.get(channel)) is not None and c.off is not None
        ]
        recordings = len(set(recording_of([r for r, _ in known])))
        if recordings < limits.least_recordings:
            continue
        names = tuple(name for name in here if all(name in values for _, values in known))
        u = np.array([baseline.operating_point(r) for r, _ in known])
        varied = varies(u)  # the wander about one point is no load
        u, at = u[:, varied], baseline.operating_point(reading)[varied]
        learned, now = np.array([[v[n] for n in names] for _, v in known]), np.array([here[n] for n in names])
        change, spread = _deviations(u, learned, at, now, names, wider)
        spread = spread * np.where([kind_of(name) == "level" for name in names], 1.0, _fewer_blocks(baseline, reading))
        shared = common * np.array([kind_of(name) in SIZES for name in names])
        freedom = 3 * max(recordings - 1 - u.shape[1], 1)
        found.append((channel, names, now - change + shared, change - shared, spread, freedom))
    tried = sum(len(names) for _, names, *_ in found)
    out = [
        OffLineChange(
            channel=channel,
            measure=name,
            expected=e,
            change=c,
            freedom=freedom,
            tried=tried,
            deviation=max(c / s, 0.0) if name.startswith(RISING) else c / s,
        )
        for channel, names, expected, change, spread, freedom in found
        for name, e, c, s in zip(names, expected.tolist(), change.tolist(), spread.tolist(), strict=True)
    ]
    return tuple(sorted(out, key=lambda one: -abs(one.deviation)))


@lru_cache(maxsize=64)
def joint_limit(measures: int, freedom: int, channels: int) -> float:
    """Root of the squares that so many deviations of one of so many channels may have together (Scheffé)."""
    return float(np.sqrt(measures / fdtri(freedom, measures, share_of(channels))))


def added_noise(
    changes: Sequence[OffLineChange], channels: int, limits: OffLineThresholds = DEFAULT
) -> AddedNoise | None:
    """White noise that explains how the noise floors of one of so many channels differ; None where it does not."""
    floors = [c for c in changes if kind_of(c.measure) == "noise"]
    if not floors:
        return None
    y, Δ = np.array([c.expected for c in floors]), np.array([c.change for c in floors])
    s = np.array([c.change / c.deviation if c.deviation else LEAST_SCATTER for c in floors])
    powers = np.exp(np.linspace(2 * y.min() - 4, 2 * y.max() + 4, NOISE_POWERS))
    left = np.sum(((Δ - 0.5 * np.log1p(powers[:, None] * np.exp(-2 * y))) / s) ** 2, axis=1)
    best, whole = int(np.argmin(left)), float(np.sum((Δ / s) ** 2))
    gained = whole - float(left[best])
    if gained <= 0 or left[best] > limits.noise_left * whole:
        return None
    return AddedNoise(
        rms=float(np.sqrt(powers[best] / np.log(2))),  # the floor is a median, ln 2 of the mean
        deviation=float(np.sqrt(gained)),
        log_evidence=student_evidence(gained, floors[0].freedom, floors[0].tried),
        limit=joint_limit(len(floors), floors[0].freedom // TOGETHER, channels),
    )


def _deviations(
    u: np.ndarray, known: np.ndarray, at: np.ndarray, values: np.ndarray, names: tuple[str, ...], wider: float
) -> tuple[np.ndarray, np.ndarray]:
    """Change of measures and its standard deviation (m,), from operating points (n, d) with their values (n, m)."""
    A = np.column_stack([np.ones(len(u)), (u - u.mean(axis=0)) / np.maximum(np.ptp(u, axis=0), 1e-9)])
    here = np.concatenate([[1.0], (at - u.mean(axis=0)) / np.maximum(np.ptp(u, axis=0), 1e-9)])
    inverse = np.linalg.pinv(A.T @ A)
    left = known - A @ (inverse @ A.T @ known)
    own = 1 - np.einsum("ij,jk,ik->i", A, inverse, A)
    variance = np.mean((left / np.maximum(own, 0.1)[:, None]) ** 2, axis=0)
    kinds = np.array([kind_of(name) for name in names])
    for kind in set(kinds.tolist()):
        alike = kinds == kind
        variance[alike] = 0.5 * (variance[alike] + variance[alike].mean())
    spread = np.sqrt(np.maximum(variance, LEAST_SCATTER**2) * max(1 + here @ inverse @ here, wider**2))
    change = values - here @ (inverse @ A.T @ known)
    return change, spread


def _fewer_blocks(baseline: Baseline, reading: WindowReading) -> float:
    """√(T_h/T), of the median healthy recording and of this one; 1 where this one is as long."""
    usual = float(np.median([r.duration for r in baseline.readings]))
    return float(np.sqrt(max(usual / reading.duration, 1.0)))


def kind_of(measure: str) -> str:
    """The kind of a measure, by the first words of its name."""
    first = measure.split()
    return " ".join(first[:2]) if first[0] == "impacts" else first[0]
