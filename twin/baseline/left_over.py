"""What no finding explains of windows beside their baseline: misfit to the healthy scatter, and strongest lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.assessment import SpectralLine
from twin.baseline.findings import BaselineComparison

MOST_LINES = 12
OUTSIDE = 3.0  # standard deviations beyond which energy is counted as left over
MOST_GROWN = 5.0  # times the healthy scatter that lines raised by what was found are given at most


def left_over(compared: Sequence[BaselineComparison]) -> tuple[float | None, float, list[SpectralLine]]:
    """Share of the energy left beyond the healthy scatter, its misfit, and its strongest lines."""
    energy = beyond = 0.0
    misfits: list[float] = []
    lines: dict[int, float] = {}
    for window in compared:
        for channel, x in window.expected.lines.items():
            y, z = window.reading.channels[channel].lines[: x.size], window.explained(channel)
            left, σ = np.abs(y - z) ** 2, window.expected.std[channel]
            grown = σ * np.maximum(1.0, np.abs(z) / np.maximum(np.abs(x), 1e-300)).clip(max=MOST_GROWN)
            if any(p.moved for p in window.paths if p.channel == channel):
                grown = np.hypot(grown, window.limits.path_smoothness * np.abs(z))
            misfits.append(float(np.mean(left / grown**2)))
            energy += float(np.sum(np.abs(y) ** 2))
            excess = np.maximum(left - OUTSIDE**2 * grown**2, 0.0)
            beyond += float(np.sum(excess))
            for k in np.argsort(excess)[::-1][:MOST_LINES].tolist():
                if excess[k] > 0:
                    lines[k] = max(lines.get(k, 0.0), float(excess[k]))
    if energy == 0:
        return None, 0.0, []
    first = compared[0].reading
    strongest = sorted(lines.items(), key=lambda item: -item[1])[:MOST_LINES]
    return (
        beyond / energy,
        float(np.median(misfits)),
        [
            SpectralLine(
                order=float((k + 1) / first.period),
                frequency=float((k + 1) / first.period * first.speed_hz),
                share=value / energy,
            )
            for k, value in strongest
        ],
    )
