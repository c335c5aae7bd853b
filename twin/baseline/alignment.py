"""One window's angle laid over another's, where no encoder's zero is common: by the pattern of the teeth.

    c(φ) = mean over channels of Re Σ_k conj(X_k)·Y_k·e^{−i·o_k·φ} / (|X|·|Y|),          φ in 0 … Q turns

No two teeth are alike, so the lines of all shafts together are the same at one turn of Q pinion turns only. The
largest c says where; how large, whether these are the same teeth at all. The mesh lines, which all teeth make alike,
take no part.

Source   correlation of synchronous averages, as for the phase of tachometers: P. D. McFadden, Mech. Syst. Signal
         Process. 1 (1987) 83–95
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import fft

OVERSAMPLED = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Alignment:
    """How one window lies over another."""

    angle: float  # φ by which Y is ahead [rad of the pinion]
    correlation: float  # at φ

    def turned(self, lines: np.ndarray, period: int) -> np.ndarray:
        """Lines of Y at k/Q (K,) as they stand in X's angle."""
        order = np.arange(1, lines.size + 1) / period
        return lines * np.exp(-1j * order * self.angle)


def align(
    reference: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], period: int, teeth: int
) -> Alignment | None:
    """Y's lines over X's; None where they have no channel in common.

    period  Q;  teeth  of the pinion
    """
    shared = [ch for ch in reference if ch in other]
    if not shared:
        return None
    count = max(min(reference[ch].size, other[ch].size) for ch in shared)
    n = fft.next_fast_len(OVERSAMPLED * count)
    summed = np.zeros(n, dtype=complex)
    for ch in shared:
        m = min(reference[ch].size, other[ch].size)
        x, y = (values[ch][:m] * (np.arange(1, m + 1) % (period * teeth) > 0) for values in (reference, other))
        scale = np.linalg.norm(x) * np.linalg.norm(y)
        if scale > 0:
            summed[1 : m + 1] += x.conj() * y / scale
    c = fft.fft(summed).real / len(shared)
    best = int(np.argmax(c))
    fine = best + _peak(c[best - 1], c[best], c[(best + 1) % n])
    return Alignment(angle=float(2 * np.pi * period * fine / n), correlation=float(c[best]))


def _peak(left: float, top: float, right: float) -> float:
    """Where a parabola through three values has its top, in steps from the middle one."""
    bent = left - 2 * top + right
    return 0.0 if bent >= 0 else float(np.clip(0.5 * (left - right) / bent, -0.5, 0.5))
