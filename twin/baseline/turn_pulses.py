"""How far the mean turn of a shaft is one pulse, by band: the squared envelope of its lines over the turn.

    z(φ) = Σ_n X_n·e^{inφ},    K = ln(⟨|z|⁴⟩/⟨|z|²⟩²)          n·s within the band, s the shaft's order

An impact once a turn rings where the machine does, at kHz, in phase from turn to turn: K rises, while errors of all
teeth spread over the turn and leave K near ln 2. Lines of faster shafts, mesh harmonics and their first sidebands are
left out, as in FM4.

Source   FM4: R. M. Stewart, Machine Health Monitoring Group report MHM/R/10/77 (1977); in bands: P. D. McFadden,
         J. Vib. Acoust. 108 (1986) 165–170
Holds    impacts that keep their angle; bands of many lines
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from twin.thresholds import deciding

OVERSAMPLED = 4  # points of the turn for every line of the band
NAME = "pulse once a turn of order"


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnPulseThresholds:
    """Which bands are looked at."""

    least_lines: int = deciding(
        24, meaning="lines of a shaft that a band must have", source="not derived: fewer of random phases make pulses",
    )  # fmt: skip


DEFAULT = TurnPulseThresholds()


def turn_pulses(
    lines: np.ndarray,
    period: int,
    shafts: Sequence[Fraction],
    teeth: int,
    bands: Mapping[str, tuple[float, float]],
    limits: TurnPulseThresholds = DEFAULT,
) -> dict[str, float]:
    """K of every shaft and band that has lines enough, by the measure's name.

    lines   complex, at k/period orders of the pinion (K,)
    shafts  orders of all shafts
    teeth   of the pinion
    bands   from and to [orders of the pinion], by name
    """
    out = {}
    for shaft in shafts:
        step = int(shaft * period)
        k = np.arange(step, lines.size + 1, step)
        kept = np.ones(k.size, dtype=bool)
        for faster in (s for s in shafts if s > shaft):
            kept &= k % int(faster * period) != 0
        mesh = teeth * period
        from_mesh = np.abs((k + mesh // 2) % mesh - mesh // 2)
        kept &= from_mesh > step  # mesh harmonics and their first sidebands
        for band, (low, high) in bands.items():
            inside = (k > low * period) & (k <= high * period)
            if inside.sum() < limits.least_lines or not np.abs(lines[k - 1][inside & kept]).any():
                continue
            z = np.fft.ifft(np.where(kept, lines[k - 1], 0)[inside], OVERSAMPLED * int(inside.sum()))
            power = np.abs(z) ** 2
            out[f"{NAME} {shaft}, {band}"] = float(np.log(np.mean(power**2) / np.mean(power) ** 2))
    return out


def shaft_of(measure: str) -> Fraction | None:
    """The shaft's order in a measure's name; None for other measures."""
    return Fraction(measure.removeprefix(NAME).partition(",")[0].strip()) if measure.startswith(NAME) else None
