"""Modulation of the mesh vibration by the turn of either shaft, from the sidebands of the mesh lines.

    x(θ) = Σ_k [1 + d·cos(n·s·θ + a)]·C_k·cos(k·z1·θ + β·cos(n·s·θ + b) + ψ_k)          s = 1 or z1/z2
    S±_k/C_k = d/2·exp(±i·a) + i·β/2·exp(±i·b)

    D² = 2·Σ_k (|S+_k|² + |S−_k|² − noise)/Σ_k |C_k|²        D = d for amplitude, β for phase modulation alone

    A_k = S+_k/C_k + conj(S−_k/C_k) = d·exp(i·a),   P_k = S+_k/C_k − conj(S−_k/C_k) = i·β·exp(i·b)
    share of amplitude modulation = Σ |C_k|²·|A_k|²/Σ |C_k|²·(|A_k|² + |P_k|²)

x    acceleration                                                                        [m/s²]
θ    pinion angle                                                                        [rad]
C_k  complex amplitude of mesh harmonic k;  S±_k  of the lines n shaft orders above and below it

A mesh force that varies once a turn (eccentricity or run-out of the gear, a load or torque that varies with its turn)
modulates all harmonics alike. The transfer path weights the lines of a sideband pair differently where it has a
resonance between them, which turns part of an amplitude into a phase modulation; weighted by the power of the mesh
lines, the harmonics that are strong decide.

Source   R. B. Randall, J. Mech. Des. 104 (1982) 259–267 (sidebands); P. D. McFadden, J. Vib. Acoust. Stress Reliab.
         Des. 108 (1986) 165–170 (amplitude and phase modulation from the average)
Holds    d and β below about 0.5: first sidebands only
Ignores  which of the causes it is: one accelerometer cannot distinguish them
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np

from twin.assessment import Modulation, SidebandPair
from twin.errors import WindowError
from twin.features.angle import AngleTrack
from twin.features.lines import read_lines
from twin.features.resample import on_angle, spline_response
from twin.features.window_features import Key
from twin.thresholds import deciding
from twin.windows import Samples

HARMONICS = 5  # of the mesh that are read
MULTIPLES = (1, 2, 3)  # of a shaft's turn
USABLE_RATE = 0.45  # lines are read up to this share of the sampling rate


@dataclass(frozen=True, slots=True, kw_only=True)
class ModulationThresholds:
    """From when on a modulation is reported."""

    significance: float = deciding(
        5.0,
        unit="standard deviations",
        meaning="power of the sidebands over that of the noise between the lines from which a modulation is there",
        source="convention: five standard deviations",
    )
    least_amplitude: float = deciding(
        0.04,
        meaning="depth of the amplitude modulation from which a modulation is reported",
        source="twice 0.018, the deepest in healthy simulated campaigns, whose teeth differ within their tolerances; "
        "no limit of a fault: healthy measured gearboxes show 0.14 to 1.2",
    )
    least_depth: float = deciding(
        0.1,
        meaning="depth of amplitude and phase modulation together from which a modulation is reported",
        source="about twice 0.054, the deepest in healthy simulated campaigns, where the speed wanders",
    )


THRESHOLDS = ModulationThresholds()


Line = tuple[complex, float]  # amplitude, and standard deviation of its real and of its imaginary part
LineReader = Callable[[Key], Line | None]


def _keys(harmonics: int) -> list[Key]:
    """The mesh lines, then their sidebands by both shafts."""
    keys: list[Key] = [(k, 0, 0) for k in range(1, harmonics + 1)]
    for n in MULTIPLES:
        for k in range(1, harmonics + 1):
            keys += [(k, -n, 0), (k, n, 0), (k, 0, -n), (k, 0, n)]
    return keys


def modulations(
    samples: Samples,
    track: AngleTrack,
    teeth: tuple[int, int],
    sensor: str,
    limits: ModulationThresholds = THRESHOLDS,
) -> tuple[Modulation, ...]:
    """Modulations that stand out from the noise, the deepest first; WindowError where no lines can be read."""
    signal, per_turn = on_angle(samples, track)
    most = int((USABLE_RATE * per_turn - max(MULTIPLES)) / teeth[0])
    if most < 1:
        raise WindowError(f"the mesh frequency lies above {USABLE_RATE:g} of the sampling rate {samples.rate:g} Hz")
    lines = read_lines(
        signal, _keys(min(HARMONICS, most)), teeth, "m/s²",
        lambda orders: [(signal.values, spline_response(orders / per_turn))],
    )  # fmt: skip

    def reader(key: Key) -> Line | None:
        value, std = lines.get(*key), lines.get_std(*key)
        return None if value is None or std is None else (complex(value), std)

    found = []
    for shaft, order in (("pinion", 1.0), ("gear", teeth[0] / teeth[1])):
        for n in MULTIPLES:
            one = _of_shaft(reader, shaft, n, limits)
            if isinstance(one, tuple) and _is_reported(one[0], one[2], limits):
                depth, std, share, pairs = one
                found.append(
                    Modulation(
                        sensor=sensor, shaft=shaft, multiple=n, frequency=n * order * track.speed, depth=depth, std=std,
                        amplitude_share=share, pairs=pairs,
                    )
                )  # fmt: skip
    return tuple(sorted(found, key=lambda m: -m.depth))


def _is_reported(depth: float, amplitude_share: float, limits: ModulationThresholds) -> bool:
    return depth >= limits.least_depth or depth * sqrt(amplitude_share) >= limits.least_amplitude


def _of_shaft(
    read: LineReader, shaft: str, n: int, limits: ModulationThresholds
) -> tuple[float, float, float, tuple[SidebandPair, ...]] | float:
    """Depth, its standard deviation, share of amplitude modulation and pairs; the depth that is at most hidden in the
    noise where nothing exceeds it.
    """
    carrier, power, variance, amplitude, phase = 0.0, 0.0, 0.0, 0.0, 0.0
    pairs = []
    for k in range(1, HARMONICS + 1):
        sides = [(k, s * n, 0) if shaft == "pinion" else (k, 0, s * n) for s in (-1, 1)]
        found = [read(key) for key in ((k, 0, 0), *sides)]
        if any(line is None for line in found):
            continue
        (mesh, std), (lower, below_std), (upper, above_std) = (line for line in found if line is not None)
        if abs(mesh) < limits.significance * std:
            continue
        noise = (below_std, above_std)
        carrier += abs(mesh) ** 2
        for value, σ in zip((lower, upper), noise, strict=True):
            power += abs(value) ** 2 - 2 * σ**2
            variance += 4 * σ**2 * abs(value) ** 2 + 4 * σ**4
        below, above = lower / mesh, upper / mesh
        amplitude += abs(mesh) ** 2 * abs(above + below.conjugate()) ** 2
        phase += abs(mesh) ** 2 * abs(above - below.conjugate()) ** 2
        both, spread = abs(lower) + abs(upper), sqrt(noise[0] ** 2 + noise[1] ** 2)
        if both > limits.significance * spread:
            pairs.append(
                SidebandPair(
                    harmonic=k, mesh=abs(mesh), lower=abs(lower), upper=abs(upper), depth=both / abs(mesh),
                    std=spread / abs(mesh),
                )
            )  # fmt: skip
    if carrier == 0:
        return 0.0
    if not pairs or power <= limits.significance * sqrt(variance):
        return sqrt(2 * limits.significance * sqrt(variance) / carrier)
    depth = sqrt(2 * power / carrier)
    return (
        depth,
        sqrt(variance) / carrier / depth,
        float(amplitude / np.maximum(amplitude + phase, 1e-300)),
        tuple(pairs),
    )


def depth_of(
    read: LineReader, shaft: str, multiple: int, limits: ModulationThresholds = THRESHOLDS
) -> tuple[float, float, bool]:
    """Depth of one modulation by lines that were read elsewhere, 0 where nothing exceeds the noise; the depth that it
    has at most; and whether it is reported.
    """
    found = _of_shaft(read, shaft, multiple, limits)
    if not isinstance(found, tuple):
        return 0.0, found, False
    return found[0], found[0], _is_reported(found[0], found[2], limits)
