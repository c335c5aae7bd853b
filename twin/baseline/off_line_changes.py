"""Measures off the lines against the healthy baseline: what has changed beyond the healthy scatter.

    ŷ = ȳ + b·(u − ū),   z = (y − ŷ) / (s·√(1 + 1/n + (u − ū)²/Σ(u_i − ū)²))      a straight line over the load

y    logarithm of a measure (off_lines.py), u the operating point, n recordings
s²   mean square of what each recording misses of the line through the others, half of it that of all measures of its
     kind: seven recordings alone give a variance to within 50 % only

The prediction is as uncertain beyond the learned range as the line through it is: the more, the further away.

Source   prediction interval of a regression line: N. R. Draper, H. Smith, Applied Regression Analysis, ch. 1
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin.baseline.learned import Baseline
from twin.baseline.reading import WindowReading
from twin.thresholds import deciding

SIZES = ("level", "noise", "tone")  # kinds of measures that go with the level of the channel
LEAST_SCATTER = 0.02  # of a logarithm, below which no scatter is believed


@dataclass(frozen=True, slots=True, kw_only=True)
class OffLineThresholds:
    """When a measure off the lines has changed."""

    changed: float = deciding(
        6.0, unit="standard deviations",
        meaning="deviation of a measure that is a change: three times the healthy scatter of two standard deviations",
        source="tuned on the healthy loads 0, 30 and 70 % of the broken-tooth set, where the largest of 71 measures on "
        "four channels deviates by 3.3",
    )  # fmt: skip
    least_recordings: int = deciding(
        5, meaning="healthy recordings from which a deviation is judged", source="SufficiencyLimits.least_recordings",
    )  # fmt: skip
    noise_bands: float = deciding(
        0.5, of="bands", meaning="share of the noise floors that must have risen for noise", source="convention: half",
    )  # fmt: skip
    clipped: float = deciding(
        0.001, meaning="share of samples at the largest and smallest value, beyond five times the healthy share, that "
        "is clipping", source="derivation: of noise, two samples in a window",
    )  # fmt: skip
    clipped_over_healthy: float = deciding(
        5.0, of="largest healthy share", meaning="share of samples at the extremes that is clipping",
        source="not derived",
    )  # fmt: skip
    dead: float = deciding(
        0.5, meaning="share of the window with one and the same value from which a sensor is dead",
        source="convention: half",
    )  # fmt: skip
    dead_time: float = deciding(
        0.01, meaning="longest run of one value, as a share of the window, that is dead time",
        source="derivation: thousands of samples of noise are never alike",
    )  # fmt: skip
    silent: float = deciding(
        -3.0, unit="ln of level", meaning="level against the expected one below which a sensor is dead",
        source="not derived: a twentieth; a gain that low leaves the converter's noise",
    )  # fmt: skip


DEFAULT = OffLineThresholds()


@dataclass(frozen=True, slots=True, kw_only=True)
class OffLineChange:
    """One measure of one channel against its expected value."""

    channel: str
    measure: str
    change: float  # of the logarithm
    deviation: float  # z [standard deviations]


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
    out = []
    for channel, lines in reading.channels.items():
        if lines.off is None:
            continue
        names = lines.off.names
        known = [
            (baseline.operating_point(r), c.off.values)
            for r in baseline.readings
            if (c := r.channels.get(channel)) is not None and c.off is not None and c.off.names == names
        ]
        if len(known) < limits.least_recordings:
            continue
        u, values = np.array([point for point, _ in known]), np.array([value for _, value in known])
        change, spread = _deviations(u, values, baseline.operating_point(reading), lines.off.values, names)
        change = change - common * np.array([kind_of(name) in SIZES for name in names])
        deviation = change / spread / wider
        out += [
            OffLineChange(channel=channel, measure=name, change=float(c), deviation=float(z))
            for name, c, z in zip(names, change, deviation, strict=True)
        ]
    return tuple(sorted(out, key=lambda one: -abs(one.deviation)))


def _deviations(
    u: np.ndarray, known: np.ndarray, at: np.ndarray, values: np.ndarray, names: tuple[str, ...]
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
    spread = np.sqrt(np.maximum(variance, LEAST_SCATTER**2) * (1 + here @ inverse @ here))
    change = values - here @ (inverse @ A.T @ known)
    return change, spread


def kind_of(measure: str) -> str:
    """The kind of a measure, by the first words of its name."""
    first = measure.split()
    return " ".join(first[:2]) if first[0] == "impacts" else first[0]
